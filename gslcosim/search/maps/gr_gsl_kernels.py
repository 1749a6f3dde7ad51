"""What one measurement says of every free cell, as the method GrGSL spreads it from the cells around the robot."""
# pyright: basic

import math

import numba
import numpy as np

from gslcosim.search.moving.grid_paths_kernels import STEP_UNITS

# A way of more than three steps to a cell of the window leads around something.
_WINDOW_UNITS = 3 * STEP_UNITS[1]
# Paths that differ by less than a tenth of a cell count as equally long.
_TIE_UNITS = STEP_UNITS[1] // 10


@numba.njit(cache=True, nogil=True)
def spread_weights(free, length, order, direction_rad, sigma_rad, core_rad):
    """Give every cell the weight of the neighbouring cell through which the robot's way to it leads.

    psi = direction from the cell to the robot, a = |psi - direction| in [0, pi]
    w = exp(-a^2 / (2 sigma^2))            in the 5 x 5 cells around the robot, but its 3 x 3 core
    w = exp(-core^2 / (2 sigma^2))         in the core
    w(c) = max of w(n) over the neighbours n of c with L(n) + step(n, c) <= L(c) + 0.1 cells, elsewhere
    pure numbers; L is the length of the shortest path from the robot.

    Args:
        free: (nx, ny) bool, whether a cell is free; index order ij.
        length: (nx ny,) lengths of the shortest paths from the robot's cell, as of `path_tree` [units].
        order: (n_reached,) cells, nearest first; the robot's is the first.
        direction_rad: Direction that the cells should see the robot in, world frame [rad]; NaN where there is none:
            then all cells but the core weigh 1.
        sigma_rad: Standard deviation of directions [rad].
        core_rad: Deviation that the core counts as [rad]: 0 makes it the most likely, pi the least.

    Returns:
        (nx ny,) weights relative to the greatest possible; 0 where no path leads.

    Source:
        Ojeda, Monroy, Gonzalez-Jimenez 2021, RA-L (GrGSL), windows and ties as in the public code [C].
    Deviation:
        Cells of the window that only a way around an obstacle leads to inherit, as those outside do.
    Held by:
        tests/unit/search/maps/test_gr_gsl.py
    """
    nx, ny = free.shape
    weight = np.zeros(nx * ny)
    core = math.exp(-0.5 * (core_rad / sigma_rad) ** 2)
    i0, j0 = order[0] // ny, order[0] % ny
    for cell in order:
        i, j = cell // ny, cell % ny
        di, dj = i - i0, j - j0
        away = max(abs(di), abs(dj))
        if away <= 1:
            weight[cell] = core
        elif math.isnan(direction_rad):
            weight[cell] = 1.0
        elif away == 2 and length[cell] <= _WINDOW_UNITS:
            turn = (math.atan2(-dj, -di) - direction_rad) / (2.0 * math.pi)
            deviation = 2.0 * math.pi * (turn - math.floor(turn + 0.5))
            weight[cell] = math.exp(-0.5 * (deviation / sigma_rad) ** 2)
        else:
            weight[cell] = _inherited(free, length, weight, i, j)
    return weight


@numba.njit(cache=True, nogil=True, inline="always")
def _inherited(free, length, weight, i, j):
    nx, ny = free.shape
    cell = i * ny + j
    most = 0.0
    for di in range(-1, 2):
        for dj in range(-1, 2):
            a, b = i + di, j + dj
            if (di == 0 and dj == 0) or a < 0 or b < 0 or a >= nx or b >= ny:
                continue
            if not (free[a, b] and free[a, j] and free[i, b]):
                continue
            step = STEP_UNITS[abs(di) + abs(dj)]
            if length[a * ny + b] + step <= length[cell] + _TIE_UNITS:
                most = max(most, weight[a * ny + b])
    return most


@numba.njit(cache=True, nogil=True)
def information_gain_nats(p, hit_weight, miss_weight):
    """Return how much a measurement is expected to change a belief, each cell seen as a coin of its own.

    h = sum p w_hit                                         chance of a hit
    gain = h K(p_hit, p) + (1 - h) K(p_miss, p),  p_z = p w_z / sum p w_z
    K(q, p) = sum over cells of q ln(q / p) + (1 - q) ln((1 - q) / (1 - p))        [nat]

    Args:
        p: (n,) belief, sums to 1.
        hit_weight: (n,) weights of the cells if gas were found, relative to the greatest possible.
        miss_weight: (n,) the same if none were.

    Source:
        Ojeda, Monroy, Gonzalez-Jimenez 2021, RA-L (GrGSL): expected divergence of hit and miss [C].
    Deviation:
        The chance of a hit is the weighted belief: in full where all mass is straight upwind.
    Held by:
        tests/unit/search/maps/test_gr_gsl.py
    """
    chance, missed = 0.0, 0.0
    for c in range(p.size):
        chance += p[c] * hit_weight[c]
        missed += p[c] * miss_weight[c]
    if not (chance > 0.0 and missed > 0.0):
        return 0.0
    hit, miss = 0.0, 0.0
    for c in range(p.size):
        if p[c] > 0.0:
            hit += _divergence(p[c] * hit_weight[c] / chance, p[c])
            miss += _divergence(p[c] * miss_weight[c] / missed, p[c])
    chance = min(1.0, chance)
    return chance * hit + (1.0 - chance) * miss


@numba.njit(cache=True, nogil=True, inline="always")
def _divergence(q, p):
    total = 0.0
    if q > 0.0:
        total += q * math.log(q / p)
    if q < 1.0 and p < 1.0:
        total += (1.0 - q) * math.log((1.0 - q) / (1.0 - p))
    return total
