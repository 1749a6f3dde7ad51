"""Shortest paths to a known place, around the obstacles of a granted map."""

from collections.abc import Sequence

from gslcosim.base.quantities import Vec3
from gslcosim.contract.messages import Briefing
from gslcosim.search.grids import CellGrid
from gslcosim.search.motion.grid_paths import inflate_obstacles, shortest_path
from gslcosim.search.motion.legs import LegSpace


class KnownPaths:
    """Finds ways with the map of a briefing; without one they are straight.

    State: the map, with a clearance about what is solid. Nothing changes.

    Held by:
        tests/unit/search/motion/test_known_paths.py
    """

    def __init__(self, briefing: Briefing, *, clearance_m: float) -> None:
        """Prepare the map.

        Args:
            briefing: With the map, where one was granted.
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
            start_m: Where the vehicle is [m].
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
