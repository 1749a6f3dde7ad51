"""One step of the filament model: wind, eddies and walls move every filament, and it grows."""
# pyright: basic

import math

import numba
import numpy as np

from gslcosim.fields.filament.advection_kernels import (
    places_in_cells,
    wind_at_filaments,
    wind_at_filaments_in_flat_grid,
)
from gslcosim.fields.filament.batch_kernels import (
    BATCH,
    FATE,
    FREE,
    LEFT,
    MOVED,
    N_WORK,
    NORMAL,
    PLACE,
    RISE,
    SIGMA,
    Y,
    Z,
)
from gslcosim.fields.filament.displacement_kernels import (
    age_filaments,
    displace_filaments,
    displacement_m,
    find_reach,
    find_rise,
)
from gslcosim.fields.filament.normal_kernels import key_of_step, normals_of_filaments
from gslcosim.fields.filament.trace_kernels import cell_index, is_step_in_free_air, trace_displacement

NOT_FINITE = -1


@numba.njit(cache=True, nogil=True)
def _move_near_walls(occupancy, origin_m, cell_m, x, y, z, ax, ay, az, ex, ey, ez):
    # The wind's part (a) slides along walls, the eddies' part (e) is reflected by them. Most steps meet none.
    nx, ny, nz = x + (ax + ex), y + (ay + ey), z + (az + ez)
    i, ni = cell_index(x, origin_m[0], cell_m), cell_index(nx, origin_m[0], cell_m)
    j, nj = cell_index(y, origin_m[1], cell_m), cell_index(ny, origin_m[1], cell_m)
    k, nk = cell_index(z, origin_m[2], cell_m), cell_index(nz, origin_m[2], cell_m)
    if i == ni and j == nj and k == nk:
        return nx, ny, nz, False
    if is_step_in_free_air(occupancy, i, j, k, ni, nj, nk):
        return nx, ny, nz, False
    x, y, z, has_left = trace_displacement(occupancy, origin_m, cell_m, x, y, z, ax, ay, az, reflects=False)
    if has_left:
        return x, y, z, True
    return trace_displacement(occupancy, origin_m, cell_m, x, y, z, ex, ey, ez, reflects=True)


@numba.njit(cache=True, nogil=True)
def _list_bounded(work, n, bounded):
    # Counting without a branch: which filaments are bounded cannot be foretold.
    n_bounded = 0
    for p in range(n):
        bounded[n_bounded] = p
        n_bounded += work[FATE + p] != FREE
    return n_bounded


@numba.njit(cache=True, nogil=True)
def _move_bounded(occupancy, origin_m, cell_m, position_m, wind_m_s, bounded, work):
    # Returns how many left the room.
    n_gone = 0
    for p in bounded:
        ax, ay, az, ex, ey, ez = displacement_m(wind_m_s, work, p)
        if not math.isfinite((ax + ex) + (ay + ey) + (az + ez)):
            return NOT_FINITE
        x, y, z = position_m[3 * p], position_m[3 * p + 1], position_m[3 * p + 2]
        x, y, z, has_left = _move_near_walls(occupancy, origin_m, cell_m, x, y, z, ax, ay, az, ex, ey, ez)
        work[MOVED + p], work[MOVED + Y + p], work[MOVED + Z + p] = x, y, z
        if has_left:
            work[FATE + p] = LEFT
            n_gone += 1
    return n_gone


@numba.njit(cache=True, nogil=True)
def _keep_all(position_m, sigma_m, work):
    for p in range(sigma_m.size):
        position_m[3 * p] = work[MOVED + p]
        position_m[3 * p + 1] = work[MOVED + Y + p]
        position_m[3 * p + 2] = work[MOVED + Z + p]
    for p in range(sigma_m.size):
        sigma_m[p] = work[SIGMA + p]


@numba.njit(cache=True, nogil=True)
def _keep_stayers(position_m, sigma_m, birth_steps, filament_id, source_index, first, n, n_left, work):
    # Moves what stays of the batch up to the end of what stayed before; returns the new end.
    for p in range(n):
        if work[FATE + p] == LEFT:
            continue
        position_m[3 * n_left] = work[MOVED + p]
        position_m[3 * n_left + 1] = work[MOVED + Y + p]
        position_m[3 * n_left + 2] = work[MOVED + Z + p]
        sigma_m[n_left] = work[SIGMA + p]
        birth_steps[n_left] = birth_steps[first + p]
        filament_id[n_left] = filament_id[first + p]
        source_index[n_left] = source_index[first + p]
        n_left += 1
    return n_left


@numba.njit(cache=True, nogil=True)
def move_filaments_inplace(
    position_world_m,
    sigma_m,
    birth_steps,
    filament_id,
    source_index,
    n,
    source_sigma_m,
    source_buoyancy,
    buoyancy_power,
    velocity_m_s,
    occupancy,
    is_open,
    origin_m,
    cell_m,
    step,
    step_s,
    noise_std_m,
    growth_m2_s,
    key,
):
    """Advance all filaments by one step and drop those that left through an outlet, keeping the order of birth.

    dp = (u(p) + b / sigma^q) dt + eta xi          xi standard normal per axis, eta = sqrt(2 D dt), b along z
    [m] = ([m/s] + [m^(1 + q)/s] / [m^q]) [s] + [m]
    sigma^2 = sigma0^2 + gamma age
    [m2] = [m2] + [m2/s] [s]

    A filament born within the step moves for the rest of it only (eta then with the root of the rest's share), so the
    plume does not depend on dt through birth.
    The number xi depends on (key, step, filament id, axis) alone: not on the order or number of filaments.

    Args:
        position_world_m: (>= n, 3) filament centres, world frame, xyz [m]; modified.
        sigma_m: (>= n,) standard deviations, sigma0 for the newborn [m]; modified (set from the age).
        birth_steps: (>= n,) time of birth in steps since the start of the plume, with fraction; reordered.
        filament_id: (>= n,) int64, distinct; reordered.
        source_index: (>= n,) int32 index into the tables of sources; reordered.
        n: Number of filaments.
        source_sigma_m: (n_sources,) size at birth sigma0 [m].
        source_buoyancy: (n_sources,) coefficient b of the gas's vertical velocity, upward [m^(1 + q)/s].
        buoyancy_power: Its power q of the size (see `Buoyancy`).
        velocity_m_s: (nx, ny, nz, 3) wind at cell centres, world frame [m/s], held over the step.
        occupancy: (nx, ny, nz) uint8, 0 free, 1 solid, 2 outlet.
        is_open: (nx, ny, nz) uint8, not zero where a cell and its 26 neighbours are free (see `room_cells.open_cells`).
        origin_m: (3,) corner of cell (0, 0, 0), world frame [m].
        cell_m: Edge of the cubic cells [m].
        step: Number of the step; it covers the time from (step - 1) dt to step dt.
        step_s: Length of a step dt [s].
        noise_std_m: Standard deviation eta of a whole step's random displacement per axis [m].
        growth_m2_s: Growth gamma of sigma^2 [m2/s].
        key: 64 bits of the stream of eddies, uint64.

    Returns:
        Number of filaments that are left, the first of the arrays; NOT_FINITE when a displacement is not finite.

    Source:
        Farrell et al. 2002, filament model, doi:10.1023/A:1016283702837.
    Deviation:
        The wind within a step is that at its start (Euler). Eddies smaller than the wind's cells are a random walk
        without memory.
    Accuracy:
        First order in dt for curved streamlines: |du/dx| dt << 1. Walls hold for any dt.
    Held by:
        tests/analytic/test_gas_plume.py, tests/properties/test_gas_blocking.py, tests/properties/test_gas_steps.py
    """
    step_key = key_of_step(key, step)
    positions_m = position_world_m.reshape(-1)
    work, wind_m_s, weight = np.empty(N_WORK), np.empty(3 * BATCH, np.float32), np.empty(3 * BATCH, np.float32)
    bits, cell, listed = np.empty(3 * BATCH, np.uint64), np.empty(BATCH, np.int64), np.empty(3 * BATCH, np.int64)
    place, normal = work[PLACE:], work[NORMAL:]
    work[RISE : RISE + BATCH] = 0.0
    is_neutral = not source_buoyancy.any()
    is_flat_grid = min(velocity_m_s.shape[:3]) < 2
    n_left = 0
    for first in range(0, n, BATCH):
        m = min(BATCH, n - first)
        batch = slice(first, first + m)
        position_m = positions_m[3 * first : 3 * (first + m)]
        places_in_cells(position_m, origin_m, cell_m, place)
        if is_flat_grid:
            wind_at_filaments_in_flat_grid(velocity_m_s, origin_m, cell_m, position_m, wind_m_s)
        else:
            wind_at_filaments(velocity_m_s, place, m, cell, weight, wind_m_s)
        find_reach(is_open, cell_m, m, cell, work)
        normals_of_filaments(step_key, filament_id[batch], bits, listed, normal)
        born, source = birth_steps[batch], source_index[batch]
        if not is_neutral:
            find_rise(sigma_m[batch], source, source_buoyancy, buoyancy_power, work)
        age_filaments(born, source, source_sigma_m, step, step_s, noise_std_m, growth_m2_s, work)
        displace_filaments(position_m, wind_m_s, cell_m, work)
        bounded = listed[: _list_bounded(work, m, listed)]
        n_gone = _move_bounded(occupancy, origin_m, cell_m, position_m, wind_m_s, bounded, work)
        if n_gone == NOT_FINITE:
            return NOT_FINITE
        if n_gone == 0 and n_left == first:
            _keep_all(position_m, sigma_m[batch], work)
            n_left += m
        else:
            n_left = _keep_stayers(positions_m, sigma_m, birth_steps, filament_id, source_index, first, m, n_left, work)
    return n_left
