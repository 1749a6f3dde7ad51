"""Flight space of a vehicle: bounds, free cells, clear height, and routes through it."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from gslcosim.base.quantities import Vec3
from gslcosim.base.scalar_kernels import scalar_kernel
from gslcosim.environment.model import Cell, Closed, Environment
from gslcosim.environment.paths.planner import MARGIN_M, FreeSpace, free_space
from gslcosim.environment.variants import DynamicEnvironment

_SOLID = int(Cell.SOLID)
# Distance from its reference that a vehicle may reach while it brakes.
CLEARANCE_M = 0.1


NO_AXIS = -1


@scalar_kernel
def find_axis_out_of_bounds(
    position_m: Sequence[float], min_m: Sequence[float], max_m: Sequence[float], margin_m: float
) -> int:
    """Return the first axis along which a place (3,) is not in the room, `NO_AXIS` for a place within it.

    Args:
        position_m: World frame [m].
        min_m: (3,) least corner of the room's air, world frame [m].
        max_m: (3,) greatest corner of it.
        margin_m: Distance of the place from floor and ceiling [m].
    """
    for axis in range(3):
        margin = margin_m if axis == 2 else 0.0
        if not min_m[axis] + margin <= position_m[axis] <= max_m[axis] - margin:
            return axis
    return NO_AXIS


@scalar_kernel
def find_axis_of_stop_beyond(
    stop_m: Sequence[float],
    velocity_m_s: Sequence[float],
    min_m: Sequence[float],
    max_m: Sequence[float],
    radius_m: float,
) -> int:
    """Return the first axis along which a vehicle stops too near to a face that it moves towards, or `NO_AXIS`.

    Args:
        stop_m: (3,) where it would come to rest, world frame [m].
        velocity_m_s: (3,) how it moves now, world frame [m/s].
        min_m: (3,) least corner of the room's air, world frame [m].
        max_m: (3,) greatest corner of it.
        radius_m: The vehicle's radius, which it keeps with a clearance [m].
    """
    for axis in range(3):
        speed_m_s = velocity_m_s[axis]
        if speed_m_s > 0.0 and stop_m[axis] > max_m[axis] - radius_m - CLEARANCE_M:
            return axis
        if speed_m_s < 0.0 and stop_m[axis] < min_m[axis] + radius_m + CLEARANCE_M:
            return axis
    return NO_AXIS


@scalar_kernel
def nearest_cell_index(coordinate_m: float, origin_m: float, cell_m: float, n_cells: int) -> int:
    """Return the index along an axis of the cell that holds a coordinate [m]; outside the grid of the nearest one."""
    return max(min(math.floor((coordinate_m - origin_m) / cell_m), n_cells - 1), 0)


@dataclass(frozen=True, kw_only=True)
class FlightSpace:
    """The places a vehicle of a certain radius may be sent to.

    `ground_height_m` is the height of a vehicle that drives: heights of places only have to lie in the room.
    `moves_places` accepts a waypoint in a solid: the vehicle moves to a place beside it. `doors` is the present
    state of the room, where it has doors that events move.
    """

    environment: Environment
    radius_m: float
    ground_height_m: float | None = None
    moves_places: bool = False
    doors: DynamicEnvironment | None = None

    @property
    def room(self) -> Environment:
        """The room as it is now."""
        return self.environment if self.doors is None else self.doors.now

    def refusal(self, name: str, position_world_m: Vec3) -> str | None:
        """Return why a place is refused, or nothing when it is allowed.

        A place must lie inside the room, at least the vehicle's radius from floor and ceiling, and in a free cell.

        Args:
            name: Name of the place, for the text.
            position_world_m: The place, world frame [m].
        """
        margin_m = self._margin_m
        return self._refusal_of_bounds(name, position_world_m, margin_m) or self._refusal_of_cell(
            name, position_world_m
        )

    def find_waypoint_refusal(self, name: str, position_world_m: Vec3) -> str | None:
        """Return why an agent cannot send the vehicle to a place; as `refusal`, but solids may move places."""
        if self.moves_places:
            return self._refusal_of_bounds(name, position_world_m, self._margin_m)
        return self.refusal(name, position_world_m)

    def find_start_refusal(self, name: str, position_world_m: Vec3) -> str | None:
        """Return why a vehicle cannot start at a place; as `refusal`, but it may stand on the floor."""
        return self._refusal_of_bounds(name, position_world_m, 0.0) or self._refusal_of_cell(name, position_world_m)

    @property
    def _margin_m(self) -> float:
        return self.radius_m if self.ground_height_m is None else 0.0

    def _refusal_of_bounds(self, name: str, position_world_m: Vec3, margin_m: float) -> str | None:
        low_m, high_m = self.room.grid.origin_m, self.room.grid.max_m
        axis = find_axis_out_of_bounds(position_world_m, low_m, high_m, margin_m)
        if axis == NO_AXIS:
            return None
        margin = margin_m if axis == 2 else 0.0
        low, high, value = low_m[axis] + margin, high_m[axis] - margin, position_world_m[axis]
        return f"{name}: expected {'xyz'[axis]} within {low:g} to {high:g} m, was {value:g} m."

    def _refusal_of_cell(self, name: str, position_world_m: Vec3) -> str | None:
        x_m, y_m, z_m = position_world_m
        place_m = (x_m, y_m, z_m if self.ground_height_m is None else self.ground_height_m)
        if self._is_solid_at(place_m):
            return f"{name}: expected a free place, was {self._place_text(place_m)}."
        return None

    def find_edge_ahead(self, name: str, stop_world_m: Vec3, velocity_world_m_s: Vec3) -> str | None:
        """Return why a vehicle that would stop at a place must brake now, or nothing while there is room.

        It keeps its radius and a clearance from the room's faces that it moves towards, and out of solid cells.

        Args:
            name: Reason for the stop, for the text.
            stop_world_m: Place of rest, world frame [m].
            velocity_world_m_s: Present velocity, world frame [m/s].
        """
        low_m, high_m = self.room.grid.origin_m, self.room.grid.max_m
        axis = find_axis_of_stop_beyond(stop_world_m, velocity_world_m_s, low_m, high_m, self.radius_m)
        if axis != NO_AXIS:
            least, most = low_m[axis] + self.radius_m + CLEARANCE_M, high_m[axis] - self.radius_m - CLEARANCE_M
            return (
                f"{name}: expected a stop at {'xyz'[axis]} within {least:g} to {most:g} m, "
                f"was heading for {stop_world_m[axis]:.2f} m."
            )
        if any(velocity_world_m_s) and self._is_solid_at(stop_world_m):
            return f"{name}: expected a stop in a free place, was heading for {self._place_text(stop_world_m)}."
        return None

    # The cell that holds a place, or the nearest of the grid.
    def _is_solid_at(self, position_m: Vec3) -> bool:
        grid = self.room.grid
        i, j, k = (nearest_cell_index(position_m[a], grid.origin_m[a], grid.cell_m, grid.shape[a]) for a in range(3))
        return bool(self.room.occupancy[i, j, k] == _SOLID)

    def support_height_m(self, position_world_m: Vec3) -> float:
        """Return the height of the floor or the highest box top below a place, world frame [m]."""
        x_m, y_m, z_m = position_world_m
        tops_m = [
            box.max_m[2]
            for box in self.room.boxes
            if box.kind in ("floor", "obstacle")
            and box.min_m[0] <= x_m <= box.max_m[0]
            and box.min_m[1] <= y_m <= box.max_m[1]
            and box.max_m[2] <= z_m + 1e-9
        ]
        return max([self.room.grid.origin_m[2], *tops_m])

    # Names the solid, where the cell belongs to a named one.
    def _place_text(self, position_world_m: Vec3) -> str:
        place = ", ".join(f"{value:.4g}" for value in position_world_m)
        for box in self.room.boxes:
            if all(a <= p <= b for a, p, b in zip(box.min_m, position_world_m, box.max_m, strict=True)):
                return f"({place}) m, inside {box.name}"
        return f"({place}) m, inside a solid cell"


@dataclass(frozen=True, kw_only=True)
class RoutePlanner:
    """Route planner of a vehicle: `3d` around, over and under obstacles, `2d` around them.

    In two dimensions it changes height evenly along the way, free of obstacles between the two heights anywhere on
    it; where that leaves no way, it changes height at the end, or else at the start. On wheels it stays on the ground.
    `space` is the free space at the start; `later_spaces` are those of rooms with other doors closed, by their names.
    """

    space: FreeSpace
    mode: Literal["2d", "3d"]
    clearance_m: float
    ground_height_m: float | None = None
    doors: DynamicEnvironment | None = None
    later_spaces: Mapping[Closed, FreeSpace] = field(default_factory=dict[Closed, FreeSpace], repr=False)
    _slabs: dict[tuple[Closed, int, int], FreeSpace] = field(default_factory=dict, repr=False, compare=False)

    @property
    def free(self) -> FreeSpace:
        """The free space of the room as it is now."""
        return self.space if self.doors is None else self.later_spaces.get(self._closed, self.space)

    @property
    def _closed(self) -> Closed:
        return () if self.doors is None else self.doors.variant.closed

    def level(self, place_m: Vec3) -> Vec3:
        """Return a place at the height at which the vehicle would be there, world frame [m]."""
        return place_m if self.ground_height_m is None else (place_m[0], place_m[1], self.ground_height_m)

    def is_free(self, place_m: Vec3) -> bool:
        """Return whether the vehicle may be at a place, world frame [m]."""
        return self.free.is_free(place_m)

    def nearest_reachable_m(self, place_m: Vec3, from_m: Vec3) -> Vec3 | None:
        """Return the nearest place to one that is not free, among those that can be reached; world frame [m].

        In two dimensions it has the same height.
        """
        start_m = self.nearest_free_m(from_m)
        if start_m is None:
            return None
        if self.mode == "3d":
            return self.free.nearest_m(place_m, part=self.free.part_of(start_m))
        flat = self._slab(place_m[2], start_m[2])
        if not flat.is_free(_flat(start_m)):
            flat = self._slab(place_m[2], place_m[2])
        outside_m = flat.nearest_m(_flat(place_m), part=flat.part_of(_flat(start_m)))
        return None if outside_m is None else (outside_m[0], outside_m[1], place_m[2])

    def route_m(self, start_m: Vec3, goal_m: Vec3) -> list[Vec3] | None:
        """Return start, bends and goal, world frame [m], or nothing when there is no way.

        A start too near to something is left straight to the nearest free place in sight.
        """
        free_m = self.nearest_free_m(start_m)
        if free_m is None:
            return None
        is_3d = self.mode == "3d"
        points_m = _points(self.free.path(free_m, goal_m)) if is_3d else self._route_2d(free_m, goal_m)
        if points_m is None or free_m == start_m:
            return points_m
        return [start_m, *points_m]

    def nearest_free_m(self, start_m: Vec3) -> Vec3 | None:
        """Return the free place to which a start, world frame [m], is left: itself, or the nearest one in sight."""
        if self.free.is_free(start_m):
            return start_m
        if self.ground_height_m is None:
            return self.free.nearest_m(start_m, in_sight=True)
        place_m = self._slab(start_m[2], start_m[2]).nearest_m(_flat(start_m), in_sight=True)
        return None if place_m is None else (place_m[0], place_m[1], start_m[2])

    def _route_2d(self, start_m: Vec3, goal_m: Vec3) -> list[Vec3] | None:
        (x0, y0, z0), (x1, y1, z1) = start_m, goal_m
        even_m = self._flat_route(self._slab(z0, z1), start_m, goal_m)
        if even_m is not None or z0 == z1:
            return even_m
        column = self.free.sees
        first_m = self._flat_route(self._slab(z0, z0), start_m, (x1, y1, z0))
        if first_m is not None and column((x1, y1, z0), goal_m):
            return [*first_m, goal_m]
        last_m = self._flat_route(self._slab(z1, z1), (x0, y0, z1), goal_m)
        return [start_m, *last_m] if last_m is not None and column(start_m, (x0, y0, z1)) else None

    # Heights in proportion to the way.
    def _flat_route(self, flat: FreeSpace, start_m: Vec3, goal_m: Vec3) -> list[Vec3] | None:
        points_m = flat.path(_flat(start_m), _flat(goal_m))
        if points_m is None:
            return None
        steps_m = np.linalg.norm(np.diff(points_m, axis=0), axis=1)
        share = np.concatenate([[0.0], np.cumsum(steps_m) / max(float(steps_m.sum()), 1e-9)])
        points_m[:, 2] = start_m[2] + share * (goal_m[2] - start_m[2])
        return [start_m, *(_points(points_m[1:-1]) or []), goal_m]

    def _slab(self, a_m: float, b_m: float) -> FreeSpace:
        grid = self.free.grid
        low, high = (math.floor((z_m - grid.origin_m[2]) / grid.cell_m) for z_m in (min(a_m, b_m), max(a_m, b_m)))
        key = (self._closed, low, high)
        if key not in self._slabs:
            self._slabs[key] = self.free.slab(min(a_m, b_m), max(a_m, b_m))
        return self._slabs[key]


def build_route_planner(
    environment: Environment,
    mode: Literal["2d", "3d"],
    *,
    radius_m: float,
    ground: tuple[float, float] | None = None,
    doors: DynamicEnvironment | None = None,
) -> RoutePlanner:
    """Build the route planner of a vehicle.

    Args:
        mode: In how many dimensions it goes around.
        radius_m: The vehicle's radius [m].
        ground: On wheels, its height and that of the floor under it, world frame [m].
        doors: Present state of the room, where it has doors that events move.
    """
    height_m, ground_m = ground or (None, None)
    rooms = {(): environment} if doors is None else doors.by_doors()
    spaces = {
        closed: free_space(room, radius_m=radius_m, margin_m=MARGIN_M, ground_m=ground_m)
        for closed, room in rooms.items()
    }
    return RoutePlanner(
        space=next(iter(spaces.values())),
        mode=mode,
        clearance_m=radius_m + MARGIN_M,
        ground_height_m=height_m,
        doors=doors,
        later_spaces=spaces,
    )


def _flat(place_m: Vec3) -> Vec3:
    return place_m[0], place_m[1], 0.0


def _points(points_m: NDArray[np.float64] | None) -> list[Vec3] | None:
    return None if points_m is None else [(x, y, z) for x, y, z in points_m.tolist()]
