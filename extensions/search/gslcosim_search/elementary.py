# pyright: basic
"""Elementary functions with the same bits on every processor: those of the core, and more of the same kind.

Search methods take them in place of those of `math`, numpy and BLAS, so that the same observations give the same
commands everywhere.

Held by:
    extensions/search/tests/unit/test_elementary.py
    tests/architecture/test_elementary_functions.py
"""

# ruff: noqa: A004, ANN001, ANN202 - a power is named `pow`, and kernels have no types

import math
from collections.abc import Callable, Sequence

import numba
import numpy as np
from numpy.typing import ArrayLike, NDArray

from gslcosim.base import scalar_kernels
from gslcosim.base.elementary_kernels import *  # noqa: F403 - all of them
from gslcosim.base.elementary_kernels import (
    atan2,
    cbrt,
    cos,
    exp,
    exp_each,
    expm1,
    log,
    log1p,
    log2,
    log10,
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
# Numbers of the functions of `_fill_each`.
_LOG, _EXPM1, _TANH = range(3)


@scalar_kernel
def tanh(x: float) -> float:
    """Return the hyperbolic tangent of x, within three units in the last place."""
    e = expm1(-2.0 * abs(x))
    return math.copysign(e / (2.0 + e), x)


def log_each(x: ArrayLike) -> Array:
    """Return the natural logarithm of each number; minus infinity of 0."""
    return _each(_LOG, x)


def expm1_each(x: ArrayLike) -> Array:
    """Return e^x - 1 of each number, also near zero."""
    return _each(_EXPM1, x)


def tanh_each(x: ArrayLike) -> Array:
    """Return `tanh` of each number."""
    return _each(_TANH, x)


def atan2_each(y: ArrayLike, x: ArrayLike) -> Array:
    """Return the angle of each direction (x, y) from the x axis, between -pi and pi [rad]."""
    first, second = np.broadcast_arrays(np.asarray(y, np.float64), np.asarray(x, np.float64))
    return _fill_angles(first.flatten(), second.flatten(), np.empty(first.size)).reshape(first.shape)


def _each(function: int, x: ArrayLike) -> Array:
    numbers = np.ascontiguousarray(x, np.float64)
    return _fill_each(function, numbers.reshape(-1), np.empty(numbers.size)).reshape(np.shape(x))


@numba.njit(cache=True, nogil=True)
def _fill_each(function, x, values):
    for i in range(x.size):
        if function == _LOG:
            values[i] = log(x[i])
        elif function == _EXPM1:
            values[i] = expm1(x[i])
        else:
            e = expm1(-2.0 * abs(x[i]))
            values[i] = math.copysign(e / (2.0 + e), x[i])
    return values


@numba.njit(cache=True, nogil=True)
def _fill_angles(y, x, angles_rad):
    for i in range(x.size):
        angles_rad[i] = atan2(y[i], x[i])
    return angles_rad


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
