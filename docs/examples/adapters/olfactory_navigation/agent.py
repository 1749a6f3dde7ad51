"""Flies an agent of the package olfactory-navigation in a room, unchanged.

README.md beside this file has the rules. The package comes with the extra `olfactory`.
"""

import math
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np

from gslcosim.agent_kit import Agent, Briefing, Command, Observation, run
from gslcosim.agent_kit.commands import declaration, waypoint
from gslcosim.agent_kit.settings import load_settings
from gslcosim_search.beliefs import BeliefPublisher, CellGrid, normalised
from gslcosim_search.information.pomdp import OffsetGrid, PlumeTable, RunningWind, offsets_m
from gslcosim_search.motion.declaration import DeclarationGuard, by_mass
from gslcosim_search.motion.legs import LegSpace, to_millimetre
from gslcosim_search.random_stream import RandomStream
from gslcosim_search.senses.instruments import find_noses, find_vane
from gslcosim_search.senses.stop_and_measure import StopAndMeasure

# Frames of the movie that the package is given: a power of two, so that its shares of them sum to 1 exactly.
N_FRAMES = 256
MAX_CELLS = 20_000
Cell = tuple[int, int]


def movie_of(table: PlumeTable, grid: OffsetGrid) -> np.ndarray:
    """Return a movie (frame, across, along) in which each level of gas is met as often as the table says.

    Each level is met in one frame at least: what never happens in a model must not happen to it.
    """
    share = grid.looked_up(table.level_frac, grid.centres_m()).reshape(-1, *grid.shape).transpose(0, 2, 1)
    n_levels = len(share)
    counts = np.maximum(np.round(share * N_FRAMES).astype(int), 1)
    counts[0] = N_FRAMES - counts[1:].sum(axis=0)
    first_of_level = np.cumsum(counts, axis=0)[:-1]
    level = (np.arange(N_FRAMES)[:, None, None, None] >= first_of_level).sum(axis=1)
    return ppm_of_levels(table)[np.minimum(level, n_levels - 1)]


def ppm_of_levels(table: PlumeTable) -> np.ndarray:
    """Return a mixing ratio of each level [ppm], well between its thresholds."""
    edges = np.array([0.0, *table.thresholds_ppm])
    return np.array([0.0, *(edges[1:] + np.diff([*edges[1:], 3.0 * edges[-1]]) / 2.0)])


def package() -> Any:
    """Return the package with its agents.

    Raises:
        SystemExit: it is not installed.
    """
    try:
        import olfactory_navigation  # pyright: ignore[reportMissingImports]
        import olfactory_navigation.agents  # pyright: ignore[reportMissingImports]
    except ImportError as error:
        raise SystemExit(
            f"expected the package olfactory-navigation with its agents, was none ({error}). "
            "Install it with pip install 'gslcosim[olfactory]'."
        ) from error
    return olfactory_navigation


def train(fly: Any, expansions: int) -> None:
    """Train a fly that can be trained.

    The last line of QMDP_Agent's own training works on graphics cards only; its solver is called here instead.
    """
    if fly.class_name == "QMDP_Agent":
        from olfactory_navigation.agents.model_based_util import vi_solver  # pyright: ignore[reportMissingImports]

        fly.value_function, _ = vi_solver.solve(model=fly.model, horizon=expansions, print_progress=False)
    elif fly.class_name != "Infotaxis_Agent":
        fly.train(expansions=expansions, print_progress=False, print_stats=False)


class Fly(Agent):
    """Translates between a fly, which knows offsets in cells, and a vehicle in a room."""

    def __init__(self, briefing: Briefing) -> None:
        self.settings = load_settings(briefing, __file__)
        self.table = PlumeTable.load(Path(str(resources.files("gslcosim_agents"))) / "qmdp" / "plumes.npz")
        nose = next(nose for nose in find_noses(briefing) if nose.unit == "ppm" or nose.estimate is not None)
        self.measure = StopAndMeasure((nose,), find_vane(briefing))
        self.wind = RunningWind(threshold_m_s=self.settings.threshold_m_s)
        self.room = LegSpace.within(briefing.bounds, self.settings.margin_m)
        self.height_m, self.draws = briefing.search_height_m, RandomStream(briefing.seed)
        self.declared, self.publisher = DeclarationGuard(), BeliefPublisher(every_s=2.0)
        self.source_grid = CellGrid.covering(briefing.bounds, self.settings.source_cell_m, max_cells=MAX_CELLS)
        sides_m = [high - low for low, high in zip(briefing.bounds.min_m[:2], briefing.bounds.max_m[:2])]
        half = math.ceil(math.hypot(*sides_m) / self.settings.step_m) + 1
        edge_m = -half * self.settings.step_m
        self.grid = OffsetGrid(
            first_m=(edge_m, edge_m), cell_m=self.settings.step_m, shape=(2 * half + 1, 2 * half + 1)
        )
        self.fly = self._new_fly(half, briefing.seed)
        self.origin_m: tuple[float, float] | None = None
        self.axis_rad = 0.0
        self.policy: Cell = (0, 0)
        self.target: Cell | None = None
        self.refused: set[tuple[Cell, int]] = set()

    def observe(self, observation: Observation) -> None:
        """Measure while the vehicle holds."""
        self.measure.add(observation)

    def decide(self, observation: Observation) -> Command:
        """Tell the fly what it smells after its last move, and make the next one."""
        self.measure.add(observation)
        if self.origin_m is None:
            self._begin(observation)
        else:
            self._arrive(observation)
        belief = self._source_belief()
        message = self.publisher.message(observation, belief, self.source_grid, height_m=self.height_m)
        estimate = self.declared.passes(by_mass(belief, self.source_grid, radius_m=self.settings.source_radius_m))
        if estimate is not None:
            at_m = (*estimate.position_m[:2], self.height_m)
            return declaration(observation, at_m, estimate.confidence, belief=message)
        x_m, y_m = self._place_m(self._next_cell())
        return waypoint(observation, x_m, y_m, self.height_m, hold_s=self.settings.hold_s, belief=message)

    def _new_fly(self, half: int, seed: int) -> Any:
        made = package()
        environment = made.Environment(
            data_file=movie_of(self.table, self.grid),
            data_source_position=[half, half],
            source_radius=0.0,
            boundary_condition="stop",
        )
        thresholds = [float(value) for value in self.table.thresholds_ppm]
        fly = getattr(made.agents, self.settings.fly)(environment, thresholds=thresholds, seed=seed % 2**31)
        train(fly, self.settings.expansions)
        return fly

    # The frame of the fly is turned to the wind that is felt first, and stays: its belief cannot be turned.
    def _begin(self, observation: Observation) -> None:
        measured = self.measure.measured()
        if measured is not None and measured.wind is not None:
            self.wind.add(observation.time_s, measured.wind.speed_m_s, measured.wind.upwind_rad)
        self.axis_rad = self.wind.downwind_rad or 0.0
        x_m, y_m, _ = observation.position_world_m
        self.origin_m = (x_m, y_m)
        self._forget()

    def _arrive(self, observation: Observation) -> None:
        if self.target is None:
            return
        index = self._index_of((self.target[0] - self.policy[0], self.target[1] - self.policy[1]))
        if observation.notice is not None:
            self.refused.add((self.policy, index))
        else:
            self.policy = self.target
            self._tell(index, observation)
        self.target = None

    def _tell(self, index: int, observation: Observation) -> None:
        measured = self.measure.measured()
        ppm = 0.0 if measured is None else measured.ppm[0]
        self.fly.action_played = np.array([index])
        try:
            done = self.fly.update_state(
                action=self.fly.action_set[[index]],
                observation=np.array([ppm_of_levels(self.table)[self.table.level_of(ppm)]]),
                source_reached=np.array([False]),
            )
            is_lost = done is not None and not bool(np.all(done))
        except ValueError:  # a belief that the package calls impossible
            is_lost = True
        if is_lost:
            self._forget()

    # All source cells are equally likely: the fly is as far from each of them as the vehicle is.
    def _forget(self) -> None:
        belief_type = type(self.fly.belief) if getattr(self.fly, "belief", None) is not None else None
        self.fly.initialize_state(1)
        belief_type = belief_type or type(self.fly.belief)
        even = self.grid.gathered(self._offsets_m(), np.ones(self.source_grid.n_cells)).reshape(self.grid.shape)
        even[self.grid.shape[0] // 2, self.grid.shape[1] // 2] = 0.0
        self.fly.belief = belief_type(self.fly.model, normalised(even).T.reshape(1, -1))

    def _next_cell(self) -> Cell:
        open_moves = [k for k in range(len(self.fly.action_set)) if self._is_open(k)]
        if not open_moves:
            self.target = None
            return self.policy
        (move,) = self.fly.choose_action()
        index = self._index_of((int(move[1]), int(move[0])))
        index = index if index in open_moves else open_moves[self.draws.index(len(open_moves))]
        across, along = (int(step) for step in self.fly.action_set[index])
        self.target = (self.policy[0] + along, self.policy[1] + across)
        return self.target

    def _is_open(self, index: int) -> bool:
        across, along = (int(step) for step in self.fly.action_set[index])
        place_m = self._place_m((self.policy[0] + along, self.policy[1] + across))
        return (self.policy, index) not in self.refused and self.room.contains(place_m)

    def _index_of(self, step: Cell) -> int:
        return int(np.flatnonzero((self.fly.action_set == (step[1], step[0])).all(axis=1))[0])

    def _place_m(self, cell: Cell) -> tuple[float, float]:
        assert self.origin_m is not None
        c, s = math.cos(self.axis_rad), math.sin(self.axis_rad)
        along_m, across_m = (self.settings.step_m * n for n in cell)
        x_m, y_m = self.origin_m
        return to_millimetre(x_m + c * along_m - s * across_m), to_millimetre(y_m + s * along_m + c * across_m)

    def _offsets_m(self) -> np.ndarray:
        return offsets_m(self.source_grid.centres_m(), self._place_m(self.policy), self.axis_rad)

    def _source_belief(self) -> np.ndarray:
        of_offsets = np.asarray(self.fly.belief.belief_array[0]).reshape(self.grid.shape).T.reshape(1, -1)
        return normalised(self.grid.looked_up(of_offsets, self._offsets_m())[0]).reshape(self.source_grid.shape)


if __name__ == "__main__":
    run(Fly)
