"""Agents with a belief over the floor: findings, wind, goals worth their way, and declarations at the place.

Held by:
    extensions/search/tests/unit/bayes/test_belief_search.py
"""

import math
from abc import abstractmethod
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
from numpy.typing import NDArray

from gslcosim.agent_kit import Briefing, Command, Observation
from gslcosim_search import elementary
from gslcosim_search.bayes import puff_tracing
from gslcosim_search.bayes.puff_tracing import PuffModel, SourceMap, displacements_m, footprint
from gslcosim_search.beliefs import CellGrid, distances_m
from gslcosim_search.elementary import distance, norm2
from gslcosim_search.motion.declaration import Estimate, by_variance
from gslcosim_search.motion.grid_paths import Free, shortest_path
from gslcosim_search.motion.legs import StuckDetector, step_towards_m
from gslcosim_search.motion.map_navigation import MapNavigator
from gslcosim_search.random_stream import RandomStream
from gslcosim_search.reactive.cast_and_surge import surge_end_m
from gslcosim_search.search_agent import SearchAgent, extract_settings
from gslcosim_search.senses.hit_detection import Finding, GasEvidence
from gslcosim_search.senses.instruments import Nose, find_noses, find_vane
from gslcosim_search.senses.stop_and_measure import MeasuredWind, TrustedWind
from gslcosim_search.senses.wind_field import WindField, WindRecord

Array = NDArray[np.float64]
Point = tuple[float, float]
# The last bits of a Fourier transform decide nothing: places that are equally good tie on every machine.
_DIGITS = 9
# Plans are made on cells no finer than this: finer ones cost time and change no leg.
PLAN_CELL_M = 0.5
# The wind of a surge is the mean of about this long.
_SURGE_WIND_S = 3.0


def mass_around(p: Array, reach_cells: int) -> Array:
    """Return the probability within a square about each cell, `reach_cells` to each side; beyond the grid is none."""
    for axis in range(2):
        n = p.shape[axis]
        running = np.concatenate([np.zeros_like(np.take(p, [0], axis)), np.cumsum(p, axis=axis)], axis=axis)
        centre = np.arange(n)
        last, first = np.minimum(centre + reach_cells + 1, n), np.maximum(centre - reach_cells, 0)
        p = np.take(running, last, axis) - np.take(running, first, axis)
    return p


def expected_information_bits(p: Array, chance: Array) -> Array:
    """Return the expected information of the next detection or its absence, for a sensor in each cell.

    I(x) = h(sum over s of p(s) F(s - x)) - sum over s of p(s) h(F(s - x)),  h(q) = -q log2 q - (1 - q) log2(1 - q)
    [bit]; F(o) chance that gas is detected of a source at the offset o from the sensor

    The exact mutual information of source and finding, for all places at once: both sums are correlations.

    Args:
        p: (nx, ny) belief, sum 1.
        chance: (2 nx - 1, 2 ny - 1) F by offset in cells; the middle is a source in the sensor's own cell.

    Returns:
        (nx, ny), none negative, to 1e-9 bit.

    Source:
        Shannon 1948; as a plan for a sensor: infotaxis (Vergassola et al. 2007) for a whole room and one finding.
    Held by:
        extensions/search/tests/unit/bayes/test_belief_search.py (against its definition, sum by sum)
    """
    shape = tuple(3 * n - 2 for n in p.shape)
    spectrum = np.fft.rfft2(p, shape)
    detected = np.clip(_correlated(spectrum, chance, shape, p.shape), 0.0, 1.0)
    left = _correlated(spectrum, _binary_entropy_bits(chance), shape, p.shape)
    gain: Array = np.maximum(_binary_entropy_bits(detected) - left, 0.0)
    return np.round(gain, _DIGITS)


def choose_goal(
    worth: Array, grid: CellGrid, goals: Free, here_m: Sequence[float], *, near_m: float, least_m: float = 0.0
) -> Point:
    """Return the goal of the greatest worth for the way to it.

    argmax over c of w(c) / (|c - x| + n)        n the way that every visit costs, however near [m]

    Of equally good ones the first in the order of the grid is taken.

    Args:
        worth: w, of the grid's shape.
        goals: Cells that may be a goal; at least one.
        here_m: Where the vehicle is, x, world frame [m].
        near_m: n [m]; infinite: the way does not count.
        least_m: Goals nearer than this do not count, where there are others [m].

    Source:
        Probability per cost, as in search theory (Stone 1975, Theory of Optimal Search).
    """
    lengths_m = distances_m(grid, here_m)
    per_metre = worth if math.isinf(near_m) else worth / (lengths_m + near_m)
    far = goals & (lengths_m >= least_m)
    i, j = np.unravel_index(int(np.where(far if far.any() else goals, per_metre, -1.0).argmax()), grid.shape)
    x_m, y_m = grid.centre_m((int(i), int(j)))
    return x_m, y_m


def coarsen_belief(p: Array, grid: CellGrid, *, least_cell_m: float) -> tuple[Array, CellGrid]:
    """Return a belief on the finest coarser cells whose edge is at least that long [m], whole blocks of old ones."""
    n = max(1, math.ceil(least_cell_m / grid.cell_m - 1e-9))
    shape = tuple(math.ceil(size / n) for size in grid.shape)
    padded = np.pad(p, [(0, n * blocks - size) for blocks, size in zip(shape, grid.shape, strict=True)])
    summed = padded.reshape(shape[0], n, shape[1], n).sum(axis=(1, 3))
    return summed, CellGrid(grid.origin_m, grid.cell_m * n, shape)


class GoalNavigator:
    """Flies towards goals in steps, round the obstacles of a granted map, and gives up goals that are refused.

    State: the flights' pilot, and which cells were refused.
    """

    def __init__(self, flights: MapNavigator, *, step_m: float, radius_m: float = 0.5) -> None:
        """Begin with every cell that can be flown to.

        Args:
            flights: Gives cells, ways and the pilot.
            radius_m: After a refusal no cell within so far of the goal is a goal again [m].
        """
        self.flights = flights
        self.goals: Free = flights.flyable.copy()
        self._step_m, self._radius_m = step_m, radius_m
        # Ways are compiled, or loaded from the cache on disk, before the flight.
        low_m, high_m = flights.pilot.room.min_m, flights.pilot.room.max_m
        shortest_path(flights.flyable, flights.grid, low_m[:2], high_m[:2])
        self._goal_m: Point | None = None

    def leg(self, observation: Observation, goal_m: Point, *, hold_s: float | None = None) -> Command:
        """Return the command for the next step towards a goal, world frame [m]."""
        self._goal_m = goal_m
        pilot, here_m = self.flights.pilot, observation.position_world_m[:2]
        path_m = shortest_path(self.flights.flyable, self.flights.grid, here_m, goal_m)
        bend_m = goal_m if path_m is None or len(path_m) < 2 else (float(path_m[1][0]), float(path_m[1][1]))
        return pilot.leg(observation, step_towards_m(here_m, bend_m, self._step_m), hold_s=hold_s)

    def is_goal(self, place_m: Sequence[float]) -> bool:
        """Return True if a place lies in a cell that may be a goal."""
        cell = self.flights.grid.cell_at(place_m)
        return cell is not None and bool(self.goals[cell])

    def note_refusal(self, observation: Observation) -> None:
        """Give up the last goal if the notice says that it could not go on; call it before the next is chosen."""
        if self._goal_m is None or not self.flights.pilot.was_refused(observation):
            return
        left = self.goals & (distances_m(self.flights.grid, self._goal_m) > self._radius_m)
        # When nothing is left the refusals are forgotten: a vehicle that moved may be let through now.
        self.goals = left if left.any() else self.flights.flyable.copy()


# sum over s of p(s) F(s - x): F's middle is the offset 0.
def _correlated(
    spectrum: NDArray[np.complex128], chance: Array, shape: tuple[int, ...], size: tuple[int, ...]
) -> Array:
    flipped = chance[::-1, ::-1]
    full = np.fft.irfft2(np.fft.rfft2(flipped, shape) * spectrum, shape)
    return full[size[0] - 1 : 2 * size[0] - 1, size[1] - 1 : 2 * size[1] - 1]


def _binary_entropy_bits(chance: Array) -> Array:
    safe = np.clip(chance, 1e-300, 1.0)
    rest = np.clip(1.0 - chance, 1e-300, 1.0)
    return -(safe * elementary.log2_each(safe) + rest * elementary.log2_each(rest))


@dataclass(frozen=True, kw_only=True)
class BeliefSearchSettings:
    """Settings that searches with a belief share; each card gives their values and where they come from. Those with a
    default here are not in the card of every method.

    `cell_m` and `max_cells` make the grid, `wall_margin_m` and `clearance_m` say where to fly, `step_m` is the longest
    leg. `planner` is `maximum` (the likeliest place), `information` (what yields most and where the source is likely,
    for the way there) or `moth` (a surge upwind for `surge_s` after gas, else as `information`). A visit tells of a
    square with half the edge `visit_m`, and every way costs `near_m` more than its length. After gas in the last
    `surge_s` legs end with `hold_s` (absent: the briefing's), else with `explore_hold_s`. `finding_s` is the span of a
    finding and `gas_threshold_ppm` what counts in it; `wind_threshold_m_s` is the least wind with a direction.
    `wind_step_s` and `window_s` make the record of the wind; `wind` is `uniform` or `measured`, the latter holds
    within `wind_reach_m`. `declare_variance_m2` is the width of a belief that is declared.
    After `leash_legs` legs within `leash_m` the place is rejected. Findings within `alike_m` of each other are alike.
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
    alike_m: float = 0.0


class AlikeFindings:
    """Weighs findings by how many others were made lately at the same place.

    w = 1 / (1 + n)        n of the last findings within the radius of this one

    Whether there is gas at a place hardly changes from one finding to the next: it depends on where the plume is, and
    on how the model of it is wrong there. So n findings at one place count as the sum of 1, 1/2, ... 1/n of one.

    State: the places of the last findings.

    Source:
        Ours, as in `information_agent`. For a likelihood that is raised to a power because its model is wrong: Grünwald
        and van Ommen 2017, doi:10.1214/17-BA1085.
    Held by:
        extensions/search/tests/unit/bayes/test_belief_search.py
    """

    def __init__(self, *, radius_m: float, n_remembered: int = 50) -> None:
        """Begin without findings; with a radius of 0 each finding counts fully."""
        self._radius_m = radius_m
        self._places_m: deque[tuple[float, ...]] = deque(maxlen=n_remembered)

    def weigh(self, place_m: Sequence[float]) -> float:
        """Return the weight of a finding at a place, and remember it."""
        here_m = tuple(place_m[:2])
        n = sum(distance(here_m, each_m) < self._radius_m for each_m in self._places_m)
        self._places_m.append(here_m)
        return 1.0 / (1.0 + n)


class BeliefAgent(SearchAgent):
    """An agent with a belief over the floor: it follows gas upwind, and else goes where the belief sends it.

    What was found in each span of time updates the belief on the way. A place is declared only when the vehicle is
    there. If the run goes on, and where the vehicle has been for long, the source is not there: the place is rejected,
    for where nearness counts the source would have been found.

    A method says how a finding and a rejected place change its belief, and plans its legs. Its settings: those of
    `BeliefSearchSettings`.

    State: that of its parts, and a place that is to be rejected.
    """

    def __init__(
        self, briefing: Briefing, settings: SimpleNamespace | None = None, *, nose: Nose | None = None
    ) -> None:
        """Begin without findings and wind; without a nose the briefing's first gas sensor is used."""
        super().__init__(briefing, settings)
        shared = self.shared = extract_settings(BeliefSearchSettings, self.settings)
        # The legs have a stream of their own: what they draw does not change what the method draws.
        self.flights = MapNavigator(
            briefing,
            RandomStream(briefing.seed),
            cell_m=shared.cell_m,
            max_cells=shared.max_cells,
            clearance_m=shared.clearance_m,
            margin_m=shared.wall_margin_m,
        )
        self.grid, self.free = self.flights.grid, self.flights.free
        self.goals = GoalNavigator(self.flights, step_m=shared.step_m)
        self.evidence = GasEvidence(
            nose or find_noses(briefing)[0], every_s=shared.finding_s, threshold_ppm=shared.gas_threshold_ppm
        )
        n_steps = max(1, round(shared.window_s / shared.wind_step_s))
        self.winds = WindRecord(find_vane(briefing), step_s=shared.wind_step_s, n_steps=n_steps)
        self.field = WindField(self.grid, reach_m=shared.wind_reach_m) if shared.wind == "measured" else None
        self._alike = AlikeFindings(radius_m=shared.alike_m)
        self._trusted = TrustedWind(threshold_m_s=shared.wind_threshold_m_s)
        self._stuck_detector = StuckDetector(n_legs=shared.leash_legs, radius_m=shared.leash_m)
        self._rejected_m: Point | None = None

    @property
    @abstractmethod
    def p(self) -> Array:
        """The belief, of the grid's shape."""

    @abstractmethod
    def update(self, observation: Observation, finding: Finding, weight: float) -> None:
        """Update the belief by a finding, which has a weight among others like it."""

    @abstractmethod
    def reject(self, place_m: Point) -> None:
        """Leave a place out of the belief."""

    def observe(self, observation: Observation) -> None:
        """Record the wind, and update the belief by what was found in the span that ends now."""
        super().observe(observation)
        rejected_m, self._rejected_m = self._rejected_m, None
        if rejected_m is not None:
            self.reject(rejected_m)
        n_steps = self.winds.n_steps_ever
        self.winds.add(observation)
        if self.field is not None and self.winds.n_steps_ever > n_steps:
            x_m, y_m, u_m_s, v_m_s = self.winds.latest()
            self.field.add((x_m, y_m), (u_m_s, v_m_s))
        finding = self.evidence.add(observation)
        # A finding says nothing before the wind is known.
        if finding is not None and self.winds.n_steps_ever:
            self.update(observation, finding, self._alike.weigh(finding.sensor_m))

    def continue_leg(self, observation: Observation) -> Command | None:
        """Return the command while a leg is under way."""
        return self.flights.pilot.continue_leg(observation)

    def learn(self, observation: Observation) -> None:
        """Take note of where the leg has ended, and whether its goal was refused."""
        self._stuck_detector.note(observation.position_world_m)
        if self._stuck_detector.is_stuck:
            self._stuck_detector.release()
            self._rejected_m = (observation.position_world_m[0], observation.position_world_m[1])
        self.goals.note_refusal(observation)

    def estimate(self, observation: Observation) -> Estimate | None:
        """Return the estimate of the source once the belief is as narrow as the settings require."""
        limit_m2, radius_m = self.shared.declare_variance_m2, self.shared.visit_m
        return by_variance(self.p, self.grid, limit_m2=limit_m2, radius_m=radius_m)

    def declare(self, observation: Observation, found: Estimate) -> Command | None:
        """Return the way to a place that was found; there, or where it cannot be reached, the declaration."""
        x_m, y_m = found.position_m[:2]
        is_there = distance((x_m, y_m), observation.position_world_m[:2]) <= self.shared.visit_m
        if not is_there and not self.flights.pilot.was_refused(observation):
            return self.goals.leg(observation, (x_m, y_m))
        self._rejected_m = (x_m, y_m)
        return super().declare(observation, found)

    def is_tracking(self, observation: Observation) -> bool:
        """Return True if gas was met so lately that the plume is to be followed."""
        return self.evidence.since_hit_s(observation.time_s) <= self.shared.surge_s

    def surge_or_search(
        self, observation: Observation, chance: Array | None, *, trace_m: Point | None = None
    ) -> Command:
        """Return the next step: along the plume or upwind soon after gas, else towards the best goal.

        Args:
            chance: Chance to detect gas of a source at each offset, on `plan_grid`; see `expected_information_bits`.
            trace_m: Where to go soon after gas, in place of a step upwind.
        """
        is_tracking = self.is_tracking(observation)
        if is_tracking and self.shared.planner == "moth":
            surge_m = trace_m or self.surge_m(observation)
            if surge_m is not None and self.flights.pilot.is_worth_it(observation, surge_m):
                return self.flights.pilot.leg(observation, surge_m, hold_s=self.shared.hold_s)
        hold_s = self.shared.hold_s if is_tracking else self.shared.explore_hold_s
        return self.goals.leg(observation, self.goal_m(observation, chance), hold_s=hold_s)

    def goal_m(self, observation: Observation, chance: Array | None) -> Point:
        """Return the next goal, from the planner of the settings, world frame [m]."""
        here_m, p, shared = observation.position_world_m, self.p, self.shared
        if shared.planner == "maximum" or chance is None:
            return choose_goal(p, self.grid, self.goals.goals, here_m, near_m=math.inf)
        coarse, plan_grid = coarsen_belief(p, self.grid, least_cell_m=PLAN_CELL_M)
        likely = mass_around(coarse, round(shared.visit_m / plan_grid.cell_m))
        worth = expected_information_bits(coarse, chance) + likely
        allowed, _ = coarsen_belief(self.goals.goals.astype(np.float64), self.grid, least_cell_m=PLAN_CELL_M)
        least_m = 0.5 * shared.step_m
        return choose_goal(worth, plan_grid, allowed > 0.0, here_m, near_m=shared.near_m, least_m=least_m)

    @property
    def plan_grid(self) -> CellGrid:
        """The cells on which plans are made."""
        return coarsen_belief(np.zeros(self.grid.shape), self.grid, least_cell_m=PLAN_CELL_M)[1]

    def surge_m(self, observation: Observation) -> Point | None:
        """Return the place a step upwind, world frame [m]; None while no wind is known."""
        upwind_rad, here_m = self.upwind_rad(), observation.position_world_m
        return None if upwind_rad is None else surge_end_m(here_m, None, upwind_rad, self.shared.step_m)

    def recent_wind_m_s(self) -> tuple[float, float]:
        """Return the mean wind of the last seconds, world frame [m/s]: where the air goes; 0 before it is known."""
        n_steps = max(1, round(_SURGE_WIND_S / self.shared.wind_step_s))
        winds_m_s = self.winds.winds_m_s()[-n_steps:]
        if not len(winds_m_s):
            return 0.0, 0.0
        u_m_s, v_m_s = winds_m_s.mean(axis=0).tolist()
        return u_m_s, v_m_s

    def upwind_rad(self) -> float | None:
        """Return the upwind direction of the last seconds [rad]; in calm air the last known one, or None."""
        u_m_s, v_m_s = self.recent_wind_m_s()
        self._trusted.add(MeasuredWind(speed_m_s=norm2(u_m_s, v_m_s), upwind_rad=elementary.atan2(-v_m_s, -u_m_s)))
        return self._trusted.upwind_rad


class SourceBeliefAgent(BeliefAgent):
    """An agent whose belief is a `SourceMap`: a subclass says what a finding teaches and where it goes next.

    Its settings: those of a `BeliefAgent`, and floor_frac.
    """

    def __init__(self, briefing: Briefing) -> None:
        """Begin with an even belief over free cells, and compile what runs in flight."""
        super().__init__(briefing)
        puff_tracing.warm_up()
        self.map = SourceMap(self.grid, free=self.free, floor_frac=self.settings.floor_frac)

    @property
    def p(self) -> Array:
        """The probability of each cell to hold the source."""
        return self.map.probability()

    def reject(self, place_m: Point) -> None:
        """Leave the surroundings of a place out of the map."""
        self.map.reject(place_m, self.settings.visit_m)

    def chance(self, observation: Observation, model: PuffModel) -> Array:
        """Return the chance to detect gas of a source at each offset, in the wind of late."""
        plan_grid = self.plan_grid
        travelled_m = displacements_m(self.winds, model, observation.position_world_m)
        return footprint(model, travelled_m, plan_grid.cell_m, plan_grid.shape)


class PuffTracingAgent(SourceBeliefAgent):
    """Traces each finding back with the wind; goes upwind after gas, else where that tells most.

    Its settings: those of a `SourceBeliefAgent`, wind_step_s, window_s, initial_sigma_m, spread_m_sqrt_s,
    detection_probability and sensed_m2.
    """

    def __init__(self, briefing: Briefing) -> None:
        super().__init__(briefing)
        self.model = replace(extract_settings(PuffModel, self.settings), step_s=self.settings.wind_step_s)

    def update(self, observation: Observation, finding: Finding, weight: float) -> None:
        """Trace the finding back to where its puff may have come from."""
        travelled_m = displacements_m(self.winds, self.model, finding.sensor_m, field=self.field)
        puff_tracing.update(self.map, self.model, finding.sensor_m, travelled_m, is_hit=finding.is_hit, weight=weight)

    def next_leg(self, observation: Observation) -> Command:
        """Return a leg upwind soon after gas, else one to where a finding tells most."""
        return self.surge_or_search(observation, self.chance(observation, self.model))
