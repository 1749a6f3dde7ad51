"""Shares of cells in the places from which puffs of gas, carried by the wind, can have come to a sensor."""
# pyright: basic

import math

import numba
import numpy as np

# Beyond this many standard deviations a share is below 1e-15: such cells are left out.
REACH_SIGMAS = 8.0
# A product of many small factors must stay a number whose logarithm there is.
LEAST_PRODUCT = 1e-300


@numba.njit(cache=True)
def _normal_below(x):
    return 0.5 * math.erfc(-x * 0.7071067811865476)


@numba.njit(cache=True)
def _shares_on_axis(low_m, cell_m, n, centre_m, sigma_m, share):
    # Fills share[i] with the normal distribution's mass in cell i; returns the range of cells that it reaches.
    reach_m = REACH_SIGMAS * sigma_m
    first = min(n, max(0, math.floor((centre_m - reach_m - low_m) / cell_m)))
    last = min(n, max(0, math.floor((centre_m + reach_m - low_m) / cell_m) + 1))
    below = _normal_below((low_m + first * cell_m - centre_m) / sigma_m)
    for i in range(first, last):
        above = _normal_below((low_m + (i + 1) * cell_m - centre_m) / sigma_m)
        share[i] = above - below
        below = above
    return first, last


@numba.njit(cache=True)
def trace_puffs(low_m, cell_m, n_x, n_y, sensor_m, displacement_m, variance_m2, detection_probability, sensed_m2):
    """Return what a detection and what its absence say of a source in each cell.

    S_i(l) = integral over cell i of N(s; x - V(l), diag(v_x(l), v_y(l))) ds
    detection: beta_i = (1 / n) sum over l of S_i(l)
    none: ln gamma_i = sum over l of ln(1 - mu min(1, a S_i(l) / A))
    [1] = [m2] [1/m2]; x sensor, V(l) displacement and v(l) variance of the puff released at time l, mu its chance to
    be detected where it is met, A area of a cell, a the area in which the sensor meets a puff.

    Args:
        low_m: (2,) lower corner of cell (0, 0), world frame, xy [m].
        cell_m: Edge of the square cells [m].
        n_x: Number of cells along x.
        n_y: Number of cells along y.
        sensor_m: (2,) place x of the measurement, world frame [m].
        displacement_m: (n_puffs, 2) how far the wind has carried each puff, world frame [m].
        variance_m2: (n_puffs, 2) variance of each puff's random displacement, by axis [m2], > 0.
        detection_probability: mu, from 0 to 1.
        sensed_m2: a, area in which a puff is met [m2].

    Returns:
        beta, (n_x, n_y), and ln gamma, (n_x, n_y); index order (x, y), values belong to whole cells.

    Source:
        Pang and Farrell 2006, Chemical plume source localization, IEEE Trans. SMC-B 36, 1068.
    Deviation:
        The paper takes the density at the cell's centre times its area. That exceeds 1 for a puff smaller than a cell,
        and 1 - mu S is then negative; the integral over the cell does not, and tends to the same in small cells.
        The paper meets a puff where it is in the sensor's cell, a = A; here cells may be smaller than what is met.
    Held by:
        tests/unit/search/bayes/test_puff_tracing.py (against a plain double loop; argmax and spread in uniform wind)
    """
    mean_share = np.zeros((n_x, n_y))
    product = np.ones((n_x, n_y))
    share_x = np.empty(n_x)
    share_y = np.empty(n_y)
    n_puffs = displacement_m.shape[0]
    met = sensed_m2 / (cell_m * cell_m)
    for k in range(n_puffs):
        x_m, y_m = sensor_m[0] - displacement_m[k, 0], sensor_m[1] - displacement_m[k, 1]
        i_0, i_1 = _shares_on_axis(low_m[0], cell_m, n_x, x_m, math.sqrt(variance_m2[k, 0]), share_x)
        j_0, j_1 = _shares_on_axis(low_m[1], cell_m, n_y, y_m, math.sqrt(variance_m2[k, 1]), share_y)
        for i in range(i_0, i_1):
            for j in range(j_0, j_1):
                share = share_x[i] * share_y[j]
                mean_share[i, j] += share
                product[i, j] = max(
                    LEAST_PRODUCT, product[i, j] * (1.0 - detection_probability * min(1.0, met * share))
                )
    if n_puffs > 0:
        mean_share /= n_puffs
    return mean_share, np.log(product)


@numba.njit(cache=True)
def trace_back(sensor_m, n_steps, step_s, low_m, cell_m, wind_m_s):
    """Return how far puffs have come that arrive at a place, through a steady wind that differs from place to place.

    p(m + 1) = p(m) - W(p(m)) dt,  V(m) = x - p(m)
    [m] = [m/s] [s]

    W is linear between the centres of cells, and beyond the outer ones as at the border; with one wind everywhere
    V(m) = m W dt. Walls are no obstacle.

    Args:
        sensor_m: (2,) place x of the measurement, world frame [m].
        n_steps: Number of steps backward.
        step_s: Length of a step dt [s].
        low_m: (2,) lower corner of cell (0, 0), world frame, xy [m].
        cell_m: Edge of the square cells [m].
        wind_m_s: (n_x, n_y, 2) wind at the centres of the cells, world frame [m/s].

    Returns:
        (n_steps + 1, 2) displacements V(0) = 0, V(1), ..., world frame [m].

    Source:
        Ours: displacements along the path in place of one wind for the whole room.
    Accuracy:
        First order in dt (Euler).
    Held by:
        tests/unit/search/bayes/test_puff_tracing.py (uniform wind; a wind of two halves)
    """
    displacement_m = np.zeros((n_steps + 1, 2))
    n_x, n_y = wind_m_s.shape[0], wind_m_s.shape[1]
    x_m, y_m = sensor_m[0], sensor_m[1]
    for step in range(n_steps):
        a = min(max((x_m - low_m[0]) / cell_m - 0.5, 0.0), n_x - 1.0)
        b = min(max((y_m - low_m[1]) / cell_m - 0.5, 0.0), n_y - 1.0)
        i, j = min(int(a), max(n_x - 2, 0)), min(int(b), max(n_y - 2, 0))
        i_1, j_1 = min(i + 1, n_x - 1), min(j + 1, n_y - 1)
        a, b = a - i, b - j
        for axis in range(2):
            near = (1.0 - b) * wind_m_s[i, j, axis] + b * wind_m_s[i, j_1, axis]
            far = (1.0 - b) * wind_m_s[i_1, j, axis] + b * wind_m_s[i_1, j_1, axis]
            displacement_m[step + 1, axis] = displacement_m[step, axis] + ((1.0 - a) * near + a * far) * step_s
        x_m = sensor_m[0] - displacement_m[step + 1, 0]
        y_m = sensor_m[1] - displacement_m[step + 1, 1]
    return displacement_m
