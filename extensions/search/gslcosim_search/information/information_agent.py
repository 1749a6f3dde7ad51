"""Information-driven agents: a belief on a grid, stops where an objective is best, and a class for each objective.

Held by:
    extensions/search/tests/agents/test_information_agents.py
    extensions/search/tests/unit/information/test_information_agent.py
"""

import math
from abc import abstractmethod
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from gslcosim.agent_kit import Briefing, Command, Observation, commands
from gslcosim_search import beliefs, elementary
from gslcosim_search.bayes.encounter_model import EncounterModel, PlumeAssumption, likelihoods, nominal_dispersal
from gslcosim_search.beliefs import CellGrid
from gslcosim_search.elementary import distance, norm2
from gslcosim_search.information.objectives import (
    Candidates,
    MoveTree,
    Predictions,
    SurpriseMonitor,
    dual_control_cost,
    entrotaxis_cost,
    find_min_cost_index,
    flatten_belief,
    free_energy_cost,
    information_gain_cost,
    infotaxis_cost,
    n_step_costs,
    predict_stops,
    renyi_cost,
    space_aware_cost,
    update_belief,
)
from gslcosim_search.motion.declaration import Estimate, by_entropy, by_mass
from gslcosim_search.motion.legs import LegSpace, to_millimetre
from gslcosim_search.occupancy import OccupancyMap, free_cells
from gslcosim_search.search_agent import SearchAgent
from gslcosim_search.senses.hit_detection import Finding, GasEvidence
from gslcosim_search.senses.instruments import find_noses, find_vane
from gslcosim_search.senses.wind_field import WindRecord

Array = NDArray[np.float64]
Place = tuple[float, ...]

# What a cell keeps of its probability when the vehicle has passed it and the run goes on.
_PASSED_WEIGHT = 0.1
_WIND_STEP_S = 1.0
# How many of the last findings make others at the same place weigh less.
_N_SMELLED = 50
# A refused end is not tried again from anywhere so near to it.
_REFUSED_RADIUS_M = 0.25
# Directions that agree less than this say nothing about how far the wind wanders.
_WIDEST_SPREAD_RAD = 1.5
# A leg keeps this far from what a map shows as solid.
_CLEARANCE_M = 0.3


@dataclass(frozen=True, kw_only=True, eq=False)
class PlanningContext:
    """Planning context before a step: belief, reachable places, and what stops there would find.

    Args:
        p: (c,) the belief, flat.
        cells_m: (c, d) centres of its cells, world frame [m].
        cell_m: Edge of a cell [m].
        here_m: Where the searcher is, d numbers [m].
        places_m: (m, d) where the next stop may be [m].
        novelty: (m,) 1 where nothing was found out near a place yet, and 1 / (1 + n) after n findings.
        step_m: Length of a step [m].
        survey: Returns what stops at places would find: a hit, or none.
        neighbours: Returns where a step from a place may end, the place itself first.
    """

    p: Array
    cells_m: Array
    cell_m: float
    here_m: Place
    places_m: Array
    novelty: Array
    step_m: float
    survey: Callable[[Sequence[Place]], Candidates]
    neighbours: Callable[[Place], list[Place]]

    @property
    def cells_per_step(self) -> float:
        """Number of cells in a square or cube of the size of a step."""
        return max(1.0, math.prod([self.step_m / self.cell_m] * self.cells_m.shape[1]))

    @property
    def mean_m(self) -> Place:
        """Mean of the belief [m]."""
        return tuple(float(x) for x in elementary.product(self.p, self.cells_m))

    def predict(self, *, alpha: float = 0.0) -> Predictions:
        """Return the predictions for the next stop, with and without a hit; see `objectives.predict_stops`."""
        return predict_stops(self.p, self.survey([tuple(place) for place in self.places_m]), alpha=alpha)

    def tree(self, depth: int) -> MoveTree:
        """Return all places within so many steps, each surveyed once."""
        numbers: dict[Place, int] = {}
        rows: list[list[int]] = []
        frontier: Iterable[Place] = [_key(place) for place in self.places_m]
        start = [numbers.setdefault(place, len(numbers)) for place in frontier]
        for level in range(1, depth + 1):
            known = list(numbers)
            for place in known[len(rows) :]:
                following = [_key(end) for end in self.neighbours(place)] if level < depth else []
                rows.append([numbers.setdefault(end, len(numbers)) for end in following])
        return MoveTree(candidates=self.survey(list(numbers)), moves=rows, start=start)


@dataclass(kw_only=True)
class _Memory:
    # What changes in flight.
    p: Array
    passed: NDArray[np.bool_]
    findings: list[Finding] = field(default_factory=list[Finding])
    marked_m: Place | None = None
    aimed_m: Place | None = None
    smelled_m: list[Place] = field(default_factory=list[Place])
    refused_m: list[Place] = field(default_factory=list[Place])


class InformationAgent(SearchAgent):
    """An agent that keeps a belief on a grid and stops next where its objective is best.

    It goes to the place of least cost among the ends of steps in equal directions, and here. The objective of a method
    is its `costs`; `dimensions` is 2 for a search at the briefing's search height, 3 in the volume.

    Its settings: cell_m, step_m, n_headings, climb_m (in space), stop_s, wall_margin_m, threshold_ppm, floor, power,
    hits_at_1m, diffusivity_m2_s, lifetime_s, detector_m, wind_memory_s, correlation_s, arrival, declares, radius_m,
    mass, entropy_bits, monitor_stops, and those of its objective.

    State: the belief; which cells were passed; the wind of the last seconds; findings not yet taken in; refused ends;
    what was declared; the surprise of the last stops.
    """

    dimensions: ClassVar[Literal[2, 3]] = 2

    def __init__(self, briefing: Briefing, settings: SimpleNamespace | None = None) -> None:
        """Begin with an even belief over free cells, and warm up a decision so that nothing compiles in flight."""
        super().__init__(briefing, settings)
        settings, dimensions = self.settings, self.dimensions
        self.grid = CellGrid.covering(briefing.bounds, settings.cell_m, dimensions)
        self._cells_m = self.grid.centres_m()
        self._room = _room_of(briefing, settings.wall_margin_m, dimensions)
        self._arrival_m = arrival_radius_m(briefing) if settings.arrival == "by_mission" else 0.0
        self._evidence = GasEvidence(
            find_noses(briefing)[0], every_s=settings.stop_s, threshold_ppm=settings.threshold_ppm
        )
        self._winds = WindRecord(
            find_vane(briefing), step_s=_WIND_STEP_S, n_steps=max(1, round(settings.wind_memory_s / _WIND_STEP_S))
        )
        self._dispersal = assumed_dispersal(briefing, settings, dimensions)
        self._monitor = SurpriseMonitor(n_stops=settings.monitor_stops)
        free = free_cells(briefing.known_map, self.grid)
        p = beliefs.normalised(free.reshape(-1).astype(np.float64))
        self._memory = _Memory(p=p, passed=np.zeros(self.grid.n_cells, np.bool_))
        self.costs(self.build_context(self._room.nearest(self._cells_m.mean(axis=0))))

    @property
    def p(self) -> Array:
        """The belief, in the grid's shape."""
        return self._memory.p.reshape(self.grid.shape)

    @abstractmethod
    def costs(self, context: PlanningContext) -> Array:
        """Return the cost of a stop at each place by the method's objective; the least is best."""

    def observe(self, observation: Observation) -> None:
        """Take note of wind and gas on the way; calling it again for the same tick does no harm."""
        super().observe(observation)
        self._winds.add(observation)
        finding = self._evidence.add(observation)
        if finding is not None:
            self._memory.findings.append(finding)
        self._mark_passed(self._point(observation))

    def next_leg(self, observation: Observation) -> Command:
        """Return the way to the stop of least cost."""
        context = self.build_context(self._point(observation))
        best_m = context.places_m[find_min_cost_index(self.costs(context))]
        self._memory.aimed_m = tuple(float(x) for x in best_m)
        x_m, y_m, z_m = (*self._memory.aimed_m, self.height_m)[:3]
        return commands.waypoint(observation, x_m, y_m, z_m, hold_s=self.settings.hold_s)

    def build_context(self, here_m: Place) -> PlanningContext:
        """Return the planning context of a method at a position."""
        places_m = np.array(self.neighbours(here_m))
        return PlanningContext(
            p=self._memory.p,
            cells_m=self._cells_m,
            cell_m=self.grid.cell_m,
            here_m=here_m,
            places_m=places_m,
            novelty=self._novelty(places_m),
            step_m=self.settings.step_m,
            survey=self.survey,
            neighbours=self.neighbours,
        )

    def model(self) -> EncounterModel:
        """Return the encounter model in the wind of the last seconds."""
        winds_m_s = self._winds.winds_m_s()
        if not len(winds_m_s):
            return self._dispersal.model((0.0, 0.0), 0.0)
        mean = winds_m_s.mean(axis=0)
        return self._dispersal.model((float(mean[0]), float(mean[1])), direction_spread_rad(winds_m_s))

    def neighbours(self, here_m: Place) -> list[Place]:
        """Return the possible next stops: the current one, and the ends of all allowed steps that were not refused."""
        ends = [self._room.nearest(here_m)] if self.settings.may_stay else []
        for step in self._steps():
            end = tuple(to_millimetre(x + dx) for x, dx in zip(here_m, step, strict=True))
            if self._room.is_free(here_m, end) and not self._is_refused(end):
                ends.append(end)
        return ends or [self._room.nearest(here_m)]

    def survey(self, places: Sequence[Place]) -> Candidates:
        """Return the possible results of stops; where arrival ends the run, cells within reach count as found."""
        places_m = np.array(places)
        tables = likelihoods(
            self.model().log_mean_hits(places_m, self._cells_m),
            floor=self.settings.floor,
            power=self.settings.power * self._novelty(places_m),
        )
        return Candidates.within_reach(places_m, self._cells_m, tables, reach_m=self._arrival_m)

    def learn(self, observation: Observation) -> None:
        """Update the belief by what was found since the last stop; a refused end is not aimed at again."""
        memory, settings = self._memory, self.settings
        if observation.notice is not None and memory.aimed_m is not None:
            memory.refused_m.append(memory.aimed_m)
        findings, memory.findings = memory.findings, []
        if not findings:
            return
        places_m = np.array([finding.sensor_m[: self.dimensions] for finding in findings])
        log_mean = self.model().log_mean_hits(places_m, self._cells_m)
        likelihood, _, log_likelihood = likelihoods(log_mean, floor=settings.floor)
        for i, finding in enumerate(findings):
            outcome, novelty = int(finding.is_hit), float(self._novelty(places_m[i : i + 1])[0])
            predictive = (likelihood[i] * memory.p).sum(axis=1)
            memory.p = update_belief(memory.p, settings.power * novelty * log_likelihood[i, outcome])
            memory.smelled_m.append(tuple(places_m[i]))
            # What was found here before surprises nobody; the model of the plume could not know it.
            if novelty == 1.0 and self._monitor.add(predictive, outcome):
                memory.p = flatten_belief(memory.p)

    # Findings at one place are much alike: the second weighs half as much as the first, the third a third.
    def _novelty(self, places_m: Array) -> Array:
        smelled_m = np.array(self._memory.smelled_m[-_N_SMELLED:]).reshape(-1, self.dimensions)
        away_m = np.linalg.norm(places_m[:, None] - smelled_m[None], axis=2)
        return 1.0 / (1.0 + (away_m < 0.5 * self.settings.step_m).sum(axis=1))

    # The run would have ended near the source: what was passed is hardly there.
    def _mark_passed(self, point_m: Place) -> None:
        memory = self._memory
        has_moved = memory.marked_m is None or distance(point_m, memory.marked_m) > 0.5 * self.grid.cell_m
        if self._arrival_m <= 0.0 or not has_moved:
            return
        memory.marked_m = point_m
        fresh = self._near(np.array(point_m)) & ~memory.passed
        if fresh.any():
            memory.passed |= fresh
            memory.p = beliefs.normalised(np.where(fresh, _PASSED_WEIGHT * memory.p, memory.p))

    def estimate(self, observation: Observation) -> Estimate | None:
        """Return the estimate of the source once the belief is concentrated or its entropy is low."""
        settings, found = self.settings, None
        # Boxes are quicker than balls, and most beliefs fill not even one of them.
        reach = int(settings.radius_m / self.grid.cell_m + 1e-9)
        if max_box_probability(self.p, reach) > settings.mass:
            found = by_mass(self.p, self.grid, radius_m=settings.radius_m, least=settings.mass)
        return found or by_entropy(self.p, self.grid, limit_bits=settings.entropy_bits, radius_m=settings.radius_m)

    def _steps(self) -> list[Place]:
        settings = self.settings
        angles = (2.0 * math.pi * k / settings.n_headings for k in range(settings.n_headings))
        level = [(settings.step_m * elementary.cos(angle), settings.step_m * elementary.sin(angle)) for angle in angles]
        if self.dimensions == 2:
            return list(level)
        return [(*step, 0.0) for step in level] + [(0.0, 0.0, settings.climb_m), (0.0, 0.0, -settings.climb_m)]

    def _near(self, place_m: Array) -> NDArray[np.bool_]:
        return np.linalg.norm(self._cells_m - place_m, axis=1) < self._arrival_m

    def _is_refused(self, end_m: Place) -> bool:
        return any(distance(end_m, refused_m) < _REFUSED_RADIUS_M for refused_m in self._memory.refused_m)

    def _point(self, observation: Observation) -> Place:
        return observation.position_world_m[: self.dimensions]


class Infotaxis(InformationAgent):
    """Weighs nearing the source against learning where it is by one number, the entropy of its belief."""

    def costs(self, context: PlanningContext) -> Array:
        """Return the expected entropy of the belief after each stop [bit]."""
        return infotaxis_cost(context.predict())


class Infotaxis3d(Infotaxis):
    """Infotaxis with a belief over the volume: the height of the source is unknown, too."""

    dimensions = 3


class SpaceAwareInfotaxis(InformationAgent):
    """Adds the way to the source to what infotaxis weighs: its position is worth less when it is far."""

    def costs(self, context: PlanningContext) -> Array:
        """Return the expected logarithm of the steps that remain after each stop."""
        return space_aware_cost(context.predict(), step_m=context.step_m, cells_per_step=context.cells_per_step)


class Entrotaxis(InformationAgent):
    """Goes where the next reading is most uncertain, without the beliefs that would follow it."""

    def costs(self, context: PlanningContext) -> Array:
        """Return minus the entropy of the next reading at each stop [bit], less where one was made already."""
        return context.novelty * entrotaxis_cost(context.predict())


class InformationGain(InformationAgent):
    """Weighs stops by the divergence of the belief after the reading from that before it."""

    def costs(self, context: PlanningContext) -> Array:
        """Return minus the divergence that each stop is expected to cause [bit]."""
        return information_gain_cost(context.predict())


class CognitiveSearch(InformationAgent):
    """Infotaxis with another measure of a reading's worth: a Renyi divergence of beliefs, or free energy."""

    def costs(self, context: PlanningContext) -> Array:
        """Return the cost of each stop by the chosen reward."""
        settings = self.settings
        if settings.reward == "renyi":
            return renyi_cost(context.predict(alpha=settings.alpha))
        return free_energy_cost(context.predict(), step_m=context.step_m, temperature=settings.temperature)


class DualControl(InformationAgent):
    """Exploits by nearing the mean of its belief, explores by the variance that a reading would leave."""

    def costs(self, context: PlanningContext) -> Array:
        """Return squared distance to the estimate plus weighed variance [m2], more where findings were made already."""
        exploration = self.settings.exploration
        cost = dual_control_cost(context.predict(), context.places_m, context.mean_m, exploration=exploration)
        return cost / context.novelty


class NStepInfotaxis(InformationAgent):
    """Looks several stops ahead, through each outcome of each: an uninformative step may lead to an informative one."""

    def costs(self, context: PlanningContext) -> Array:
        """Return minus the entropy that each first step is expected to gain, with the best ones after it [bit]."""
        depth, discount = self.settings.depth, self.settings.discount
        return n_step_costs(context.p, context.tree(depth), depth=depth, discount=discount)


def arrival_radius_m(briefing: Briefing) -> float:
    """Return the success radius where the vehicle's arrival at one source ends the search [m]; 0 elsewhere."""
    task = briefing.task
    return task.success_radius_m if task is not None and task.goal == "source" else 0.0


def max_box_probability(p: Array, reach: int) -> float:
    """Return the most probability that any square or cube of 2 reach + 1 cells holds; no ball in one holds more.

    Args:
        p: The belief, in the grid's shape.
        reach: From the middle cell to the outer ones [cells].
    """
    sums = np.pad(p, reach)
    for axis in range(p.ndim):
        total = np.cumsum(sums, axis=axis)
        total = np.concatenate([np.zeros_like(np.take(total, [0], axis=axis)), total], axis=axis)
        n = total.shape[axis] - (2 * reach + 1)
        ahead = np.take(total, range(2 * reach + 1, 2 * reach + 1 + n), axis=axis)
        sums = ahead - np.take(total, range(n), axis=axis)
    return float(sums.max())


def assumed_dispersal(briefing: Briefing, settings: SimpleNamespace, dimensions: Literal[2, 3]) -> PlumeAssumption:
    """Return the assumed dispersal of the plume: from nominal figures where granted (K1), else from settings (K0)."""
    bounds = briefing.bounds
    room_length_m = max(high - low for low, high in zip(bounds.min_m[:2], bounds.max_m[:2], strict=True))
    known: dict[str, Any] = {"dimensions": dimensions, "room_length_m": room_length_m}
    known |= {name: getattr(settings, name) for name in ("detector_m", "correlation_s", "stop_s")}
    if briefing.plume is not None:
        return nominal_dispersal(briefing.plume, threshold_ppm=settings.threshold_ppm, **known)
    known |= {name: getattr(settings, name) for name in ("hits_at_1m", "diffusivity_m2_s", "lifetime_s")}
    return PlumeAssumption(**known)


def direction_spread_rad(winds_m_s: Array) -> float:
    """Return the circular standard deviation of the directions of winds, at most 1.5 rad.

    sd = sqrt(-2 ln r)        r length of the mean of unit vectors
    [rad] = [1]

    Args:
        winds_m_s: (n, 2) winds [m/s]; those of no speed are left out.

    Source:
        Mardia and Jupp 2000, Directional Statistics, section 2.3.
    """
    speeds = np.linalg.norm(winds_m_s, axis=1)
    units = winds_m_s[speeds > 0.0] / speeds[speeds > 0.0, None]
    if not len(units):
        return 0.0
    agreement = min(1.0, norm2(*units.mean(axis=0).tolist()))
    return min(_WIDEST_SPREAD_RAD, math.sqrt(-2.0 * elementary.log(max(agreement, 1e-6))))


def _room_of(briefing: Briefing, margin_m: float, dimensions: Literal[2, 3]) -> LegSpace:
    obstacles = None
    if briefing.known_map is not None:
        height_m = briefing.search_height_m if dimensions == 2 else None
        obstacles = OccupancyMap.of(briefing.known_map, height_m=height_m, clearance_m=_CLEARANCE_M)
    return LegSpace.within(briefing.bounds, margin_m, obstacles=obstacles)


def _key(place: Iterable[float]) -> Place:
    return tuple(to_millimetre(float(x)) for x in place)
