"""Casts across the wind to meet a lost plume again, and surges up the wind from gas.

A cast keeps the wind of the moment at which it began: a vehicle that turns with every gust does not cross a plume.

Held by:
    extensions/search/tests/unit/reactive/test_cast_and_surge.py
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

from gslcosim_search import elementary
from gslcosim_search.random_stream import RandomStream

RIGHT_ANGLE_RAD = 1.5707963267948966
ON_LINE_M = 0.001


def cast_length_m(width_m: float, n: int, growth: str) -> float:
    """Return the length of one leg of a cast.

    growing    L(n) = (n + 1) d        d, 2 d, 3 d, ...: turns at +d, -d, +2 d, -2 d, ...
    fixed      L(0) = d, L(n) = 2 d    turns at +d, -d, +d, -d, ...
    doubling   L(n) = 2^n d            d, 2 d, 4 d, ...
    [m] = [m]

    Args:
        width_m: First leg d [m].
        n: Number of the leg, from 0.
        growth: `growing`, `fixed` or `doubling`.

    Source:
        Lochmatter and Martinoli 2008: d, then 2 d the other way (remembered, unverified); doubling as in the recovery
        of Rando et al. 2025, read in code. That growing casts beat fixed ones is mothpy's result.
    """
    if growth == "doubling":
        return math.ldexp(width_m, n)
    return width_m * (min(n, 1) + 1 if growth == "fixed" else n + 1)


def cast_offset_m(width_m: float, n: int, growth: str) -> float:
    """Return the crosswind offset of the end of leg `n` of a cast from its start, positive on its first side [m].

    y(n) = sum over k <= n of (-1)^k L(k)
    """
    return math.fsum((1 - 2 * (k % 2)) * cast_length_m(width_m, k, growth) for k in range(n + 1))


def crosswind_unit(upwind_rad: float, side: int) -> tuple[float, float]:
    """Return the horizontal direction across the wind, looking upwind: side +1 to the left, -1 to the right."""
    across_rad = upwind_rad + side * RIGHT_ANGLE_RAD
    return elementary.cos(across_rad), elementary.sin(across_rad)


@dataclass(kw_only=True)
class CastSequence:
    """A cast from where a plume was lost: the places at which it turns. It remembers how many it has given.

    Args:
        anchor_m: Where it begins: where gas was met last, world frame [m].
        upwind_rad: Where the wind came from at that moment; it keeps to that [rad].
        side: First side, looking upwind: +1 left, -1 right.
        width_m: Length of the first leg [m].
        growth: How its legs grow; see `cast_length_m`.
        n_legs: After how many legs it is over.
    """

    anchor_m: tuple[float, float]
    upwind_rad: float
    side: int
    width_m: float
    growth: str = "growing"
    n_legs: int = 2
    n_done: int = field(default=0, init=False)

    def next_turn_m(self) -> tuple[float, float] | None:
        """Return the end of the next leg, world frame [m], or nothing when the cast is over."""
        if self.n_done >= self.n_legs:
            return None
        offset_m = cast_offset_m(self.width_m, self.n_done, self.growth)
        self.n_done += 1
        across_x, across_y = crosswind_unit(self.upwind_rad, self.side)
        return self.anchor_m[0] + offset_m * across_x, self.anchor_m[1] + offset_m * across_y


@dataclass(kw_only=True)
class PlaneCastSequence:
    """A cast in the plane across the wind: to one side, to the other, up, down, and then farther.

    offsets (across, up) = (+w, 0), (-w, 0), (0, +h), (0, -h), (+2 w, 0), ...        w width, h height of the cast [m]

    Args:
        anchor_m: Where gas was met last, world frame [m].
        upwind_rad: Where the wind came from at that moment [rad].
        side: First side, looking upwind: +1 left, -1 right.
        lift: +1 climbs before it dips, -1 dips first.
        width_m: How far it goes to a side at first [m].
        height_m: How far it climbs and dips at first [m].
        n_legs: After how many legs it is over.

    Source:
        Rahbar, Marjovi, Kibleur, Martinoli 2017: casts in the plane across the wind (remembered, unverified).
    Deviation:
        The order and the growth are ours: each round covers a cross, and the next one a larger cross.
    """

    anchor_m: tuple[float, float, float]
    upwind_rad: float
    side: int
    lift: int
    width_m: float
    height_m: float
    n_legs: int = 8
    n_done: int = field(default=0, init=False)

    def next_turn_m(self) -> tuple[float, float, float] | None:
        """Return the end of the next leg, world frame [m], or nothing when the cast is over."""
        if self.n_done >= self.n_legs:
            return None
        reach, sign = self.n_done // 4 + 1, 1 - 2 * (self.n_done % 2)
        is_level = self.n_done % 4 < 2
        self.n_done += 1
        across_m = sign * reach * self.width_m if is_level else 0.0
        up_m = 0.0 if is_level else sign * self.lift * reach * self.height_m
        across_x, across_y = crosswind_unit(self.upwind_rad, self.side)
        x_m, y_m, z_m = self.anchor_m
        return x_m + across_m * across_x, y_m + across_m * across_y, z_m + up_m


def find_side(place_m: Sequence[float], anchor_m: Sequence[float], upwind_rad: float) -> int:
    """Return on which side of the line upwind through an anchor a place lies: +1 left, -1 right, 0 on it.

    sign of the cross product (u x (p - a)) . z        u unit vector upwind; within a millimetre of the line it is 0,
    so that the last bit of a sine chooses no side

    It tells on which side gas was seen to vanish: a vehicle that left the plume at its left edge finds it to its right.

    Args:
        anchor_m: A place on the line, world frame [m].
        upwind_rad: Direction of the line [rad].
    """
    dx_m, dy_m = place_m[0] - anchor_m[0], place_m[1] - anchor_m[1]
    cross_m = elementary.cos(upwind_rad) * dy_m - elementary.sin(upwind_rad) * dx_m
    return int(cross_m > ON_LINE_M) - int(cross_m < -ON_LINE_M)


def side_or_random(place_m: Sequence[float], anchor_m: Sequence[float], upwind_rad: float, draws: RandomStream) -> int:
    """Return on which side a place lies, as `find_side`; on neither: +1 or -1 with equal chance, which costs a draw."""
    side = find_side(place_m, anchor_m, upwind_rad)
    if side == 0:
        return 1 if draws.fraction() < 0.5 else -1
    return side


class BlankMemory:
    """Time to wait for gas before the plume counts as lost: as long as the last blank was.

    T <- length of the last blank that a hit has ended [s], kept within [least, most]

    A blank is the time between two hits; hits closer than `shortest_blank_s` belong together. Near the source blanks
    are short and a vehicle turns back at once; far away it waits. No time has to be tuned.

    Source:
        Rando, James, Verri, Rosasco, Seminara 2025 (arXiv 2404.17495), the adaptive memory; read in code.
    Deviation:
        In seconds, with bounds: there in steps, without.
    """

    def __init__(self, *, first_s: float, least_s: float, most_s: float, shortest_blank_s: float = 0.0) -> None:
        """Begin with the memory `first_s`, before any gas was met."""
        self._least_s = least_s
        self._most_s = most_s
        self._shortest_blank_s = shortest_blank_s
        self._last_hit_s: float | None = None
        self.memory_s = min(max(first_s, least_s), most_s)

    def note_hit(self, time_s: float) -> None:
        """Take note of gas at a time [s]; times do not fall."""
        if self._last_hit_s is not None and time_s - self._last_hit_s > self._shortest_blank_s:
            self.memory_s = min(max(time_s - self._last_hit_s, self._least_s), self._most_s)
        self._last_hit_s = time_s

    def blank_s(self, time_s: float) -> float:
        """Return the time since the last gas [s]; infinite before the first."""
        return math.inf if self._last_hit_s is None else time_s - self._last_hit_s

    def is_lost(self, time_s: float) -> bool:
        """Return True if there has been no gas for longer than the last blank."""
        return self.blank_s(time_s) > self.memory_s


def surge_end_m(
    here_m: Sequence[float], gas_m: Sequence[float] | None, upwind_rad: float, step_m: float
) -> tuple[float, float]:
    """Return the end of a surge: a step upwind, on the line upwind through the gas.

    p = x + L u + ((g - x) . n) n        u unit vector upwind, n across it to the left, g place of gas, x here
    [m] = [m] + [m] [1] + [m] [1]

    A vehicle that smells gas at one moment of a long cast and is asked at its end goes back sideways to the plume, and
    loses nothing of what it gained upwind.

    Args:
        here_m: Where the vehicle is, world frame [m]; a height is left out.
        gas_m: Where gas was met on the last leg; absent: straight upwind [m].
        step_m: L, how far upwind [m].
    """
    along_x, along_y = elementary.cos(upwind_rad), elementary.sin(upwind_rad)
    across_m = 0.0
    if gas_m is not None:
        across_m = (gas_m[1] - here_m[1]) * along_x - (gas_m[0] - here_m[0]) * along_y
    return (
        here_m[0] + step_m * along_x - across_m * along_y,
        here_m[1] + step_m * along_y + across_m * along_x,
    )


def oblique_surge_end_m(
    here_m: Sequence[float], gas_m: Sequence[float] | None, upwind_rad: float, slant_rad: float, step_m: float
) -> tuple[float, float]:
    """Return the end of a leg oblique to the wind: as `surge_end_m`, turned to the left by the slant.

    p = x + L (cos b u + sin b n) + ((g - x) . n) n        b slant, positive to the left looking upwind [rad]
    """
    x_m, y_m = surge_end_m(here_m, gas_m, upwind_rad, step_m * elementary.cos(slant_rad))
    across_m = step_m * elementary.sin(slant_rad)
    return x_m - across_m * elementary.sin(upwind_rad), y_m + across_m * elementary.cos(upwind_rad)
