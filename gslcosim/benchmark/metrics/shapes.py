"""What the figures take: series of times, values and points of the same length."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gslcosim.errors import ShapeError

Array = NDArray[np.float64]


def as_series(name: str, values: ArrayLike, *, n: int | None = None) -> Array:
    """Return (n,) values as floats.

    Args:
        name: What the message calls them.
        values: At least one number.
        n: How many there must be; absent: any number.

    Raises:
        ShapeError: they are not a row of that many numbers.
    """
    series = np.asarray(values, dtype=np.float64)
    if series.ndim != 1 or not len(series) or (n is not None and len(series) != n):
        expected = f"({n},)" if n is not None else "(n,), n > 0"
        raise ShapeError(f"{name}: expected shape {expected}, was {series.shape}. Pass one value for each time.")
    return series


def as_points(name: str, points_m: ArrayLike) -> Array:
    """Return (n, 3) points as floats; a single point becomes (1, 3).

    Raises:
        ShapeError: they are no points in space, or there is none.
    """
    points = np.atleast_2d(np.asarray(points_m, dtype=np.float64))
    if points.ndim != 2 or points.shape[1] != 3 or not len(points):
        raise ShapeError(f"{name}: expected shape (n, 3), n > 0, was {points.shape}. Pass x, y and z of each point.")
    return points
