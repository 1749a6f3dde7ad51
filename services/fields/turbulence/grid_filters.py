# pyright: basic
# ruff: noqa: ANN001, ANN202 - kernels have no types
"""Nearest cells and Gaussian means on grids, equal to those of `scipy.ndimage` to the bit."""

import math
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from gslcosim.base import elementary

_NONE = np.iinfo(np.int64).max // 4


def find_nearest(mask: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Return the index of the nearest cell of a mask for each cell, by Euclidean distance in cells.

    Of cells as near as each other the one with the lowest index along the last axis counts, then along those before.

    Args:
        mask: (nx, ny, nz) with at least one true cell.

    Returns:
        (3, nx, ny, nz) indices along x, y, z.

    Source:
        Distances axis by axis: Maurer et al. 2003, IEEE Transactions on Pattern Analysis and Machine Intelligence 25,
        265, doi:10.1109/TPAMI.2003.1177156.

    Held by:
        tests/unit/services/fields/turbulence/test_grid_filters.py (equal to `scipy.ndimage.distance_transform_edt`)
    """
    squares = np.where(mask, 0, _NONE)
    nearest = np.indices(mask.shape)
    for axis in range(3):
        lines = np.moveaxis(squares, axis, -1)
        squares_along, index = _nearest_along(np.ascontiguousarray(lines))
        squares, index = np.moveaxis(squares_along, -1, axis), np.moveaxis(index, -1, axis)
        nearest = np.stack([np.take_along_axis(each, index, axis) for each in nearest])
    return nearest


# From each cell outward: the first line of a tie is the lower one.
@numba.njit(cache=True, nogil=True)
def _nearest_along(squares):
    nx, ny, n = squares.shape
    least, index = np.empty_like(squares), np.zeros_like(squares)
    for i in range(nx):
        for j in range(ny):
            for k in range(n):
                best, at, d = squares[i, j, k], k, 1
                while d < n and d * d <= best:
                    if k - d >= 0 and squares[i, j, k - d] + d * d <= best and squares[i, j, k - d] < _NONE:
                        best, at = squares[i, j, k - d] + d * d, k - d
                    if k + d < n and squares[i, j, k + d] + d * d < best:
                        best, at = squares[i, j, k + d] + d * d, k + d
                    d += 1
                least[i, j, k], index[i, j, k] = best, at
    return least, index


def distance_to(mask: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Return the distance of each cell's centre to the nearest of a mask, in cells."""
    offsets = find_nearest(mask) - np.indices(mask.shape)
    return np.sqrt((offsets * offsets).sum(axis=0).astype(np.float64))


def smooth_gaussian(values: NDArray[np.float64], width: float) -> NDArray[np.float64]:
    """Return means of (nx, ny, nz) values weighted by a Gaussian of a width in cells, cut at three widths.

    Beyond the border all is zero.
    """
    reach = math.floor(3.0 * width + 0.5)
    offsets = np.arange(-reach, reach + 1)
    weights = elementary.exp_each(-0.5 / (width * width) * (offsets * offsets))
    weights = weights / weights.sum()
    for axis in range(3):
        around: list[Any] = [(0, 0)] * 3
        around[axis] = (reach, reach)
        padded = np.moveaxis(np.pad(values, around), axis, 0)
        n = values.shape[axis]
        mean = padded[reach : reach + n] * weights[reach]
        for i in range(reach):
            mean += (padded[i : i + n] + padded[2 * reach - i : 2 * reach - i + n]) * weights[i]
        values = np.ascontiguousarray(np.moveaxis(mean, 0, axis))
    return values
