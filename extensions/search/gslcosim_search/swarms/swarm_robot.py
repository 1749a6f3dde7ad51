"""Swarm robot: a nose, bests that fade, reports of the others, legs, and a declaration; particles among them.

Held by:
    extensions/search/tests/agents/test_particle_swarms.py
    extensions/search/tests/unit/swarms/test_swarm_robot.py
"""

import math
from abc import abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
from numpy.typing import NDArray

from gslcosim.agent_kit import Briefing, Command, Observation, RadioMessage
from gslcosim.agent_kit.settings import load_settings
from gslcosim_search import elementary
from gslcosim_search.elementary import distance
from gslcosim_search.learned.policy_files import with_learned_parameters
from gslcosim_search.motion.declaration import Estimate, SwarmRule
from gslcosim_search.motion.legs import LegPlanner, LegSpace
from gslcosim_search.random_stream import RandomStream
from gslcosim_search.search_agent import SearchAgent
from gslcosim_search.senses.instruments import Nose, find_noses, find_vanes
from gslcosim_search.senses.stop_and_measure import Measurement, StopAndMeasure
from gslcosim_search.swarms.particle_swarm import (
    Sighting,
    SwarmWeights,
    better,
    limit_length,
    pso_velocity,
    repelled_velocity,
    rotate,
)
from gslcosim_search.swarms.rounds import Report, ReportedBest, Team
from gslcosim_search.swarms.sniffy_bug import searching_waypoint

Vector = NDArray[np.float64]
# Who was not heard for so long may be anywhere.
LOST_AFTER_S = 30.0
N_REDRAWS = 10
_NO_STEP = np.zeros(2)


class GasScale:
    """Scale of gas that a swarm can compare: ppm, hits, or what a MOX sensor shows beyond air.

    f = ppm (or hits) as measured; of a resistance R with a clean-air value R0 the estimate in ppm where the run offers
    one, else R0 / R - 1; and 0 while R > (1 - band) R0, because near clean air an estimate is noise, or while f does
    not exceed the floor.

    State: R0, the most that was ever measured [ohm].
    """

    def __init__(self, nose: Nose, *, floor: float, band_frac: float) -> None:
        """Begin without a clean-air value; `floor` in the unit of f, `band_frac` the dead band of a resistance."""
        self._nose, self._floor, self._band_frac = nose, floor, band_frac
        self._clean_ohm = 0.0

    def amount(self, measurement: Measurement) -> float:
        """Return f; 0 where there is no gas."""
        value = measurement.values[0]
        if self._nose.unit != "ohm":
            return self._above_floor(value)
        self._clean_ohm = max(self._clean_ohm, value)
        if value > (1.0 - self._band_frac) * self._clean_ohm or value <= 0.0:
            return 0.0
        estimated = measurement.ppm[0] if self._nose.estimate else self._clean_ohm / value - 1.0
        return self._above_floor(min(estimated, 1e12))

    def _above_floor(self, amount: float) -> float:
        return amount if math.isfinite(amount) and amount > self._floor else 0.0


class Explorer:
    """Legs to waypoints drawn at random, for as long as nobody has met gas: the rule of Sniffy Bug.

    State: the waypoint, and since when it is flown to.
    """

    def __init__(self, room: LegSpace, draws: RandomStream, *, inertia: float, draw: float, waypoint_s: float) -> None:
        """Begin without a waypoint; w' and r_r as in `searching_waypoint`, `waypoint_s` the longest way to one [s]."""
        self._room, self._draws = room, draws
        self._inertia, self._draw, self._waypoint_s = inertia, draw, waypoint_s
        self._waypoint_m: Vector | None = None
        self._since_s = 0.0

    def forget(self) -> None:
        """Give the waypoint up: it cannot be reached, or something else led away from it."""
        self._waypoint_m = None

    def step(self, place_m: Vector, now_s: float, leg_m: float) -> Vector:
        """Return the next step, at most a leg long [m]."""
        last_m = self._waypoint_m
        is_reached = last_m is not None and distance(place_m, last_m) < 0.5 * leg_m
        if last_m is None or is_reached or now_s - self._since_s > self._waypoint_s:
            last_m = self._next(place_m, place_m if last_m is None else last_m)
            self._waypoint_m, self._since_s = last_m, now_s
        return limit_length(last_m - place_m, leg_m)

    def _next(self, place_m: Vector, last_m: Vector) -> Vector:
        sides = zip(self._room.min_m[:2], self._room.max_m[:2])
        drawn_m = np.array([self._draws.uniform(low, high) for low, high in sides])
        waypoint_m = searching_waypoint(place_m, last_m, drawn_m, inertia=self._inertia, draw=self._draw)
        return np.array(self._room.nearest(tuple(waypoint_m)))


class SwarmMember(SearchAgent):
    """One of a swarm, which knows the others by radio only: it measures, remembers its own best, reports, and declares.

    Its settings: `gas_floor`, `mox_band_frac`, `fades_s`, `declares`, `near_m`, `near_s`, `unchanged_s`.

    State: where and when it is, what it smells, its own best, what the others said, and its declaration. A method may
    set `numbers`, what it sends the others besides, and `is_ignored`, the places whose gas does not count.
    """

    def __init__(self, briefing: Briefing, settings: SimpleNamespace | None = None) -> None:
        super().__init__(briefing, settings)
        settings = self.settings
        self.team = Team(briefing)
        self.place_m, self.now_s = np.zeros(2), 0.0
        self.amount, self.wind_m_s = 0.0, np.zeros(2)
        self.own_best: Sighting | None = None
        self.best: Sighting | None = None
        self.numbers: tuple[float, ...] = ()
        self.is_ignored: Callable[[Sequence[float]], bool] = lambda place_m: False
        nose, vane = find_noses(briefing)[0], next(iter(find_vanes(briefing)), None)
        self._measure = StopAndMeasure([nose], vane)
        self._smell = GasScale(nose, floor=settings.gas_floor, band_frac=settings.mox_band_frac)
        self._rule = SwarmRule(radius_m=settings.near_m, near_s=settings.near_s, unchanged_s=settings.unchanged_s)

    def observe(self, observation: Observation) -> None:
        """Measure and listen."""
        self.listen(observation)

    def listen(self, observation: Observation) -> tuple[tuple[str, Report], ...]:
        """Measure and listen, at every observation; return the news of the others."""
        self._measure.add(observation)
        return self.team.receive(observation)

    def learn(self, observation: Observation) -> None:
        """Take the measurement of this stop; the swarm's `best` is as it counts now."""
        self.take(observation)
        self.best = self.swarm_best()

    def take(self, observation: Observation) -> None:
        """Take the measurement that ends with a question: place, gas, wind, and the own best."""
        self._measure.add(observation)
        self.place_m, self.now_s = np.array(observation.position_world_m[:2]), observation.time_s
        measurement = self._measure.measured()
        counts = measurement is not None and not self.is_ignored(self._place())
        self.amount = self._smell.amount(measurement) if measurement is not None and counts else 0.0
        if measurement is not None and measurement.wind is not None:
            away_rad = measurement.wind.upwind_rad + math.pi
            self.wind_m_s = measurement.wind.speed_m_s * np.array([elementary.cos(away_rad), elementary.sin(away_rad)])
        if self.amount > 0.0:
            self.own_best = better(self.own_best, self._here(), fades_s=self.settings.fades_s)

    def forget(self) -> None:
        """Forget all bests, its own and those that the others reported."""
        self.own_best = None
        for name in self.team.reports:
            self.forget_best_of(name)

    def forget_best_of(self, name: str) -> None:
        """Forget what another robot reported of gas, but not where it is."""
        self.team.reports[name] = replace(self.team.reports[name], amount=0.0, best=None)

    def swarm_best(self) -> Sighting | None:
        """Return the best place that the robot knows of, as it counts now."""
        known = [] if self.own_best is None else [self.own_best]
        for report in self.team.recent(self.now_s).values():
            reported = (report.best, ReportedBest(position_m=report.position_m, amount=report.amount))
            known += [
                Sighting(best.position_m[:2], best.amount, report.time_s) for best in reported if best is not None
            ]
        counting = (place for place in known if place.amount > 0.0 and not self.is_ignored(place.place_m))
        now = [sighting.faded(self.now_s, self.settings.fades_s) for sighting in counting]
        return max(now, key=lambda sighting: sighting.amount, default=None)

    def others_m(self, max_age_s: float = LOST_AFTER_S) -> Vector:
        """Return the (n, 2) places of the others that were heard lately, by sorted names [m]."""
        reports = self.team.recent(self.now_s, max_age_s).values()
        return np.array([report.position_m[:2] for report in reports]).reshape(-1, 2)

    def estimate(self, observation: Observation) -> Estimate | None:
        """Return the swarm's best place, if all are near it, or it has been so for long."""
        if self.best is None:
            return None
        heard_m = [self._place(), *map(tuple, self.others_m())]
        # Who is not heard is not near: it counts among those that are not.
        lost_m = [(math.inf, math.inf)] * (len(self.team.members) - len(heard_m))
        found = self._rule.add(self.now_s, self.best.place_m, heard_m + lost_m)
        return found if found and found.confidence > 0.0 else None

    def outgoing(self, observation: Observation) -> tuple[RadioMessage, ...]:
        """Return the outgoing messages: position, gas, wind, and the best reading that the robot knows."""
        best = self.swarm_best()
        x_m_s, y_m_s = self.wind_m_s
        report = Report(
            time_s=self.now_s,
            position_m=observation.position_world_m,
            amount=self.amount,
            wind_m_s=(float(x_m_s), float(y_m_s)),
            best=None if best is None else ReportedBest(position_m=(*best.place_m, self.height_m), amount=best.amount),
            numbers=self.numbers,
        )
        return self.team.call(report)

    # In centimetres, as the others get it: the same best has the same place for all.
    def _here(self) -> Sighting:
        x_m, y_m = self._place()
        return Sighting((round(x_m, 2), round(y_m, 2)), self.amount, self.now_s)

    def _place(self) -> tuple[float, float]:
        x_m, y_m = self.place_m
        return float(x_m), float(y_m)


class SwarmRobot(SwarmMember):
    """A member that goes by legs and measures at their ends; a method is its `step`.

    Its settings: those of a member, `leg_m` and `wall_margin_m`.

    State: that of a member, and its last step.
    """

    def __init__(self, briefing: Briefing, settings: SimpleNamespace | None = None) -> None:
        super().__init__(briefing, settings)
        self.step_m = self._planned_m = _NO_STEP
        self.pilot = LegPlanner(briefing, self.draws, margin_m=self.settings.wall_margin_m)

    def continue_leg(self, observation: Observation) -> Command | None:
        """Return the command while a leg is under way."""
        return self.pilot.continue_leg(observation)

    def learn(self, observation: Observation) -> None:
        """Take the measurement of this stop, and plan the step that follows if nothing is declared."""
        if self.pilot.was_refused(observation):
            self.give_up()
        super().learn(observation)
        self._planned_m = self.step(self.best)

    @abstractmethod
    def step(self, best: Sighting | None) -> Vector:
        """Return the next step [m], given the swarm's best if there is any; it may draw."""

    def next_leg(self, observation: Observation) -> Command:
        """Return the leg of the step; after a refused one a leg in a random direction."""
        return self.leg(observation, self.random_step() if self.pilot.was_refused(observation) else self._planned_m)

    def give_up(self) -> None:
        """Begin again from rest: the last leg could not be flown."""
        self.step_m = _NO_STEP

    def random_step(self) -> Vector:
        """Return a leg in a random direction that ends inside the room, if one is found."""
        return self.drawn_inside(lambda: rotate(np.array([self.settings.leg_m, 0.0]), self.draws.angle_rad()))

    def drawn_inside(self, draw: Callable[[], Vector]) -> Vector:
        """Return a step that ends inside the room: the first of several draws, or the last, which a wall will cut."""
        step_m = _NO_STEP
        for _ in range(N_REDRAWS):
            step_m = limit_length(draw(), self.settings.leg_m)
            if self.pilot.room.contains(tuple(self.place_m + step_m)):
                break
        return step_m

    def leg(self, observation: Observation, step_m: Vector) -> Command:
        """Return the command for a step, as far as walls allow; the step that is flown becomes the last one."""
        command = self.pilot.leg(observation, tuple(map(float, self.place_m + step_m)))
        assert command.position_world_m is not None
        self.step_m = np.array(command.position_world_m[:2]) - self.place_m
        return command


class Particle(SwarmRobot):
    """A robot that moves as a particle of a swarm.

    Its settings: those of a robot, `inertia`, `own`, `swarm`, `search_inertia`, `search_draw`, `waypoint_s` and
    `repel_m` (0: nobody repels).

    State: that of a robot, and its waypoint before any gas.
    """

    def __init__(self, briefing: Briefing, settings: SimpleNamespace | None = None) -> None:
        super().__init__(briefing, settings)
        settings = self.settings
        self.weights = SwarmWeights(inertia=settings.inertia, own=settings.own, swarm=settings.swarm)
        self.explorer = Explorer(
            self.pilot.room, self.draws, inertia=settings.search_inertia, draw=settings.search_draw,
            waypoint_s=settings.waypoint_s,
        )  # fmt: skip

    def give_up(self) -> None:
        """Begin again from rest, and with another waypoint."""
        super().give_up()
        self.explorer.forget()

    def step(self, best: Sighting | None) -> Vector:
        """Return the next step: away from who is near, to a random waypoint before any gas, else the swarm's."""
        return self.swarm_step(best, self.track)

    def swarm_step(self, best: Sighting | None, track: Callable[[Sighting], Vector]) -> Vector:
        """Return a step away from who is near; else towards a random waypoint before any gas; else the method's own.

        Args:
            best: The swarm's best.
            track: The method's step when there is a best; drawn again while it leads out of the room.
        """
        away_m = self.repelled()
        if away_m is not None:
            self.explorer.forget()
            return away_m
        if best is None:
            return self.explorer.step(self.place_m, self.now_s, self.settings.leg_m)
        self.explorer.forget()
        return self.drawn_inside(lambda: track(best))

    def track(self, best: Sighting) -> Vector:
        """Return the step of a particle drawn to its own best and the swarm's, with fresh random numbers."""
        own_m = np.array((self.own_best or best).place_m)
        draws = np.array([[self.draws.fraction() for _ in range(2)] for _ in range(2)])
        best_m = np.array(best.place_m)
        return pso_velocity(self.step_m, self.place_m, own_m, best_m, weights=self.weights, draws=draws)

    def repelled(self) -> Vector | None:
        """Return the step away from robots that are too near, if any are."""
        return repelled_velocity(
            self.step_m, self.place_m, self.others_m(), within_m=self.settings.repel_m, leg_m=self.settings.leg_m
        )


class LearnedParticle(Particle):
    """A particle with the learned parameters of the file beside its card."""

    def __init__(self, briefing: Briefing) -> None:
        super().__init__(briefing, with_learned_parameters(load_settings(briefing, self.program), self.program))
