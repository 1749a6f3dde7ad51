"""Scalar kernels: a model's formulas as plain functions, called as they are for one and compiled for many.

One text serves both: a service calls it for each instrument, in plain Python, and batches of searches compile it and
call it for thousands. So a kernel contains only what gives the same bits in both: numbers, sequences read and written
by an index, what `math` computes exactly, `elementary`, the built-in `abs`, `min`, `max` and `range`, other kernels,
and the functions below. It creates no lists, tuples or slices, and draws random numbers from the stream in its
arguments.
"""

import math
from collections.abc import Callable, Sequence
from typing import Any, TypeVar

from gslcosim.base import elementary

Kernel = TypeVar("Kernel", bound=Callable[..., Any])

NORMAL_TAIL = 3.6541528853610088
"""Where the tail of numpy's ziggurat for the normal distribution begins."""
_KERNELS: list[Callable[..., Any]] = []


def scalar_kernel(function: Kernel) -> Kernel:
    """Mark a function of a module as a scalar kernel, and return it unchanged.

    The mark lets other compiled code call it, and makes kernels compiled before its last change stale; see
    `gslcosim.base.kernel_cache`.

    Held by:
        tests/unit/test_scalar_kernels.py
    """
    _KERNELS.append(function)
    return function


def list_scalar_kernels() -> tuple[Callable[..., Any], ...]:
    """Return all functions that are marked so far, in the order of their import."""
    return tuple(_KERNELS)


@scalar_kernel
def exact_sum(values: Sequence[float], first: int, n: int) -> float:
    """Return the sum of n values from the first on, all of one sign, rounded once as `math.fsum` does.

    Source:
        Ogita, Rump and Oishi 2005, Sum2, doi:10.1137/030601818.
    Held by:
        tests/unit/test_scalar_kernels.py
    """
    total = error = 0.0
    for k in range(first, first + n):
        before, value = total, values[k]
        total = before + value
        added = total - before
        error += (before - (total - added)) + (value - added)
    return total + error


@scalar_kernel
def norm2(x: float, y: float) -> float:
    """Return sqrt(x^2 + y^2), the same on every processor; within two units in the last place."""
    return math.sqrt(x * x + y * y)


@scalar_kernel
def norm3(x: float, y: float, z: float) -> float:
    """Return sqrt(x^2 + y^2 + z^2), the same on every processor; within two units in the last place."""
    return math.sqrt(x * x + y * y + z * z)


def distance(a: Sequence[float], b: Sequence[float]) -> float:
    """Return the distance of two points of two or three coordinates each."""
    return norm2(a[0] - b[0], a[1] - b[1]) if len(a) == 2 else norm3(a[0] - b[0], a[1] - b[1], a[2] - b[2])


@scalar_kernel
def tail_normal(u: float, v: float) -> float:
    """Return a number of the normal distribution beyond `NORMAL_TAIL`, or 0 where the two uniform ones are rejected.

    Source:
        Marsaglia 1964, Technometrics 6, 101-102, doi:10.1080/00401706.1964.10490150.
    """
    excess = -elementary.log1p(-u) / NORMAL_TAIL
    return NORMAL_TAIL + excess if -2.0 * elementary.log1p(-v) > excess * excess else 0.0


# Batches have compiled twins of the functions below.


def next_normal(stream: Any) -> float:
    """Draw a number from the standard normal distribution.

    Args:
        stream: A `gslcosim.base.rng.RandomStream`, or its state in compiled code.
    """
    return stream.standard_normal()


def next_poisson(stream: Any, mean: float) -> float:
    """Draw a number from the Poisson distribution of a mean.

    Args:
        stream: A `gslcosim.base.rng.RandomStream`, or its state in compiled code.
        mean: Its mean, >= 0.
    """
    return float(stream.poisson(mean))
