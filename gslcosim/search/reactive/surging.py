"""Surges: legs up the wind from where there is gas."""

import math
from collections.abc import Sequence


def surge_place_m(
    here_m: Sequence[float], gas_m: Sequence[float] | None, upwind_rad: float, step_m: float
) -> tuple[float, float]:
    """Return where a surge ends: a step upwind, on the line upwind through the gas.

    p = x + L u + ((g - x) . n) n        u unit vector upwind, n across it to the left, g place of gas, x here
    [m] = [m] + [m] [1] + [m] [1]

    A vehicle that smells gas at one moment of a long cast and is asked at its end goes back sideways to the plume, and
    loses nothing of what it gained upwind.

    Args:
        here_m: Where the vehicle is, world frame [m]; a height is left out.
        gas_m: Where gas was met on the last leg; absent: straight upwind [m].
        upwind_rad: Where the wind comes from [rad].
        step_m: L, how far upwind [m].

    Held by:
        tests/unit/search/reactive/test_surging.py
    """
    along_x, along_y = math.cos(upwind_rad), math.sin(upwind_rad)
    across_m = 0.0
    if gas_m is not None:
        across_m = (gas_m[1] - here_m[1]) * along_x - (gas_m[0] - here_m[0]) * along_y
    return (
        here_m[0] + step_m * along_x - across_m * along_y,
        here_m[1] + step_m * along_y + across_m * along_x,
    )


def oblique_place_m(
    here_m: Sequence[float], gas_m: Sequence[float] | None, upwind_rad: float, slant_rad: float, step_m: float
) -> tuple[float, float]:
    """Return where a leg aslant to the wind ends: as `surge_place_m`, turned to the left by the slant.

    p = x + L (cos b u + sin b n) + ((g - x) . n) n        b slant, positive to the left looking upwind [rad]

    Held by:
        tests/unit/search/reactive/test_surging.py
    """
    x_m, y_m = surge_place_m(here_m, gas_m, upwind_rad, step_m * math.cos(slant_rad))
    across_m = step_m * math.sin(slant_rad)
    return x_m - across_m * math.sin(upwind_rad), y_m + across_m * math.cos(upwind_rad)
