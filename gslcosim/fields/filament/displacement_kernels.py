"""How a batch of filaments ages and moves in a step, as far as no wall is in the way."""
# pyright: basic

import math

import numba
import numpy as np

from gslcosim.fields.filament.batch_kernels import (
    BOUNDED,
    DT,
    ETA,
    FATE,
    FREE,
    MOVED,
    NORMAL,
    PLACE,
    REACH,
    RISE,
    SIGMA,
    Y,
    Z,
)
from gslcosim.fields.filament.trace_kernels import FACE_MARGIN


@numba.njit(cache=True, nogil=True)
def find_reach(is_open, cell_m, n, cell, work):
    """Look up how far filaments may move without meeting a wall: a cell where all neighbours are free, else nothing.

    A place on a face may count to either cell here: from both, the neighbours of neighbours are out of reach.

    Args:
        is_open: (nx, ny, nz) uint8, not zero where a cell and its 26 neighbours are free (see `room_cells.open_cells`).
        cell_m: Edge of the cubic cells [m].
        n: How many filaments, at most BATCH.
        cell: (BATCH,) int64 working memory.
        work: (N_WORK,) reads PLACE, sets REACH.
    """
    _, ny, nz = is_open.shape
    reach_m = (1.0 - FACE_MARGIN) * cell_m
    for p in range(n):
        i, j, k = np.int64(work[PLACE + p]), np.int64(work[PLACE + Y + p]), np.int64(work[PLACE + Z + p])
        # A place that rounding puts beyond the grid's upper border counts to another cell of the border: not open.
        cell[p] = min((i * ny + j) * nz + k, is_open.size - 1)
    flat = is_open.reshape(-1)
    for p in range(n):
        work[REACH + p] = reach_m if flat[np.uint64(cell[p])] else 0.0


@numba.njit(cache=True, nogil=True)
def age_filaments(birth_steps, source_index, source_sigma_m, step, step_s, noise_std_m, growth_m2_s, work):
    """Tell how long filaments move in a step, how far eddies carry them and how large they are after it.

    sigma = sqrt(sigma0^2 + gamma age);   dt = min(age, step);   eta = eta of a step * sqrt(dt / step)

    Args:
        birth_steps: (n,) time of birth in steps since the start of the plume, with fraction; n at most BATCH.
        source_index: (n,) int32 index into the table of sources.
        source_sigma_m: (n_sources,) size at birth sigma0 [m].
        step: Number of the step.
        step_s: Its length [s].
        noise_std_m: Standard deviation eta of a whole step's random displacement per axis [m].
        growth_m2_s: Growth gamma of sigma^2 [m2/s].
        work: (N_WORK,) sets SIGMA, DT and ETA.
    """
    n = birth_steps.size
    for p in range(n):
        work[SIGMA + p] = source_sigma_m[np.uint64(source_index[p])]
    n_newborn = 0
    for p in range(n):
        age_steps = step - birth_steps[p]
        n_newborn += age_steps < 1.0
        work[DT + p] = step_s
        work[ETA + p] = noise_std_m
        work[SIGMA + p] = math.sqrt(work[SIGMA + p] * work[SIGMA + p] + growth_m2_s * (age_steps * step_s))
    # Few batches have newborn: the others are spared the second root.
    if n_newborn > 0:
        for p in range(n):
            age_steps = step - birth_steps[p]
            if age_steps < 1.0:
                work[DT + p] = age_steps * step_s
                work[ETA + p] = noise_std_m * math.sqrt(age_steps)


# Division by zero as in numpy: the check for it would keep the loops from vector instructions, and the movement is
# checked anyway.
@numba.njit(cache=True, nogil=True, error_model="numpy")
def find_rise(sigma_m, source_index, source_buoyancy, power, work):
    """Tell how fast filaments rise relative to the air, b / sigma^q.

    Args:
        sigma_m: (n,) standard deviations at the step's start [m]; n at most BATCH.
        source_index: (n,) int32 index into the table of sources.
        source_buoyancy: (n_sources,) coefficient b of the gas's vertical velocity, upward [m^(1 + q)/s].
        power: Its power q of the size, 1 or 3.
        work: (N_WORK,) sets RISE [m/s].
    """
    n = sigma_m.size
    for p in range(n):
        work[RISE + p] = source_buoyancy[np.uint64(source_index[p])]
    for p in range(n):
        work[RISE + p] /= sigma_m[p]
    if power == 3:
        for p in range(n):
            work[RISE + p] /= sigma_m[p] * sigma_m[p]


@numba.njit(cache=True, nogil=True, inline="always")
def displacement_m(wind_m_s, work, p):
    """Return the displacement of filament p of a batch by the air and by eddies, (ax, ay, az, ex, ey, ez) [m]."""
    dt_s, eta_m = work[DT + p], work[ETA + p]
    return (
        wind_m_s[p] * dt_s,
        wind_m_s[Y + p] * dt_s,
        (wind_m_s[Z + p] + work[RISE + p]) * dt_s,
        eta_m * work[NORMAL + p],
        eta_m * work[NORMAL + Y + p],
        eta_m * work[NORMAL + Z + p],
    )


@numba.njit(cache=True, nogil=True)
def displace_filaments(position_m, wind_m_s, cell_m, work):
    """Move filaments as if there were no walls, and tell of which this is the truth.

    Free is what stays within its reach or within its cell. A place within FACE_MARGIN of a face counts as bounded, so
    rounding cannot put a filament into another cell than the exact look at walls would.

    Args:
        position_m: (3 n,) centres, world frame, x y z of one filament after the other [m]; n at most BATCH.
        wind_m_s: (3 BATCH,) float32 wind, world frame, axis after axis [m/s].
        cell_m: Edge of the cubic cells [m].
        work: (N_WORK,) reads PLACE, NORMAL, DT, ETA, RISE and REACH, sets MOVED and FATE (FREE or BOUNDED).
    """
    per_cell_m = 1.0 / cell_m
    half = 0.5 - FACE_MARGIN
    for p in range(position_m.size // 3):
        x, y, z = position_m[3 * p], position_m[3 * p + 1], position_m[3 * p + 2]
        ax, ay, az, ex, ey, ez = displacement_m(wind_m_s, work, p)
        dx, dy, dz = ax + ex, ay + ey, az + ez
        work[MOVED + p], work[MOVED + Y + p], work[MOVED + Z + p] = x + dx, y + dy, z + dz
        # Offsets from the cell's centre, in cells. All comparisons are false for what is not finite.
        i, j, k = work[PLACE + p], work[PLACE + Y + p], work[PLACE + Z + p]
        i, j, k = i - math.floor(i) - 0.5, j - math.floor(j) - 0.5, k - math.floor(k) - 0.5
        is_inside = (abs(i) < half) & (abs(j) < half) & (abs(k) < half)
        i, j, k = i + dx * per_cell_m, j + dy * per_cell_m, k + dz * per_cell_m
        stays = is_inside & (abs(i) < half) & (abs(j) < half) & (abs(k) < half)
        reach_m = work[REACH + p]
        is_near = (abs(dx) < reach_m) & (abs(dy) < reach_m) & (abs(dz) < reach_m)
        work[FATE + p] = FREE if is_near | stays else BOUNDED
