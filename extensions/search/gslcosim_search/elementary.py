# pyright: basic
"""Elementary functions with the same bits on every processor: those of the core, and more of the same kind.

Search methods take them in place of those of `math`, numpy and BLAS, so that the same observations give the same
commands everywhere.

Held by:
    extensions/search/tests/unit/test_elementary.py
    tests/architecture/test_elementary_functions.py
"""

# ruff: noqa: A004 - a power is named `pow`

import math
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gslcosim.base import scalar_kernels
from gslcosim.base.elementary_kernels import *  # noqa: F403 - all of them
from gslcosim.base.elementary_kernels import (
    atan2,
    atan2_each,
    cbrt,
    cos,
    exp,
    exp_each,
    expm1,
    expm1_each,
    log,
    log1p,
    log2,
    log10,
    log_each,
    pow,
    pow_each,
    product,
    sin,
)
from gslcosim.base.scalar_kernels import norm2 as norm2
from gslcosim.base.scalar_kernels import norm3 as norm3
from gslcosim.base.scalar_kernels import scalar_kernel

Array = NDArray[np.float64]
Point = Sequence[float] | Array
# With points that may be arrays.
distance: Callable[[Point, Point], float] = scalar_kernels.distance  # type: ignore[assignment]


@scalar_kernel
def tanh(x: float) -> float:
    """Return the hyperbolic tangent of x, within three units in the last place."""
    e = expm1(-2.0 * abs(x))
    return math.copysign(e / (2.0 + e), x)


def tanh_each(x: ArrayLike) -> Array:
    """Return `tanh` of each number."""
    numbers = np.asarray(x, np.float64)
    e = expm1_each(-2.0 * np.abs(numbers))
    return np.copysign(e / (2.0 + e), numbers)


def warm_up() -> None:
    """Compile what methods call from Python, or load it from the cache on disk, so that no decision waits for it."""
    for function in (cbrt, cos, exp, expm1, log, log10, log1p, log2, sin):
        function(0.5)
    for function in (atan2, pow):
        function(0.5, 0.5)
    for function in (atan2_each, pow_each):
        function([0.5], [0.5])
    for function in (exp_each, log_each):
        function([0.5])
    product([[0.5]], [0.5])
