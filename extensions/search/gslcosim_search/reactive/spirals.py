"""Paths that wind outwards: Archimedean and square spirals, and cloverleaves.

Held by:
    extensions/search/tests/unit/reactive/test_spirals.py
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Protocol

from gslcosim.base.scalar_kernels import norm2
from gslcosim_search import elementary
from gslcosim_search.random_stream import RandomStream

FULL_TURN_RAD = 6.283185307179586
RIGHT_ANGLE_RAD = 1.5707963267948966
_NEWTON_STEPS = 50
_NEWTON_STOPS_RAD = 1e-12
QUARTER_TURN_RAD = 1.5707963267948966
EIGHTH_TURN_RAD = 0.7853981633974483
# Order of the leaves: upwind, to one side, to the other, downwind.
_LEAF_TURNS = (0, 1, -1, 2)


def spiral_radius_m(gap_m: float, angle_rad: float) -> float:
    """Return the distance from the centre of an Archimedean spiral after a turn.

    r(phi) = g phi / (2 pi)        g gap between turns [m], phi turned since the centre [rad]
    [m] = [m] [rad] / [rad]

    Source:
        Lochmatter and Martinoli 2008 (surge-spiral; remembered, unverified).
    Held by:
        extensions/search/tests/unit/reactive/test_spirals.py (the gap between turns is g)
    """
    return gap_m * angle_rad / FULL_TURN_RAD


def spiral_length_m(gap_m: float, angle_rad: float) -> float:
    """Return the length of an Archimedean spiral from its centre.

    s(phi) = a / 2 (phi sqrt(1 + phi^2) + asinh(phi))        a = g / (2 pi) [m]
    [m] = [m] [1]

    Source:
        Our integral of ds = sqrt(r^2 + a^2) dphi.
    Held by:
        extensions/search/tests/unit/reactive/test_spirals.py (a fine polygon has the same length)
    """
    slant = norm2(1.0, angle_rad)
    return gap_m / (2.0 * FULL_TURN_RAD) * (angle_rad * slant + elementary.log(angle_rad + slant))


def arc_turn_rad(gap_m: float, radius_m: float, arc_m: float) -> float:
    """Return by how much a spiral turns over a short arc.

    dphi = ds / sqrt(r^2 + (g / (2 pi))^2)
    [rad] = [m] / [m]

    Source:
        Lochmatter and Martinoli 2008 (remembered, unverified); exact in the limit of short arcs.
    Held by:
        extensions/search/tests/unit/reactive/test_spirals.py (it is the slope of the length)
    """
    return arc_m / norm2(radius_m, gap_m / FULL_TURN_RAD)


def spiral_angle_rad(gap_m: float, length_m: float) -> float:
    """Return the angle of a spiral after a length from its centre: the inverse of `spiral_length_m`.

    phi <- phi + dphi((s - s(phi)))        Newton's iteration with `arc_turn_rad`, from phi = sqrt(4 pi s / g)

    The start is the angle of a wide spiral, where s = a phi^2 / 2, and is never too small; s is convex, so that the
    iteration falls towards the root and cannot leave it.

    Held by:
        extensions/search/tests/unit/reactive/test_spirals.py (it inverts the length)
    """
    angle_rad = math.sqrt(2.0 * FULL_TURN_RAD * length_m / gap_m)
    for _ in range(_NEWTON_STEPS):
        missing_m = length_m - spiral_length_m(gap_m, angle_rad)
        turn_rad = arc_turn_rad(gap_m, spiral_radius_m(gap_m, angle_rad), missing_m)
        angle_rad += turn_rad
        if abs(turn_rad) < _NEWTON_STOPS_RAD * max(1.0, angle_rad):
            break
    return angle_rad


class ArchimedeanSpiral:
    """The places of a spiral at equal arcs from each other.

    Deviation:
        The arcs are exact. Steps by `arc_turn_rad` from the old radius would turn by 5 radians at once at the centre,
        where the radius is 0, and leave out the inner turn.
    """

    def __init__(self, *, gap_m: float, arc_m: float, start_rad: float, side: int, reach_m: float = math.inf) -> None:
        """Begin at the centre.

        Args:
            gap_m: Distance between neighbouring turns [m].
            arc_m: Way from place to place along the spiral [m].
            start_rad: Direction in which the spiral leaves its centre, world frame [rad].
            side: +1 turns to the left (counter-clockwise), -1 to the right.
            reach_m: The spiral is over at this distance from the centre [m].
        """
        self._gap_m = gap_m
        self._arc_m = arc_m
        self._start_rad = start_rad
        self._side = side
        self._reach_m = reach_m
        self.n_steps = 0

    @property
    def radius_m(self) -> float:
        """Distance of the last place from the centre [m]."""
        return spiral_radius_m(self._gap_m, spiral_angle_rad(self._gap_m, self.n_steps * self._arc_m))

    def next_offset_m(self) -> tuple[float, float] | None:
        """Return the next place, from the centre of the spiral, world frame [m], or nothing when it is over."""
        if self.radius_m >= self._reach_m:
            return None
        self.n_steps += 1
        turned_rad = spiral_angle_rad(self._gap_m, self.n_steps * self._arc_m)
        radius_m = spiral_radius_m(self._gap_m, turned_rad)
        direction_rad = self._start_rad + self._side * turned_rad
        return radius_m * elementary.cos(direction_rad), radius_m * elementary.sin(direction_rad)


class SquareSpiral:
    """The corners of a square spiral: legs at right angles that grow.

    L(n) = L0 + G floor(n / 2)        leg n = 0, 1, ...; L0 first side, G growth every second leg [m]

    With L0 = G it is the spiral 1, 1, 2, 2, 3, 3, ...; `legs_per_growth` 1 gives 1, 2, 3, 4, ...

    Source:
        Side and growth as in the surge-spiral of the MAPIR group (Ojeda et al.), read in code.
    """

    def __init__(
        self,
        *,
        side_m: float,
        growth_m: float,
        heading_rad: float,
        side: int,
        legs_per_growth: int = 2,
        n_sides: float = math.inf,
    ) -> None:
        """Begin at the centre.

        Args:
            side_m: Length of the first leg [m].
            heading_rad: Direction of the first leg, world frame [rad].
            side: +1 turns to the left after each leg, -1 to the right.
            legs_per_growth: After how many legs they grow.
            n_sides: The spiral is over after so many legs.
        """
        self._side_m = side_m
        self._growth_m = growth_m
        self._heading_rad = heading_rad
        self._side = side
        self._legs_per_growth = legs_per_growth
        self._n_sides = n_sides
        self._x_m = 0.0
        self._y_m = 0.0
        self.n_legs = 0

    @property
    def next_length_m(self) -> float:
        """Length of the leg to come [m]."""
        return self._side_m + self._growth_m * (self.n_legs // self._legs_per_growth)

    def next_offset_m(self) -> tuple[float, float] | None:
        """Return the next corner, from the centre of the spiral, world frame [m], or nothing when it is over."""
        if self.n_legs >= self._n_sides:
            return None
        heading_rad = self._heading_rad + self._side * RIGHT_ANGLE_RAD * (self.n_legs % 4)
        length_m = self.next_length_m
        self._x_m += length_m * elementary.cos(heading_rad)
        self._y_m += length_m * elementary.sin(heading_rad)
        self.n_legs += 1
        return self._x_m, self._y_m


class Spiral(Protocol):
    """Either of them."""

    def next_offset_m(self) -> tuple[float, float] | None:
        """Return the next place, from the centre of the spiral, world frame [m], or nothing when it is over."""
        ...


class SpiralPath:
    """A spiral in a room: blocked places are left out, and after too many of them in a row it is over.

    State: that of the spiral, and whether it ended at a wall.

    Source:
        Skipping up to 3 blocked corners as in the MAPIR group's surge-spiral, read in code.
    """

    def __init__(
        self,
        spiral: Spiral,
        centre_m: Sequence[float],
        *,
        is_free: Callable[[tuple[float, float]], bool],
        n_skips: int,
    ) -> None:
        """Begin at the centre.

        Args:
            is_free: Whether a place [m] can be flown to.
            n_skips: How many blocked places in a row are left out.
        """
        self._spiral = spiral
        self._centre_m = (centre_m[0], centre_m[1])
        self._is_free = is_free
        self._n_skips = n_skips
        self.is_blocked = False

    def next_place_m(self) -> tuple[float, float] | None:
        """Return the next place that can be flown to, world frame [m], or nothing when the spiral is over."""
        for _ in range(self._n_skips + 1):
            offset_m = self._spiral.next_offset_m()
            if offset_m is None:
                return None
            place_m = (self._centre_m[0] + offset_m[0], self._centre_m[1] + offset_m[1])
            if self._is_free(place_m):
                return place_m
        self.is_blocked = True
        return None


def random_side(draws: RandomStream) -> int:
    """Return +1 (left) or -1 (right) with equal chance; costs one draw."""
    return 1 if draws.fraction() < 0.5 else -1


def leaf_radius_m(radius_m: float, angle_rad: float) -> float:
    """Return the distance from the centre of a leaf of a rose with four leaves.

    r(phi) = R cos(2 phi)        phi from the leaf's axis, within an eighth of a turn to either side [rad]
    [m] = [m]
    """
    return radius_m * elementary.cos(2.0 * angle_rad)


@dataclass(kw_only=True)
class CloverleafPath:
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
            self.centre_m[0] + distance_m * elementary.cos(direction_rad),
            self.centre_m[1] + distance_m * elementary.sin(direction_rad),
        )
