"""What searches with a belief over the floor share: findings, winds, the next leg, declaration and publication."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gslcosim.contract.messages import Briefing, Command, Observation
from gslcosim.search.bayes.source_goals import GoalFlights, best_goal, coarser, expected_information_bits, mass_around
from gslcosim.search.beliefs import BeliefPublisher
from gslcosim.search.draws import Draws
from gslcosim.search.grids import CellGrid
from gslcosim.search.moving.declaring import Declared, Estimate, by_variance
from gslcosim.search.moving.flying import declaration
from gslcosim.search.moving.leash import Leash
from gslcosim.search.moving.map_flights import MapFlights
from gslcosim.search.reactive.surging import surge_place_m
from gslcosim.search.senses.gas_evidence import Finding, GasEvidence
from gslcosim.search.senses.instruments import Nose, noses_of, vane_of
from gslcosim.search.senses.measuring import MeasuredWind, TrustedWind
from gslcosim.search.senses.wind_field import WindField, WindRecord

Array = NDArray[np.float64]
# Plans are made on cells no finer than this: finer ones cost time and change no leg.
PLAN_CELL_M = 0.5
# The wind of a surge is the mean of about this long.
_SURGE_WIND_S = 3.0


@dataclass(frozen=True, kw_only=True)
class BeliefSearchSettings:
    """Settings that searches with a belief share; each card tells their values and where they come from. Those with a
    default here are not in the card of every method.

    `cell_m` and `max_cells` make the grid, `wall_margin_m` and `clearance_m` say where to fly, `step_m` is the longest
    leg. `planner` is `maximum` (the likeliest place), `information` (what tells most and where the source is likely,
    for the way there) or `moth` (a surge upwind for `surge_s` after gas, else as `information`). A visit tells of a
    square with half the edge `visit_m`, and every way costs `near_m` more than its length. After gas in the last
    `surge_s` legs end with `hold_s` (absent: the briefing's), else with `explore_hold_s`. `finding_s` is the span of a
    finding and `gas_threshold_ppm` what counts in it; `wind_threshold_m_s` is the least wind with a direction.
    `wind_step_s` and `window_s` make the record of the wind; `wind` is `uniform` or `measured`, the latter holds
    within `wind_reach_m`. `declare_variance_m2` is the width of a belief that is declared.
    After `leash_legs` legs within `leash_m` the place is rejected.
    """

    cell_m: float
    max_cells: int
    wall_margin_m: float
    clearance_m: float
    step_m: float
    visit_m: float
    surge_s: float
    hold_s: float | None
    explore_hold_s: float
    finding_s: float
    gas_threshold_ppm: float
    wind_threshold_m_s: float
    wind_step_s: float
    window_s: float
    planner: str = "moth"
    near_m: float = 2.0
    wind: str = "uniform"
    wind_reach_m: float = 1.5
    declare_variance_m2: float = 0.5
    leash_legs: int = 20
    leash_m: float = 1.5

    @classmethod
    def of(cls, settings: object) -> "BeliefSearchSettings":
        """Return this part of a method's settings."""
        names = cls.__dataclass_fields__
        return cls(**{name: getattr(settings, name) for name in names if hasattr(settings, name)})


class BeliefSearch:
    """The part of a search with a belief that does not depend on how the belief is made.

    Call `observe` with every observation: it returns what was found, for the method to learn from. At a question call
    `answer` with the belief and a way to the next leg.

    State: that of its parts.

    Held by:
        tests/unit/search/bayes/test_belief_search.py
    """

    def __init__(self, briefing: Briefing, settings: BeliefSearchSettings, *, nose: Nose | None = None) -> None:
        """Begin without findings and wind; without a nose the briefing's first gas sensor is used."""
        self.settings = settings
        self.flights = MapFlights(
            briefing,
            Draws(briefing.seed),
            cell_m=settings.cell_m,
            max_cells=settings.max_cells,
            clearance_m=settings.clearance_m,
            margin_m=settings.wall_margin_m,
        )
        self.grid, self.free = self.flights.grid, self.flights.free
        self.height_m = briefing.search_height_m
        self.goals = GoalFlights(self.flights, step_m=settings.step_m)
        self.evidence = GasEvidence(
            nose or noses_of(briefing)[0], every_s=settings.finding_s, threshold_ppm=settings.gas_threshold_ppm
        )
        n_steps = max(1, round(settings.window_s / settings.wind_step_s))
        self.winds = WindRecord(vane_of(briefing), step_s=settings.wind_step_s, n_steps=n_steps)
        self.field = WindField(self.grid, reach_m=settings.wind_reach_m) if settings.wind == "measured" else None
        self._publisher, self._declared = BeliefPublisher(), Declared()
        self._trusted = TrustedWind(threshold_m_s=settings.wind_threshold_m_s)
        self._leash = Leash(n_legs=settings.leash_legs, radius_m=settings.leash_m)
        self._rejected_m: tuple[float, float] | None = None

    def observe(self, observation: Observation) -> Finding | None:
        """Record the wind; return what was found in the span that ends now, if the wind is known by now."""
        n_steps = self.winds.n_steps_ever
        self.winds.add(observation)
        if self.field is not None and self.winds.n_steps_ever > n_steps:
            x_m, y_m, u_m_s, v_m_s = self.winds.latest()
            self.field.add((x_m, y_m), (u_m_s, v_m_s))
        finding = self.evidence.add(observation)
        return finding if self.winds.n_steps_ever else None

    def answer(
        self, observation: Observation, p: Array, found: Estimate | None, next_leg: Callable[[], Command]
    ) -> Command:
        """Return the command: the leg under way, a declaration, or the next leg; with the belief, if it is time.

        A place is declared only when the vehicle is there; see `take_rejected` for what follows.

        Args:
            observation: The question.
            p: The belief, of the grid's shape, for publication.
            found: Where the source is, if the belief has drawn together.
            next_leg: Gives the next leg otherwise.
        """
        if self.flights.pilot.is_busy(observation):
            return self.flights.pilot.stay(observation)
        belief = self._publisher.message(observation, p, self.grid, height_m=self.height_m)
        self._leash.note(observation.position_world_m)
        if self._leash.is_wound_up:
            self._leash.release()
            self._rejected_m = (observation.position_world_m[0], observation.position_world_m[1])
        return self._answer(observation, found, next_leg).model_copy(update={"belief": belief})

    def _answer(self, observation: Observation, found: Estimate | None, next_leg: Callable[[], Command]) -> Command:
        self.goals.note_refusal(observation)
        if found is None:
            return next_leg()
        x_m, y_m = found.position_m[:2]
        is_there = math.dist((x_m, y_m), observation.position_world_m[:2]) <= self.settings.visit_m
        if not is_there and not self.flights.pilot.was_refused(observation):
            return self.goals.leg(observation, (x_m, y_m))
        self._rejected_m = (x_m, y_m)
        if self._declared.passes(found) is None:
            return next_leg()
        return declaration(observation, (x_m, y_m, self.height_m), found.confidence)

    def take_rejected(self) -> tuple[float, float] | None:
        """Return, once, a place that was declared, or at which the vehicle has been for long, though the run goes on.

        Where nearness counts the source would have been found, and where a declaration counts the run would have ended:
        it is not there.
        """
        rejected_m, self._rejected_m = self._rejected_m, None
        return rejected_m

    def is_tracking(self, observation: Observation) -> bool:
        """Return whether gas was met so lately that the plume is to be followed."""
        return self.evidence.since_hit_s(observation.time_s) <= self.settings.surge_s

    def next_leg(
        self, observation: Observation, p: Array, chance: Array | None, *, trace_m: tuple[float, float] | None = None
    ) -> Command:
        """Return the next step: along the plume or upwind soon after gas, else towards the best goal.

        Args:
            observation: The question.
            p: The belief, of the grid's shape.
            chance: Chance to detect gas of a source at each offset, on `plan_grid`; see `expected_information_bits`.
            trace_m: Where to go soon after gas, in place of a step upwind.
        """
        is_tracking = self.is_tracking(observation)
        if is_tracking and self.settings.planner == "moth":
            surge_m = trace_m or self.surge_m(observation)
            if surge_m is not None and self.flights.pilot.is_worth_it(observation, surge_m):
                return self.flights.pilot.leg(observation, surge_m, hold_s=self.settings.hold_s)
        hold_s = self.settings.hold_s if is_tracking else self.settings.explore_hold_s
        return self.goals.leg(observation, self.goal_m(observation, p, chance), hold_s=hold_s)

    def drawn_together(self, p: Array) -> Estimate | None:
        """Return where the source is once the belief is as narrow as the settings ask for."""
        return by_variance(p, self.grid, limit_m2=self.settings.declare_variance_m2, radius_m=self.settings.visit_m)

    def goal_m(self, observation: Observation, p: Array, chance: Array | None) -> tuple[float, float]:
        """Return where to go, by the planner of the settings, world frame [m]."""
        here_m = observation.position_world_m
        if self.settings.planner == "maximum" or chance is None:
            return best_goal(p, self.grid, self.goals.goals, here_m, near_m=math.inf)
        coarse, plan_grid = coarser(p, self.grid, least_cell_m=PLAN_CELL_M)
        likely = mass_around(coarse, round(self.settings.visit_m / plan_grid.cell_m))
        worth = expected_information_bits(coarse, chance) + likely
        allowed, _ = coarser(self.goals.goals.astype(np.float64), self.grid, least_cell_m=PLAN_CELL_M)
        least_m = 0.5 * self.settings.step_m
        return best_goal(worth, plan_grid, allowed > 0.0, here_m, near_m=self.settings.near_m, least_m=least_m)

    @property
    def plan_grid(self) -> CellGrid:
        """The cells on which plans are made."""
        return coarser(np.zeros(self.grid.shape), self.grid, least_cell_m=PLAN_CELL_M)[1]

    def surge_m(self, observation: Observation) -> tuple[float, float] | None:
        """Return the place a step upwind, world frame [m]; None while no wind is known."""
        upwind_rad, here_m = self.upwind_rad(), observation.position_world_m
        return None if upwind_rad is None else surge_place_m(here_m, None, upwind_rad, self.settings.step_m)

    def recent_wind_m_s(self) -> tuple[float, float]:
        """Return the mean wind of the last seconds, world frame [m/s]: where the air goes; 0 before it is known."""
        n_steps = max(1, round(_SURGE_WIND_S / self.settings.wind_step_s))
        winds_m_s = self.winds.winds_m_s()[-n_steps:]
        if not len(winds_m_s):
            return 0.0, 0.0
        u_m_s, v_m_s = winds_m_s.mean(axis=0).tolist()
        return u_m_s, v_m_s

    def upwind_rad(self) -> float | None:
        """Return where the wind of the last seconds comes from, in calm air the last one before [rad]; None so far."""
        u_m_s, v_m_s = self.recent_wind_m_s()
        self._trusted.add(MeasuredWind(speed_m_s=math.hypot(u_m_s, v_m_s), upwind_rad=math.atan2(-v_m_s, -u_m_s)))
        return self._trusted.upwind_rad
