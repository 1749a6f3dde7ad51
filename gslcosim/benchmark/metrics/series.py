"""Fewer samples for files and pictures."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gslcosim.benchmark.metrics.shapes import as_series
from gslcosim.errors import ShapeError

# Times are ticks in seconds, which floating point rounds.
_ROUNDING_S = 1e-6


def kept_samples(t_s: ArrayLike, *, every_s: float = 1.0) -> NDArray[np.int64]:
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


def thin_to_seconds(t_s: ArrayLike, *values: ArrayLike) -> tuple[NDArray[np.float64], ...]:
    """Return a series with about one sample a second and the last; see `kept_samples`.

    Args:
        t_s: (n,) times, growing [s].
        values: Arrays with n rows; they are not changed.

    Returns:
        The kept times, then the kept rows of each array.

    Raises:
        ShapeError: an array has another number of rows.
    """
    times_s = as_series("t_s", t_s)
    kept = kept_samples(times_s)
    columns = [np.asarray(column, dtype=np.float64) for column in values]
    for i, column in enumerate(columns):
        if column.ndim == 0 or len(column) != len(times_s):
            raise ShapeError(f"values {i}: expected {len(times_s)} rows, one for each time, was {column.shape}.")
    return times_s[kept], *(column[kept] for column in columns)
