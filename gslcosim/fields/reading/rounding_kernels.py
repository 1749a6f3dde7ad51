"""Filaments in single precision, as readings see them."""
# pyright: basic

import numba
import numpy as np


@numba.njit(cache=True, nogil=True)
def rows_in_single_precision(position_m, sigma_m):
    """Return (n, 4) float32 rows of x, y, z and sigma [m] from (n, 3) places and (n,) sizes."""
    rows = np.empty((len(sigma_m), 4), np.float32)
    for i in range(len(sigma_m)):
        rows[i, 0] = position_m[i, 0]
        rows[i, 1] = position_m[i, 1]
        rows[i, 2] = position_m[i, 2]
        rows[i, 3] = sigma_m[i]
    return rows
