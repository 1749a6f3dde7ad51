"""Lawnmower lanes: a path that comes near to every place of a room without any gas."""

import math
from collections.abc import Sequence

from gslcosim.search.motion.legs import LegSpace, Point, to_millimetre


def lawnmower_path_m(room: LegSpace, spacing_m: float, start_m: Sequence[float]) -> tuple[Point, ...]:
    """Return the bends of a path along lanes, x and y in whole millimetres, world frame [m].

    n = ceil(width / spacing) + 1 lanes along the room's longer side, width / (n - 1) apart, from side to side

    The first bend is the corner nearest to the start. Every place between the lanes is at most half the spacing from
    the path, places in the margin of the room up to sqrt((spacing / 2)^2 + margin^2).

    Args:
        room: Its margin is left out.
        spacing_m: Distance of neighbouring lanes at most [m].
        start_m: Where the vehicle is [m].

    Source:
        Textbook (boustrophedon path of a rectangle).
    Held by:
        tests/unit/search/motion/test_lawnmower.py
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
