"""Navigation on a granted map: the way round obstacles to a place, and the measurements of the stop there.

Held by:
    extensions/search/tests/unit/motion/test_map_navigation.py
"""

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gslcosim.agent_kit.commands import waypoint
from gslcosim.base.cell_kernels import label_parts
from gslcosim.base.quantities import Vec3
from gslcosim.contract.messages import Briefing, Command, KnownMap, Observation
from gslcosim_search import elementary
from gslcosim_search.beliefs import CellGrid
from gslcosim_search.elementary import distance
from gslcosim_search.motion.grid_paths import (
    Free,
    inflate_obstacles,
    nearest_free,
    point_along,
    shortest_path,
)
from gslcosim_search.motion.legs import LegPlanner, LegSpace
from gslcosim_search.occupancy import OccupancyMap
from gslcosim_search.random_stream import RandomStream
from gslcosim_search.senses.hit_detection import Finding, GasEvidence
from gslcosim_search.senses.instruments import find_noses, find_vane
from gslcosim_search.senses.stop_and_measure import MeasuredWind, StopAndMeasure

# So near to the goal the vehicle has arrived; where a route has more legs, so near to a bend it has passed it.
_ARRIVED_M = 0.15
# Findings farther away than this were made on the way.
_HERE_M = 0.5


class KnownPaths:
    """Finds ways with the map of a briefing; without one they are straight.

    State: the map, with a clearance about what is solid. Nothing changes.
    """

    def __init__(self, briefing: Briefing, *, clearance_m: float) -> None:
        """Prepare the map.

        Args:
            clearance_m: How far ways keep from what is solid [m].
        """
        self._bounds = briefing.bounds
        self._grid: CellGrid | None = None
        if briefing.known_map is not None:
            self._grid = CellGrid.of_map(briefing.known_map)
            self._free = inflate_obstacles(briefing.known_map.occupied.to_array() == 0, self._grid, clearance_m)

    def to_m(self, start_m: Sequence[float], goal_m: Sequence[float], *, margin_m: float | None) -> tuple[Vec3, ...]:
        """Return the bends of the way to a goal, without the start, world frame [m].

        A map in the plane holds at the height of the start: the way changes its height at its end.

        Args:
            goal_m: Where it wants to go [m].
            margin_m: The way ends this far inside the room's bounds, or nearer to its middle [m]; absent: it ends at
                the height of the start.
        """
        x_m, y_m, z_m = LegSpace.within(self._bounds, margin_m or 0.0).nearest(goal_m)
        end_m = (x_m, y_m, float(start_m[2]) if margin_m is None else z_m)
        bends_m = self._bends_m(start_m, end_m)
        return bends_m if margin_m is None and bends_m else (*(bend_m for bend_m in bends_m if bend_m != end_m), end_m)

    def _bends_m(self, start_m: Sequence[float], end_m: Vec3) -> tuple[Vec3, ...]:
        if self._grid is None:
            return ()
        path_m = shortest_path(self._free, self._grid, start_m, end_m)
        bends_m = () if path_m is None else path_m[1:].tolist()
        return tuple((x_m, y_m, rest[0] if rest else float(start_m[2])) for x_m, y_m, *rest in bends_m)


@dataclass(frozen=True, kw_only=True)
class Stop:
    """Measurements of a stop: position, gas or clean air in each span, and the wind."""

    position_m: Vec3
    findings: tuple[Finding, ...]
    wind: MeasuredWind | None

    @property
    def is_hit(self) -> bool | None:
        """True if there was gas; None when the sensor cannot tell: it still shows what it met before."""
        return any(finding.is_hit for finding in self.findings) if self.findings else None

    def wind_world_m_s(self) -> tuple[float, float]:
        """Return the wind vector, world frame [m/s]: where the air goes; 0 when it was not measured."""
        if self.wind is None:
            return 0.0, 0.0
        speed_m_s, upwind_rad = self.wind.speed_m_s, self.wind.upwind_rad
        return -speed_m_s * elementary.cos(upwind_rad), -speed_m_s * elementary.sin(upwind_rad)

    def downwind_rad(self, threshold_m_s: float) -> float | None:
        """Return the downwind direction [rad]; None in calm air, which is no faster than the threshold."""
        if self.wind is None or not self.wind.speed_m_s > threshold_m_s:
            return None
        return self.wind.upwind_rad - math.pi


class StopRecorder:
    """Collects what a vehicle measures between two decisions at rest: call `add` with every observation.

    State: findings since the last stop and the places of the last span; see `GasEvidence` and `StopAndMeasure`.
    """

    def __init__(self, briefing: Briefing, *, threshold_ppm: float, every_s: float) -> None:
        """Begin without findings; the first gas sensor and the first anemometer are used.

        Args:
            briefing: The agent's briefing.
            threshold_ppm: What counts as gas, for sensors in ppm.
            every_s: How long the span of one finding is [s].
        """
        nose = find_noses(briefing)[0]
        self._evidence = GasEvidence(nose, every_s=every_s, threshold_ppm=threshold_ppm)
        self._hold = StopAndMeasure([nose], find_vane(briefing))
        self._findings: list[Finding] = []
        self._every_s = every_s
        self._track: deque[tuple[float, Vec3]] = deque()

    def add(self, observation: Observation) -> None:
        """Take note of an observation; a tick counts once."""
        self._hold.add(observation)
        finding = self._evidence.add(observation)
        self._track.append((observation.time_s, observation.position_world_m))
        while self._track[0][0] < observation.time_s - self._every_s:
            self._track.popleft()
        # A span that began on the way says nothing about one place.
        if finding is not None and all(distance(place, finding.sensor_m) <= _HERE_M for _, place in self._track):
            self._findings.append(finding)

    def stop(self, observation: Observation) -> Stop:
        """Return the measurements of this stop, and start the next."""
        self.add(observation)
        findings, self._findings = self._findings, []
        here_m = observation.position_world_m
        near = (finding for finding in findings if distance(finding.sensor_m, here_m) <= _HERE_M)
        measured = self._hold.measured()
        return Stop(position_m=here_m, findings=tuple(near), wind=None if measured is None else measured.wind)


class MapNavigator:
    """Flies to places round the obstacles of a granted map, one straight leg after the other; holds at the last.

    `grid` and `free` are the cells of the plane and which of them are free, in the largest part of the room that hangs
    together. Ways keep `clearance_m` from obstacles where they can and `margin_m` from the room's bounds.

    State: the goal, and the pilot's last leg.
    """

    def __init__(
        self,
        briefing: Briefing,
        draws: RandomStream,
        *,
        cell_m: float,
        max_cells: int,
        clearance_m: float,
        margin_m: float,
    ) -> None:
        """Read the map. Cells grow until there are at most `max_cells`; a briefing without a map has no obstacles."""
        self.grid = CellGrid.covering(briefing.bounds, cell_m, max_cells=max_cells)
        self.free = largest_connected_part(_free_cells(briefing.known_map, self.grid, briefing.search_height_m))
        self.pilot = LegPlanner(briefing, draws, margin_m=margin_m)
        self.flyable = self._flyable(clearance_m)
        self.goal_m: tuple[float, float] | None = None

    def go_to(self, goal_m: Sequence[float]) -> None:
        """Set a goal, world frame [m]; `leg` leads there."""
        self.goal_m = (goal_m[0], goal_m[1])

    def is_under_way(self, observation: Observation) -> bool:
        """Return True if there is a goal that the vehicle has not reached, and nothing was refused."""
        if self.goal_m is None or self.pilot.was_refused(observation):
            return False
        return distance(observation.position_world_m[:2], self.goal_m) > _ARRIVED_M

    def was_missed(self, observation: Observation) -> bool:
        """Return True if the vehicle is elsewhere than at its goal: it was refused, or led around."""
        return self.goal_m is not None and distance(observation.position_world_m[:2], self.goal_m) > _ARRIVED_M

    def leg(
        self, observation: Observation, *, at_most_m: float = math.inf, hold_s: float | None = None
    ) -> Command | None:
        """Return the command for the next leg to the goal; None without a goal or a way there.

        On bends the vehicle does not hold. A goal at which no vehicle can be is replaced by the nearest place that is.

        Args:
            at_most_m: A longer way is flown so far only [m].
            hold_s: How long to hold at the goal [s]; absent: the briefing's time.
        """
        if self.goal_m is None:
            return None
        here_m = observation.position_world_m[:2]
        path_m = shortest_path(self.flyable, self.grid, here_m, self.goal_m)
        if path_m is None:
            return None
        x_m, y_m = path_m[-1]
        self.goal_m = (float(x_m), float(y_m))
        bends_m = [point_m for point_m in path_m[1:] if distance(point_m, here_m) > _ARRIVED_M] or [path_m[-1]]
        is_last = len(bends_m) == 1 and distance(here_m, bends_m[0]) <= at_most_m
        x_m, y_m = point_along(np.array([here_m, bends_m[0]]), at_most_m)
        return self.pilot.leg(observation, (float(x_m), float(y_m)), hold_s=hold_s if is_last else 0.0)

    def continue_to_goal(self, observation: Observation) -> Command | None:
        """Return the next leg to a goal that is not reached yet; None at the goal, or where no way leads there."""
        return self.leg(observation) if self.is_under_way(observation) else None

    def stay(self, observation: Observation) -> Command:
        """Return the command to stay here for a hold, so that what comes with the wind is measured."""
        self.goal_m = None
        x_m, y_m, _ = observation.position_world_m
        return waypoint(observation, x_m, y_m, self.pilot.height_m)

    def nearest_flyable_m(self, point_m: Sequence[float]) -> tuple[float, ...]:
        """Return the centre of the cell nearest to a point where a vehicle can be, world frame [m]."""
        cell = nearest_free(self.flyable, self.grid, point_m)
        assert cell is not None, "the constructor keeps at least one cell"
        return self.grid.centre_m(cell)

    # With less and less clearance, until there is a cell to fly in.
    def _flyable(self, clearance_m: float) -> Free:
        centres_m = self.grid.centres_m().reshape(*self.grid.shape, 2)
        low_m, high_m = np.array(self.pilot.room.min_m[:2]), np.array(self.pilot.room.max_m[:2])
        inside = ((centres_m >= low_m) & (centres_m <= high_m)).all(axis=-1)
        for share in (1.0, 0.5, 0.0):
            flyable = inflate_obstacles(self.free, self.grid, share * clearance_m) & inside
            if flyable.any():
                return largest_connected_part(flyable)
        return self.free


def largest_connected_part(free: Free) -> Free:
    """Return the largest part of the free cells that hangs together; all cells where none is free.

    Cells hang together when a path of `path_tree` connects them: through faces, since paths cut no corners. Of equally
    large parts the first is taken.
    """
    if not free.any():
        return np.ones_like(free)
    parts = label_parts(free if free.ndim == 3 else free[:, :, None], False).reshape(free.shape)  # noqa: FBT003 - a cell
    return parts == 1 + np.bincount(parts[free])[1:].argmax()


def _free_cells(known_map: KnownMap | None, grid: CellGrid, height_m: float) -> Free:
    if known_map is None:
        return np.ones(grid.shape, np.bool_)
    return OccupancyMap.of(known_map, height_m=height_m).free_throughout(grid)
