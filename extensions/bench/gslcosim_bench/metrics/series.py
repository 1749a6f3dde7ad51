"""Series of times, values and points: checks of their shapes, and thinning for files and pictures."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gslcosim.base.errors import ShapeError

Array = NDArray[np.float64]
# Times are ticks in seconds, which floating point rounds.
_ROUNDING_S = 1e-6


def as_series(name: str, values: ArrayLike, *, n: int | None = None) -> Array:
    """Return (n,) values as floats.

    Args:
        n: How many there must be; absent: any number.
    """
    series = np.asarray(values, dtype=np.float64)
    if series.ndim != 1 or not len(series) or (n is not None and len(series) != n):
        expected = f"({n},)" if n is not None else "(n,), n > 0"
        raise ShapeError(f"{name}: expected shape {expected}, was {series.shape}. Pass one value for each time.")
    return series


def as_points(name: str, points_m: ArrayLike) -> Array:
    """Return (n, 3) points as floats; a single point becomes (1, 3)."""
    points = np.atleast_2d(np.asarray(points_m, dtype=np.float64))
    if points.ndim != 2 or points.shape[1] != 3 or not len(points):
        raise ShapeError(f"{name}: expected shape (n, 3), n > 0, was {points.shape}. Pass x, y and z of each point.")
    return points


def select_samples(t_s: ArrayLike, *, every_s: float = 1.0) -> NDArray[np.int64]:
    """Return which samples to keep: the first one, the first in each period, and the last.

    Args:
        t_s: (n,) times, growing [s].
        every_s: The period [s], > 0; the periods begin at whole multiples of it.

    Returns:
        (m,) indices, growing.
    """
    times_s = as_series("t_s", t_s)
    periods = np.floor((times_s + _ROUNDING_S) / every_s)
    _, first = np.unique(periods, return_index=True)
    return np.unique(np.append(first, len(times_s) - 1)).astype(np.int64)
