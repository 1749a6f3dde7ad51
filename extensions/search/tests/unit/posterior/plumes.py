"""A plume with lulls on lanes through a room, for tests of what finds its source."""

import math

import numpy as np

from gslcosim.contract.messages import Bounds

BOUNDS = Bounds(min_m=(0.0, 0.0, 0.0), max_m=(16.0, 12.0, 3.0))
SOURCE_M = (5.2, 7.3)
THRESHOLD = 0.1


def lanes():
    """Places along lanes two metres apart, one a second at 0.5 m/s."""
    for i, y_m in enumerate(np.arange(1.0, 12.0, 2.0)):
        xs_m = np.arange(0.5, 15.6, 0.5)
        for x_m in xs_m if i % 2 == 0 else xs_m[::-1]:
            yield float(x_m), float(y_m)


def plume_level(place_m, downwind_rad, rng, *, rate=10.0, width_at_source_m=0.3):
    """Level of a Gaussian plume at the height of its source, with lulls, and with levels spread by a factor of two."""
    dx_m, dy_m = place_m[0] - SOURCE_M[0], place_m[1] - SOURCE_M[1]
    x_m = dx_m * math.cos(downwind_rad) + dy_m * math.sin(downwind_rad)
    y_m = dy_m * math.cos(downwind_rad) - dx_m * math.sin(downwind_rad)
    if x_m < 0.0 or rng.random() < 0.3:
        return 0.0
    width_m, height_m = (math.hypot(width_at_source_m, spread * x_m) for spread in (0.15, 0.09))
    mean = rate / (math.tau * 0.5 * width_m * height_m)
    return mean * math.exp(-0.5 * (y_m / width_m) ** 2 + 0.7 * rng.standard_normal())
