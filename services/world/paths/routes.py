"""Routes of one vehicle through the free space of an environment, in three dimensions or at its height."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from gslcosim.base.quantities import Vec3
from gslcosim.environment.model import Closed, Environment
from gslcosim.environment.paths.planner import MARGIN_M, FreeSpace, free_space
from gslcosim.environment.variants.dynamic_environment import DynamicEnvironment


@dataclass(frozen=True, kw_only=True)
class RoutePlanner:
    """Route planner of a vehicle: `3d` around, over and under obstacles, `2d` around them.

    In two dimensions it changes height evenly along the way, free of what stands between the two heights anywhere on
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
        points_m = self._route_3d(free_m, goal_m) if self.mode == "3d" else self._route_2d(free_m, goal_m)
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

    def _route_3d(self, start_m: Vec3, goal_m: Vec3) -> list[Vec3] | None:
        return _points(self.free.path(start_m, goal_m))

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
        environment: The room.
        mode: In how many dimensions it goes around.
        radius_m: The vehicle's radius [m].
        ground: On wheels, its height and that of what it stands on, world frame [m].
        doors: How the room is now, where it has doors that events move.
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
