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

import numba
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
_STIRLING = (
    1.0 / 12.0, -1.0 / 360.0, 1.0 / 1260.0, -1.0 / 1680.0, 1.0 / 1188.0, -691.0 / 360360.0, 1.0 / 156.0,
    -3617.0 / 122400.0,
)  # fmt: skip
# With points that may be arrays.
distance: Callable[[Point, Point], float] = scalar_kernels.distance  # type: ignore[assignment]


@scalar_kernel
def tanh(x: float) -> float:
    """Return the hyperbolic tangent of x, within three units in the last place."""
    e = expm1(-2.0 * abs(x))
    return math.copysign(e / (2.0 + e), x)


@numba.njit(cache=True, nogil=True)
def lgamma(x):  # noqa: ANN001, ANN201 - a kernel
    """Return the logarithm of the gamma function for finite x > 0, else NaN, within 1e-14 or 1e-14 of its value.

    log Gamma(x) = log Gamma(x + n) - log(x (x + 1) ... (x + n - 1)), the first by Stirling's series from 10 on.

    Source:
        DLMF 5.5.1 and 5.11.1.
    """
    if not 0.0 < x < math.inf:
        return math.nan
    factors = 1.0
    while x < 10.0:
        factors *= x
        x += 1.0
    z = 1.0 / (x * x)
    series = _STIRLING[-1]
    for i in range(len(_STIRLING) - 2, -1, -1):
        series = _STIRLING[i] + z * series
    return (((x - 0.5) * log(x) - x) + 0.9189385332046727) + (series / x - log(factors))


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
