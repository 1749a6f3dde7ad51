"""Coverage of a room without gas: squares not visited yet, and lawnmower lanes.

The nearest square across the wind comes first. In an empty room this flies lanes across the wind; after gas was
followed and lost again, what was seen meanwhile is left out.

Held by:
    extensions/search/tests/unit/motion/test_coverage.py
"""

import math
from collections.abc import Sequence

from gslcosim.base.scalar_kernels import norm2
from gslcosim_search import elementary
from gslcosim_search.motion.legs import LegSpace, Point, to_millimetre


class CoverageGrid:
    """Squares of a room that were not visited, and which of them to visit next.

    next = the unseen square of least (across^2 + (k along)^2)        across, along: from here, against the wind [m]

    A square counts as seen when the vehicle has been nearer to its centre than half its edge. With k above 1 the next
    square is rather beside the vehicle than up or down the wind: lanes. Of equally good ones the first is taken, in the
    order of x, then y. When all are seen, all are unseen again.

    State: the squares seen.

    Source:
        Ours: a sweep in lanes that may be left and taken up again anywhere.
    """

    def __init__(self, room: LegSpace, *, edge_m: float, along_weight: float = 2.0) -> None:
        """Begin with all squares unseen.

        Args:
            room: Where legs may end; it is cut into equal rectangles that are no longer than the edge.
            along_weight: k, how much farther a way along the wind counts.
        """
        self._columns_m = _middles(room.min_m[0], room.max_m[0], edge_m)
        self._rows_m = _middles(room.min_m[1], room.max_m[1], edge_m)
        self._radius_m = edge_m / 2.0
        self._along_weight = along_weight
        self._unseen = {(i, j) for i in range(len(self._columns_m)) for j in range(len(self._rows_m))}

    @property
    def n_unseen(self) -> int:
        """Number of squares left."""
        return len(self._unseen)

    def note(self, place_m: Sequence[float]) -> None:
        """Take note of where the vehicle is, world frame [m]."""
        i = _nearest(self._columns_m, place_m[0])
        j = _nearest(self._rows_m, place_m[1])
        if norm2(self._columns_m[i] - place_m[0], self._rows_m[j] - place_m[1]) < self._radius_m:
            self._unseen.discard((i, j))

    def skip(self, place_m: Sequence[float]) -> None:
        """Take a square for seen that cannot be reached: the one around a place."""
        self._unseen.discard((_nearest(self._columns_m, place_m[0]), _nearest(self._rows_m, place_m[1])))

    def next_place_m(self, here_m: Sequence[float], upwind_rad: float | None) -> tuple[float, float]:
        """Return the centre of the next square to visit, world frame [m].

        Args:
            upwind_rad: Where the wind comes from; absent: as if from x [rad].
        """
        if not self._unseen:
            self._unseen = {(i, j) for i in range(len(self._columns_m)) for j in range(len(self._rows_m))}
        along_x, along_y = elementary.cos(upwind_rad or 0.0), elementary.sin(upwind_rad or 0.0)
        best, best_m2 = (0, 0), math.inf
        for i, j in sorted(self._unseen):
            dx_m, dy_m = self._columns_m[i] - here_m[0], self._rows_m[j] - here_m[1]
            along_m = self._along_weight * (dx_m * along_x + dy_m * along_y)
            across_m = dy_m * along_x - dx_m * along_y
            # A micrometre decides nothing: the last bit of a sine does not choose the way.
            if across_m * across_m + along_m * along_m < best_m2 - 1e-6:
                best, best_m2 = (i, j), across_m * across_m + along_m * along_m
        return self._columns_m[best[0]], self._rows_m[best[1]]


def _middles(low_m: float, high_m: float, edge_m: float) -> list[float]:
    n = max(1, math.ceil((high_m - low_m) / edge_m - 1e-9))
    return [low_m + (high_m - low_m) * (i + 0.5) / n for i in range(n)]


def _nearest(places_m: list[float], place_m: float) -> int:
    return min(range(len(places_m)), key=lambda i: abs(places_m[i] - place_m))


def lawnmower_path_m(room: LegSpace, spacing_m: float, start_m: Sequence[float]) -> tuple[Point, ...]:
    """Return the bends of a path along lanes, x and y in whole millimetres, world frame [m].

    n = ceil(width / spacing) + 1 lanes along the room's longer side, width / (n - 1) apart, from side to side

    The first bend is the corner nearest to the start. Every place between the lanes is at most half the spacing from
    the path, places in the margin of the room up to sqrt((spacing / 2)^2 + margin^2).

    Args:
        room: Its margin is left out.
        spacing_m: Distance of neighbouring lanes at most [m].

    Source:
        Textbook (boustrophedon path of a rectangle).
    """
    low, high = room.min_m[:2], room.max_m[:2]
    near = tuple(a if abs(x - a) <= abs(x - b) else b for x, a, b in zip(start_m, low, high))
    far = tuple(b if at == a else a for at, a, b in zip(near, low, high))
    along = 0 if high[0] - low[0] >= high[1] - low[1] else 1
    across = 1 - along
    n_lanes = math.ceil((high[across] - low[across]) / spacing_m - 1e-9) + 1
    bends: list[Point] = []
    for i in range(n_lanes):
        share = i / max(1, n_lanes - 1)
        offset_m = near[across] + share * (far[across] - near[across])
        ends_m = (near[along], far[along]) if i % 2 == 0 else (far[along], near[along])
        bends += [_point(end_m, offset_m, along) for end_m in ends_m]
    return tuple(bends)


def _point(along_m: float, across_m: float, along: int) -> Point:
    x_m, y_m = (along_m, across_m) if along == 0 else (across_m, along_m)
    return to_millimetre(x_m), to_millimetre(y_m)
