"""Rows of a gas tape as the arrays that readings take."""
# pyright: basic

import numba
import numpy as np


@numba.njit(cache=True, nogil=True)
def places_and_sizes(rows):
    """Return (n, 3) places and (n,) sizes in double precision of (n, 4) rows of x, y, z, sigma in single, all in [m].

    In one pass: numpy's conversion of columns takes three times as long.

    Held by:
        tests/unit/fields/stored/test_tape.py (a run from tape equals a live one)
    """
    n = rows.shape[0]
    position_m, sigma_m = np.empty((n, 3)), np.empty(n)
    for f in range(n):
        position_m[f, 0] = rows[f, 0]
        position_m[f, 1] = rows[f, 1]
        position_m[f, 2] = rows[f, 2]
        sigma_m[f] = rows[f, 3]
    return position_m, sigma_m
