"""One step of the filament model: wind, eddies and walls move every filament, and it grows."""
# pyright: basic

import math

import numba
import numpy as np

from gslcosim.fields.filament.advection_kernels import wind_at_filaments
from gslcosim.fields.filament.normal_kernels import key_of_step, normal_at
from gslcosim.fields.filament.trace_kernels import FACE_MARGIN, cell_index, is_step_in_free_air, trace_displacement

# Winds are looked up for so many filaments at once; their buffer stays in the first cache.
BATCH = 256
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
        is_open: (nx, ny, nz) uint8, not zero where a cell and its 26 neighbours are free (see `open_cells`).
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
    per_cell_m = 1.0 / cell_m
    reach_m = (1.0 - FACE_MARGIN) * cell_m
    wind_m_s = np.empty((BATCH, 3), np.float32)
    n_left = 0
    for f in range(n):
        if f % BATCH == 0:
            wind_at_filaments(velocity_m_s, origin_m, cell_m, position_world_m, f, min(BATCH, n - f), wind_m_s)
        age_steps = step - birth_steps[f]
        dt_s = step_s
        eta_m = noise_std_m
        if age_steps < 1.0:
            dt_s = age_steps * step_s
            eta_m = noise_std_m * math.sqrt(age_steps)
        source = source_index[f]
        x, y, z = position_world_m[f, 0], position_world_m[f, 1], position_world_m[f, 2]
        rise_m_s = source_buoyancy[source] / sigma_m[f]
        if buoyancy_power == 3:
            rise_m_s /= sigma_m[f] * sigma_m[f]
        ax = wind_m_s[f % BATCH, 0] * dt_s
        ay = wind_m_s[f % BATCH, 1] * dt_s
        az = (wind_m_s[f % BATCH, 2] + rise_m_s) * dt_s
        counter = np.uint64(filament_id[f]) * np.uint64(3)
        ex = eta_m * normal_at(step_key, counter)
        ey = eta_m * normal_at(step_key, counter + np.uint64(1))
        ez = eta_m * normal_at(step_key, counter + np.uint64(2))
        i = np.uint64(np.int64((x - origin_m[0]) * per_cell_m))
        j = np.uint64(np.int64((y - origin_m[1]) * per_cell_m))
        k = np.uint64(np.int64((z - origin_m[2]) * per_cell_m))
        # A point on a face may count to either cell here: from both, the neighbours of neighbours are out of reach.
        dx, dy, dz = ax + ex, ay + ey, az + ez
        if is_open[i, j, k] and abs(dx) < reach_m and abs(dy) < reach_m and abs(dz) < reach_m:
            x, y, z = x + dx, y + dy, z + dz
        else:
            if not math.isfinite(dx + dy + dz):
                return NOT_FINITE
            x, y, z, has_left = _move_near_walls(occupancy, origin_m, cell_m, x, y, z, ax, ay, az, ex, ey, ez)
            if has_left:
                continue
        position_world_m[n_left, 0] = x
        position_world_m[n_left, 1] = y
        position_world_m[n_left, 2] = z
        sigma0_m = source_sigma_m[source]
        sigma_m[n_left] = math.sqrt(sigma0_m * sigma0_m + growth_m2_s * (age_steps * step_s))
        if n_left != f:
            birth_steps[n_left] = birth_steps[f]
            filament_id[n_left] = filament_id[f]
            source_index[n_left] = source
        n_left += 1
    return n_left
