"""Flies a policy of OTTO in a room: what OTTO calls the environment is kept here, from real readings.

README.md beside this file has the rules. OTTO itself is not on the package index; nothing of it is copied.
"""

import importlib
import sys
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np

from gslcosim.agent_kit import Agent, Briefing, Command, Observation, run
from gslcosim.agent_kit.commands import declaration, waypoint
from gslcosim.agent_kit.settings import load_settings
from gslcosim_search.beliefs import BeliefPublisher, CellGrid, entropy_bits, normalised
from gslcosim_search.information.pomdp import PlumeTable, RunningWind, offsets_m
from gslcosim_search.motion.declaration import DeclarationGuard, by_mass
from gslcosim_search.motion.legs import LegSpace
from gslcosim_search.random_stream import RandomStream
from gslcosim_search.senses.instruments import find_noses, find_vane
from gslcosim_search.senses.stop_and_measure import StopAndMeasure


class RoomAsGrid:
    """A room as a policy of OTTO sees it: the attributes and functions that its documentation names.

    `p_source` (N, N) is the belief, `agent` the searcher's cell, `p_Poisson` (Nhits, 2 N + 1, 2 N + 1) the probability
    of each number of hits for a source at a displacement from the searcher, which is at the array's middle; 0 there,
    where the search would be over. Action 2 k steps down axis k, action 2 k + 1 up.
    """

    Ndim, Nactions = 2, 4

    def __init__(self, room: LegSpace, start_m: tuple[float, float], step_m: float, n_hits: int) -> None:
        """Lay cells around the start, as many as reach every wall of the room; believe evenly in those inside."""
        reach_m = max(max(high - x, x - low) for x, low, high in zip(start_m, room.min_m, room.max_m, strict=False))
        half = int(reach_m / step_m) + 1
        self.N, self.Nhits = 2 * half + 1, n_hits
        corner_m = tuple(x - (half + 0.5) * step_m for x in start_m)
        self.grid = CellGrid(corner_m, step_m, (self.N, self.N))
        self.is_inside = np.array([room.contains(place_m) for place_m in self.grid.centres_m()]).reshape(self.N, self.N)
        self.is_inside[half, half] = True
        self.agent = [half, half]
        self.p_source = normalised(self.is_inside.astype(float))
        self.p_Poisson = np.ones((n_hits, 2 * self.N + 1, 2 * self.N + 1)) / n_hits
        self.hit_map = np.full((self.N, self.N), -1)
        self.entropy = entropy_bits(self.p_source)
        self._refused: set[tuple[int, ...]] = set()

    def learn(self, level: int, table: PlumeTable, downwind_rad: float, power: float) -> None:
        """Take a level for so many hits: turn the table to the wind, and update the belief."""
        places_m = CellGrid((-self.N - 0.5,) * 2, 1.0, self.p_Poisson.shape[1:]).centres_m() * self.grid.cell_m
        seen = offsets_m(places_m, (0.0, 0.0), downwind_rad)
        by_level = [table.likelihood(k, seen) ** power for k in range(self.Nhits)]
        self.p_Poisson = (np.array(by_level) / np.sum(by_level, axis=0)).reshape(self.p_Poisson.shape)
        # A cell in which the search has not ended stays possible: nobody tells an agent here that it has arrived.
        likelihood = self._extract_N_from_2N(input=self.p_Poisson, origin=self.agent)[level]
        self.p_source = normalised(self.p_source * likelihood)
        self.p_Poisson[:, self.N, self.N] = 0.0
        self.hit_map[tuple(self.agent)] = level
        self.entropy = entropy_bits(self.p_source)

    def refuse(self, cell: list[int]) -> None:
        """Take note that a cell cannot be flown to."""
        self._refused.add(tuple(cell))

    def _move(self, action: int, agent: list[int]) -> tuple[list[int], bool]:
        cell = list(agent)
        cell[action // 2] += 2 * (action % 2) - 1
        is_possible = (
            self.grid.contains(cell) and bool(self.is_inside[tuple(cell)]) and tuple(cell) not in self._refused
        )
        return (cell, True) if is_possible else (list(agent), False)

    def _extract_N_from_2N(self, input: np.ndarray, origin: list[int]) -> np.ndarray:  # noqa: A002, N802 - OTTO's name
        middle = input.shape[-1] // 2
        return input[(..., *(slice(middle - i, middle - i + self.N) for i in origin))]

    def _entropy(self, array: np.ndarray, axes: Any = None) -> Any:
        return -np.sum(array * np.log2(array, out=np.zeros_like(array), where=array > 0.0), axis=axes)

    def _distance(self, N: int, origin: list[int], norm: str = "Euclidean") -> np.ndarray:  # noqa: N803 - OTTO's name
        order = {"Manhattan": 1, "Euclidean": 2, "Chebyshev": np.inf}[norm]
        steps = np.stack(np.meshgrid(*(np.arange(N) - i for i in origin), indexing="ij"))
        return np.linalg.norm(steps, ord=order, axis=0)


class OttoPolicy(Agent):
    """Asks a policy of OTTO for each step."""

    def __init__(self, briefing: Briefing) -> None:
        self.settings = load_settings(briefing, __file__)
        self.table = PlumeTable.load(Path(str(resources.files("gslcosim_agents"))) / "qmdp" / "plumes.npz")
        nose = next(nose for nose in find_noses(briefing) if nose.unit == "ppm" or nose.estimate is not None)
        self.measure = StopAndMeasure((nose,), find_vane(briefing))
        self.wind = RunningWind(threshold_m_s=self.settings.threshold_m_s)
        self.room = LegSpace.within(briefing.bounds, self.settings.margin_m)
        self.height_m, self.draws = briefing.search_height_m, RandomStream(briefing.seed)
        self.declared, self.publisher = DeclarationGuard(), BeliefPublisher(every_s=2.0)
        self.world: RoomAsGrid | None = None
        self.policy: Any = None
        self.target: list[int] | None = None

    def observe(self, observation: Observation) -> None:
        """Measure while the vehicle holds."""
        self.measure.add(observation)

    def decide(self, observation: Observation) -> Command:
        """Tell the policy's world what happened, and do what the policy chooses."""
        self.measure.add(observation)
        world = self._world_of(observation)
        self._arrive(world, observation)
        measured = self.measure.measured()
        if measured is not None and measured.wind is not None:
            self.wind.add(observation.time_s, measured.wind.speed_m_s, measured.wind.upwind_rad)
            if self.wind.downwind_rad is not None:
                level = self.table.level_of(measured.ppm[0])
                world.learn(level, self.table, self.wind.downwind_rad, self.settings.power)
        message = self.publisher.message(observation, world.p_source, world.grid, height_m=self.height_m)
        estimate = self.declared.passes(by_mass(world.p_source, world.grid, radius_m=self.settings.source_radius_m))
        if estimate is not None:
            at_m = (*estimate.position_m[:2], self.height_m)
            return declaration(observation, at_m, estimate.confidence, belief=message)
        self.target = self._next_cell(world)
        x_m, y_m = world.grid.centre_m(self.target)
        return waypoint(observation, x_m, y_m, self.height_m, hold_s=self.settings.hold_s, belief=message)

    def _world_of(self, observation: Observation) -> RoomAsGrid:
        if self.world is None:
            x_m, y_m, _ = observation.position_world_m
            self.world = RoomAsGrid(self.room, (x_m, y_m), self.settings.step_m, len(self.table.level_frac))
            self.policy = policy_of(self.settings, self.world)
        return self.world

    def _arrive(self, world: RoomAsGrid, observation: Observation) -> None:
        if self.target is None:
            return
        if observation.notice is None:
            world.agent = self.target
        elif self.target != world.agent:
            world.refuse(self.target)
        self.target = None

    def _next_cell(self, world: RoomAsGrid) -> list[int]:
        possible = [action for action in range(world.Nactions) if world._move(action, world.agent)[1]]
        if not possible:
            return list(world.agent)
        action = int(self.policy.choose_action())
        return world._move(action if action in possible else possible[self.draws.index(len(possible))], world.agent)[0]


def policy_of(settings: Any, world: RoomAsGrid) -> Any:
    """Return the policy that the settings name, in its world.

    Raises:
        SystemExit: its module or class cannot be found.
    """
    if settings.path and settings.path not in sys.path:
        sys.path.insert(0, settings.path)
    try:
        policy_type = getattr(importlib.import_module(settings.module), settings.class_name)
    except (ImportError, AttributeError) as error:
        raise SystemExit(
            f"parameters.path: expected the folder of a checkout of OTTO, with {settings.module} in it, was "
            f"{settings.path!r} ({error}). Clone OTTO and give its folder as parameters: {{path: ...}}."
        ) from error
    return policy_type(env=world, policy=settings.policy)


if __name__ == "__main__":
    run(OttoPolicy)
