"""How far a measurement reaches over a map: along the wind, round obstacles, and as far as it can be trusted."""
# pyright: basic

import math

import numba
import numpy as np

from gslcosim.search.moving.grid_paths_kernels import STEP_UNITS, UNITS_PER_CELL, is_line_free

_TIE_UNITS = UNITS_PER_CELL // 10
# Cells of the window that are looked at directly, to each side.
_WINDOW = 2
_ROOT_2_PI = math.sqrt(2.0 * math.pi)
# So many factors of a score, each at least 0.01, are multiplied before a logarithm is taken.
_FACTORS_TOGETHER = 16


@numba.njit(cache=True, nogil=True)
def stretched_kernel(free, length, order, wind_x, wind_y, sigma, stretch):
    """Weigh cells by how much they share of what is measured at one: more along the wind, by the way gas would take.

    w(c) = exp(-(p^2 / a^2 + q^2 / b^2) / 2),  a = sigma + k |W|,  b = sigma / (1 + k |W| / sigma)
    p, q: parts of the offset of c along and across the wind [cells]
    A cell within two cells that is in plain sight has its own offset. Any other is put as far away as the way to it is
    long, in the direction in which that way leaves the window; of equally long ways the one with the largest weight
    counts. So nothing passes a wall.

    Args:
        free: (nx, ny, 1) bool, whether a cell is free; index order ij.
        length: (nx ny,) lengths of the shortest paths from the cell of the measurement, as of `path_tree` [units].
        order: (n_reached,) cells, nearest first; that of the measurement is the first.
        wind_x: Wind, world frame [m/s].
        wind_y: Its second component.
        sigma: Standard deviation without wind [cells].
        stretch: k [cells s/m].

    Returns:
        (nx ny,) weights, 1 at the measurement, 0 where no path leads.

    Source:
        Ojeda, Monroy, Gonzalez-Jimenez 2024, arXiv 2304.08879 (PMFS), with the public code's window [C].
    Held by:
        tests/unit/search/maps/test_pmfs.py
    """
    nx, ny, _ = free.shape
    weight = np.zeros(nx * ny)
    ahead = np.zeros((nx * ny, 2))
    speed = math.hypot(wind_x, wind_y)
    ux, uy = (wind_x / speed, wind_y / speed) if speed > 0.0 else (1.0, 0.0)
    along, across = sigma + stretch * speed, sigma / (1.0 + stretch * speed / sigma)
    i0, j0 = order[0] // ny, order[0] % ny
    for cell in order:
        i, j = cell // ny, cell % ny
        di, dj = float(i - i0), float(j - j0)
        far = length[cell] / UNITS_PER_CELL
        if far > 8.0 * max(along, across) + _WINDOW:
            break
        is_near = max(abs(di), abs(dj)) <= _WINDOW
        if is_near and is_line_free(free, i0 + 0.5, j0 + 0.5, 0.5, i + 0.5, j + 0.5, 0.5):
            away = math.hypot(di, dj)
            if away > 0.0:
                ahead[cell, 0], ahead[cell, 1] = di / away, dj / away
            weight[cell] = _gaussian(di, dj, ux, uy, along, across)
            continue
        for step in range(9):
            a, b = i + step // 3 - 1, j + step % 3 - 1
            if step == 4 or a < 0 or b < 0 or a >= nx or b >= ny:
                continue
            if not (free[a, b, 0] and free[a, j, 0] and free[i, b, 0]):
                continue
            before = a * ny + b
            if length[before] + STEP_UNITS[abs(a - i) + abs(b - j)] > length[cell] + _TIE_UNITS:
                continue
            dx, dy = ahead[before, 0], ahead[before, 1]
            through = _gaussian(far * dx, far * dy, ux, uy, along, across)
            if through > weight[cell] or (ahead[cell, 0] == 0.0 and ahead[cell, 1] == 0.0):
                weight[cell] = through
                ahead[cell, 0], ahead[cell, 1] = dx, dy
    return weight


@numba.njit(cache=True, nogil=True, inline="always")
def _gaussian(dx, dy, ux, uy, along, across):
    p, q = dx * ux + dy * uy, dy * ux - dx * uy
    return math.exp(-0.5 * ((p / along) ** 2 + (q / across) ** 2))


@numba.njit(cache=True, nogil=True)
def trust_inplace(omega, length, order, sigma):
    """Add to every cell what a measurement contributes to the trust in its hit probability.

    omega(c) += N(L(c); sigma) = exp(-L^2 / (2 sigma^2)) / (sigma sqrt(2 pi))        L length of the path [cells]

    Args:
        omega: (nx ny,) sums so far; modified.
        length: (nx ny,) lengths of the shortest paths from the cell of the measurement [units].
        order: (n_reached,) cells, nearest first.
        sigma: Reach of a measurement [cells].

    Source:
        Ojeda, Monroy, Gonzalez-Jimenez 2024, arXiv 2304.08879 (PMFS) [C].
    Held by:
        tests/unit/search/maps/test_pmfs.py
    """
    for cell in order:
        far = length[cell] / (UNITS_PER_CELL * sigma)
        if far > 8.0:
            break
        omega[cell] += math.exp(-0.5 * far * far) / (sigma * _ROOT_2_PI)


@numba.njit(cache=True, nogil=True)
def add_log_score_inplace(log_score, shares, measured, confidence, least):
    """Add the logarithm of how well each source explains what was measured in some cells.

    log S(s) += sum over cells m of ln max(least, 1 - conf_m |h_m - share_m(s)|)        pure numbers

    Args:
        log_score: (n_sources,) sums; modified.
        shares: (n_cells, n_sources) share of the time with gas, by the model.
        measured: (n_cells,) probability of a hit, as measured.
        confidence: (n_cells,) trust in it, 0 to 1.
        least: Smallest factor, > 0: no cell alone rules out a source.

    Source:
        Ojeda, Monroy, Gonzalez-Jimenez 2024, arXiv 2304.08879 (PMFS): product of 1 - conf + conf (1 - kd |difference|)
        with kd = 1 [C].
    Held by:
        tests/unit/search/maps/test_pmfs.py
    """
    product = np.ones(shares.shape[1])
    for m in range(shares.shape[0]):
        for s in range(shares.shape[1]):
            product[s] *= max(least, 1.0 - confidence[m] * abs(measured[m] - shares[m, s]))
        if m % _FACTORS_TOGETHER == _FACTORS_TOGETHER - 1 or m == shares.shape[0] - 1:
            for s in range(shares.shape[1]):
                log_score[s] += math.log(product[s])
                product[s] = 1.0


@numba.njit(cache=True, nogil=True)
def disagreement(shares, p):
    """Return how much the sources that are believed in differ in what they let expect of each cell.

    v(m) = sum over sources s of p(s) (share_m(s) - mean_m)^2,  mean_m = sum p(s) share_m(s)        pure numbers

    Args:
        shares: (n_cells, n_sources) share of the time with gas, by the model.
        p: (n_sources,) belief, sums to 1.

    Returns:
        (n_cells,) variances.

    Held by:
        tests/unit/search/maps/test_pmfs.py
    """
    variance = np.zeros(shares.shape[0])
    for m in range(shares.shape[0]):
        mean = 0.0
        for s in range(shares.shape[1]):
            mean += p[s] * shares[m, s]
        for s in range(shares.shape[1]):
            variance[m] += p[s] * (shares[m, s] - mean) ** 2
    return variance
