"""Formation flight: rounds, the team's wind and best place, where to search, and when the source is found."""

import math
from collections.abc import Sequence
from types import SimpleNamespace

import numpy as np
from numpy.typing import NDArray

from gslcosim.contract.messages import Briefing, Command, Observation
from gslcosim.search.motion.commands import declaration
from gslcosim.search.motion.declaration import DeclarationGuard, Estimate, SwarmRule
from gslcosim.search.motion.leg_planner import LegPlanner
from gslcosim.search.random_stream import RandomStream
from gslcosim.search.senses.instruments import find_noses, find_vanes
from gslcosim.search.senses.stop_and_measure import MeasuredWind, TrustedWind
from gslcosim.search.swarms.formations import centre_m
from gslcosim.search.swarms.particle_swarm import Sighting
from gslcosim.search.swarms.plume_search import PlumeMemory, plan_crosswind_lanes
from gslcosim.search.swarms.radio_reports import Report, ReportedBest
from gslcosim.search.swarms.rounds import Round, Rounds
from gslcosim.search.swarms.swarm_robot import GasScale

Floats = NDArray[np.float64]

# How much of the team's wind is that of the last round; the rest is what it was before.
_NEW_WIND_FRAC = 0.5


class FormationFlight:
    """Flies one robot of a formation: it reads in step with the others and goes to its place beside them.

    Its settings: `wall_margin_m`, `hold_s` (how long each place is read), `gas_floor`, `mox_band_frac`, `calm_m_s` (a
    wind no faster has no direction), `timeout_s`, `fades_s` (of best places) and `declares`; for `found` also `near_m`,
    `near_s`, `unchanged_s` and `declare_factor` (how many times the floor the best place must have); for `met_gas` and
    `searching_centre_m` also `search_step_m`, `cast_m` and `n_casts`.

    Use `observe` with every observation, and in `decide`:

        now = self.flight.complete(observation)
        if now is None:
            return self.flight.wait(observation)
        ...
        return self.flight.step(observation, target_m)

    State: the rounds, the pilot, the team's wind, its best place, the plume's memory, and what was declared.

    Held by:
        tests/unit/search/swarms/test_formation_flight.py
    """

    def __init__(self, briefing: Briefing, settings: SimpleNamespace) -> None:
        """Join the team of a briefing."""
        s = self.settings = settings
        nose, vane = find_noses(briefing)[0], next(iter(find_vanes(briefing)), None)
        smell = GasScale(nose, floor=s.gas_floor, band_frac=s.mox_band_frac)
        self.rounds = Rounds(briefing, nose, vane, amount=smell.amount, timeout_s=s.timeout_s, window_s=s.hold_s)
        self.pilot = LegPlanner(briefing, RandomStream(briefing.seed), margin_m=s.wall_margin_m)
        self.room, self.height_m = self.pilot.room, self.pilot.height_m
        self.wind = TrustedWind(threshold_m_s=s.calm_m_s)
        self.best: Sighting | None = None
        self._wind_m_s = np.zeros(2)
        self._memory: PlumeMemory | None = None
        # What was refused while it waits: the answer to a wait says nothing of the leg any more.
        self._notice: str | None = None
        self._rule: SwarmRule | None = None
        self._declared = DeclarationGuard()

    @property
    def index(self) -> int:
        """The robot's slot: its place among the sorted names of all members."""
        return self.rounds.index

    @property
    def n_members(self) -> int:
        """Number of robots of the team at the start."""
        return self.rounds.n_members

    @property
    def upwind_rad(self) -> float:
        """Direction from which the team's wind last came; 0 as long as it never had one [rad]."""
        return self.wind.upwind_rad or 0.0

    def observe(self, observation: Observation) -> None:
        """Take note of an observation, whether or not it asks."""
        self.rounds.observe(observation)
        self._notice = observation.notice or self._notice

    def complete(self, observation: Observation, numbers: Sequence[float] = ()) -> Round | None:
        """Return the round's reports when all have read; until then answer with `wait`."""
        if self.pilot.is_busy(observation):
            return None
        best = None if self.best is None else self.best.faded(observation.time_s, self.settings.fades_s)
        reported = None if best is None else ReportedBest(position_m=(*best.place_m, self.height_m), amount=best.amount)
        now = self.rounds.complete(observation, numbers, best=reported)
        if now is not None:
            self._learn(now, observation.time_s)
        return now

    def wait(self, observation: Observation) -> Command:
        """Return the command that waits for the others, or for the own leg to end."""
        return self.pilot.stay(observation) if self.pilot.is_busy(observation) else self.rounds.wait(observation)

    def slots_of(self, now: Round) -> list[int]:
        """Return the slots of the robots of a round, in its order."""
        return [self.rounds.team.members.index(name) for name in now.names]

    def centre_of(self, now: Round, offsets_m: Floats) -> Floats:
        """Return the formation's centre (2,) [m], by where the robots of a round are and where they belong.

        Args:
            now: The round.
            offsets_m: (n_members, 2) slots in world axes, by sorted names [m].
        """
        return centre_m(now.positions_m, offsets_m[self.slots_of(now)])

    def searching_centre_m(self, here_m: Floats, *, lane_m: float, inset_m: float) -> Floats:
        """Return where a formation without gas goes from its centre (2,): about where gas was, else along lanes [m]."""
        return self._plume_memory(lane_m, inset_m).next_place_m(here_m)

    def met_gas(self, here_m: Floats, *, lane_m: float, inset_m: float) -> None:
        """Take note that the formation has gas; when it is lost, the search begins here."""
        self._plume_memory(lane_m, inset_m).met_gas(here_m, self.upwind_rad)

    def found(self, now: Round, time_s: float) -> Estimate | None:
        """Return where the source is if the swarm's rule says so and it was not said yet; call it every round."""
        s = self.settings
        if self.best is None or not s.declares or self.best.amount < s.declare_factor * s.gas_floor:
            return None
        if self._rule is None:
            self._rule = SwarmRule(radius_m=s.near_m, near_s=s.near_s, unchanged_s=s.unchanged_s)
        members_m = [(float(x), float(y)) for x, y in now.positions_m]
        return self._declared.passes(self._rule.add(time_s, self.best.place_m, members_m))

    def new(self, estimate: Estimate | None) -> Estimate | None:
        """Return an estimate of the method's own if it is to be declared and was not yet."""
        return self._declared.passes(estimate) if self.settings.declares else None

    def declare(self, observation: Observation, estimate: Estimate) -> Command:
        """Return the command that declares the source; the others hear the last report with it, as with a step."""
        x_m, y_m = estimate.position_m[:2]
        said = declaration(observation, (x_m, y_m, self.height_m), estimate.confidence)
        return said.model_copy(update={"outgoing": self.rounds.call(), "hold_s": self.settings.hold_s})

    def step(self, observation: Observation, target_m: Sequence[float] | Floats) -> Command:
        """Return the leg to a place, or as near to it as the room allows; another one where that was refused."""
        inside_m = self.room.nearest([float(x) for x in target_m[:2]])
        noted = observation.model_copy(update={"notice": self._notice})
        self._notice = None
        leg = self.pilot.leg(noted, inside_m, hold_s=self.settings.hold_s)
        return leg.model_copy(update={"outgoing": self.rounds.call()})

    def _plume_memory(self, lane_m: float, inset_m: float) -> PlumeMemory:
        if self._memory is None:
            s = self.settings
            lanes_m = plan_crosswind_lanes(self.room, self.upwind_rad, lane_m, inset_m=inset_m)
            self._memory = PlumeMemory(lanes_m, step_m=s.search_step_m, cast_m=s.cast_m, n_casts=s.n_casts)
        return self._memory

    def _learn(self, now: Round, time_s: float) -> None:
        share = _NEW_WIND_FRAC if self._wind_m_s.any() else 1.0
        self._wind_m_s = (1.0 - share) * self._wind_m_s + share * np.array(now.mean_wind_m_s)
        x_m_s, y_m_s = (float(v) for v in self._wind_m_s)
        self.wind.add(MeasuredWind(speed_m_s=math.hypot(x_m_s, y_m_s), upwind_rad=math.atan2(-y_m_s, -x_m_s)))
        known = [sighting for report in now.reports.values() for sighting in _sightings(report)]
        known += [] if self.best is None else [self.best]
        faded = [sighting.faded(time_s, self.settings.fades_s) for sighting in known]
        most = max(faded, key=lambda sighting: sighting.amount, default=None)
        self.best = most if most is not None and most.amount > self.settings.gas_floor else None


# What a report says of gas at places: its own reading, and the best place that it knows of.
def _sightings(report: Report) -> list[Sighting]:
    sightings = [Sighting((report.position_m[0], report.position_m[1]), report.amount, report.time_s)]
    best = report.best
    if best is None:
        return sightings
    return [*sightings, Sighting((best.position_m[0], best.position_m[1]), best.amount, report.time_s)]
