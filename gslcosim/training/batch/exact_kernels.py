"""Distances as Python's `math` has them, to the last bit, in compiled code."""
# pyright: basic, reportCallIssue=false

import math

from gslcosim.training.batch.reference_free_kernels import reference_free_njit

_SPLIT = 134217729.0  # 2^27 + 1


@reference_free_njit(inline="always")
def _add_square(x, total, a, b, c):
    # Adds x^2 to a sum kept in one large and three small parts.
    t = x * _SPLIT
    high = t - (t - x)
    low = x - high
    square = high * high
    before = total
    total += square
    a += (before - total) + square
    square = 2.0 * high * low
    before = total
    total += square
    b += (before - total) + square
    c += low * low
    return total, a, b, c


@reference_free_njit()
def norm3(x, y, z):
    """Return sqrt(x^2 + y^2 + z^2), the same as `math.hypot(x, y, z)` and as `math.dist` of points so far apart.

    Source:
        CPython 3.11, Modules/mathmodule.c, vector_norm: sums of squares without rounding error, corrected once.
    Held by:
        tests/unit/training/batch/test_exact_kernels.py
    """
    x, y, z = abs(x), abs(y), abs(z)
    most = max(x, y, z)
    if most == 0.0 or not most < math.inf:
        return most
    _, exponent = math.frexp(most)
    scale = math.ldexp(1.0, -exponent)
    total, a, b, c = 1.0, 0.0, 0.0, 0.0
    total, a, b, c = _add_square(x * scale, total, a, b, c)
    total, a, b, c = _add_square(y * scale, total, a, b, c)
    total, a, b, c = _add_square(z * scale, total, a, b, c)
    h = math.sqrt(total - 1.0 + (a + b + c))
    t = h * _SPLIT
    high = t - (t - h)
    low = h - high
    square = -high * high
    before = total
    total += square
    a += (before - total) + square
    square = -2.0 * high * low
    before = total
    total += square
    b += (before - total) + square
    square = -low * low
    before = total
    total += square
    c += (before - total) + square
    rest = total - 1.0 + (a + b + c)
    return (h + rest / (2.0 * h)) / scale


@reference_free_njit()
def norm2(x, y):
    """Return sqrt(x^2 + y^2), the same as `math.hypot(x, y)`.

    Held by:
        tests/unit/training/batch/test_exact_kernels.py
    """
    return norm3(x, y, 0.0)


@reference_free_njit()
def exact_sum(values, n, parts):
    """Return the sum of the first n values, rounded once, the same as `math.fsum`.

    Args:
        values: (n or more,) numbers.
        n: How many.
        parts: (64,) scratch.

    Source:
        Shewchuk 1997, doi:10.1007/PL00009321; CPython 3.11, Modules/mathmodule.c, fsum.
    Held by:
        tests/unit/training/batch/test_exact_kernels.py
    """
    n_parts = 0
    for k in range(n):
        x = values[k]
        i = 0
        for j in range(n_parts):
            y = parts[j]
            if abs(x) < abs(y):
                x, y = y, x
            high = x + y
            low = y - (high - x)
            if low != 0.0:
                parts[i] = low
                i += 1
            x = high
        n_parts = i
        if x != 0.0:
            parts[n_parts] = x
            n_parts += 1
    if n_parts == 0:
        return 0.0
    n_parts -= 1
    high, low = parts[n_parts], 0.0
    while n_parts > 0:
        x = high
        n_parts -= 1
        y = parts[n_parts]
        high = x + y
        low = y - (high - x)
        if low != 0.0:
            break
    if n_parts > 0 and ((low < 0.0 and parts[n_parts - 1] < 0.0) or (low > 0.0 and parts[n_parts - 1] > 0.0)):
        y = low * 2.0
        x = high + y
        if y == x - high:
            high = x
    return high
