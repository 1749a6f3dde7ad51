"""Cloverleaves: loops around the place where gas was met last."""

import math
from dataclasses import dataclass, field

QUARTER_TURN_RAD = 1.5707963267948966
EIGHTH_TURN_RAD = 0.7853981633974483
# Order of the leaves: upwind, to one side, to the other, downwind.
_LEAF_TURNS = (0, 1, -1, 2)


def leaf_radius_m(radius_m: float, angle_rad: float) -> float:
    """Return the distance from the centre of a leaf of a rose with four leaves.

    r(phi) = R cos(2 phi)        phi from the leaf's axis, within an eighth of a turn to either side [rad]
    [m] = [m]

    Held by:
        tests/unit/search/reactive/test_clover.py
    """
    return radius_m * math.cos(2.0 * angle_rad)


@dataclass(kw_only=True)
class Clover:
    """Places on four loops through a centre, the one upwind first, each of them ending at the centre.

    Args:
        centre_m: Where gas was met last, world frame [m].
        radius_m: Length of a leaf [m].
        upwind_rad: Where the wind comes from: the axis of the first leaf [rad].
        side: Which side comes second, looking upwind, and which way the leaves are flown: +1 left, -1 right.
        n_per_leaf: Places on each leaf, the centre included; at least 2.

    Source:
        Li, Farrell, Pang, Arrieta 2006, doi:10.1109/TRO.2006.870627: reacquire by a cloverleaf (remembered,
        unverified).
    Deviation:
        The shape is a rose with four leaves and the order is ours: theirs is not known to us.
    Held by:
        tests/unit/search/reactive/test_clover.py
    """

    centre_m: tuple[float, float]
    radius_m: float
    upwind_rad: float
    side: int
    n_per_leaf: int = 4
    n_done: int = field(default=0, init=False)

    def next_place_m(self) -> tuple[float, float] | None:
        """Return the next place, world frame [m], or nothing after the last leaf."""
        leaf, step = divmod(self.n_done, self.n_per_leaf)
        if leaf >= len(_LEAF_TURNS):
            return None
        self.n_done += 1
        from_axis_rad = EIGHTH_TURN_RAD * (2.0 * (step + 1) / self.n_per_leaf - 1.0)
        distance_m = leaf_radius_m(self.radius_m, from_axis_rad)
        direction_rad = self.upwind_rad + self.side * (_LEAF_TURNS[leaf] * QUARTER_TURN_RAD + from_axis_rad)
        return (
            self.centre_m[0] + distance_m * math.cos(direction_rad),
            self.centre_m[1] + distance_m * math.sin(direction_rad),
        )
