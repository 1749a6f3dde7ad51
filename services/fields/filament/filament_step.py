# pyright: basic
# ruff: noqa: ANN001, ANN201, ANN202 - kernels have no types, and symbols of equations
"""One step of the filament model: wind at filaments, ageing, displacement, collision with walls, and outflow.

Arguments of several functions: `cell_m` edge of the cubic cells [m]; `origin_m` (3,) corner of cell (0, 0, 0), world
frame [m].
"""

import math

import numba
import numpy as np

from gslcosim.environment.grid_kernels import SOLID, trilinear_wind
from gslcosim_services.fields.filament.counter_rng import (
    BATCH,
    BOUNDED,
    DT,
    ETA,
    FATE,
    FREE,
    LEFT,
    MOVED,
    N_WORK,
    NORMAL,
    POSITION,
    REACH,
    RISE,
    SIGMA,
    Y,
    Z,
    derive_step_key,
    draw_filament_normals,
)

FREE_CELL = 0
OUTLET = 2

# Distance of a traced point from the cell's faces, as a fraction of its edge, so that rounding cannot move it across.
FACE_MARGIN = 1e-7

_ONE = np.float32(1.0)
_1, _2, _3, _4, _5 = np.uint64(1), np.uint64(2), np.uint64(3), np.uint64(4), np.uint64(5)
NOT_FINITE = -1


@numba.njit(cache=True, nogil=True)
def cell_index(coordinate_m, origin_m, cell_m):
    """Return the index of the cell that holds a coordinate, with the same rounding as `Grid.cell_of`."""
    return math.floor((coordinate_m - origin_m) / cell_m)


@numba.njit(cache=True, nogil=True)
def _clamped(coordinate_m, origin_m, cell_m, i):
    low = origin_m + (i + FACE_MARGIN) * cell_m
    high = origin_m + (i + 1.0 - FACE_MARGIN) * cell_m
    return min(max(coordinate_m, low), high)


@numba.njit(cache=True, nogil=True)
def _time_to_face(coordinate_m, displacement_m, origin_m, cell_m, i):
    # Fraction of the displacement after which the coordinate reaches the face ahead of it.
    if displacement_m > 0.0:
        return max(0.0, (origin_m + (i + 1) * cell_m - coordinate_m) / displacement_m)
    if displacement_m < 0.0:
        return max(0.0, (origin_m + i * cell_m - coordinate_m) / displacement_m)
    return math.inf


@numba.njit(cache=True, nogil=True)
def trace_reflections(occupancy, origin_m, cell_m, x, y, z, dx, dy, dz, reflects):
    """Move a point through the grid cell by cell, along or off the walls that it meets.

    At a wall (a solid cell, or the border of the grid) the component of the remaining displacement that points into
    it is dropped (the point slides) or changes its sign (the point is reflected). Entering an outlet cell, or meeting
    a wall from within one, ends the point.

    Args:
        occupancy: (nx, ny, nz) uint8, 0 free, 1 solid, 2 outlet; index order ij.
        x, y, z: Start, world frame [m]; in a cell that is not solid.
        dx, dy, dz: Displacement, world frame [m]; of any length.
        reflects: Whether walls reflect; otherwise the point slides along them.

    Returns:
        (x, y, z, ended, sx, sy, sz): where the displacement ends, world frame [m], strictly inside a cell that is not
        solid; `ended` when the point left through an outlet; -1.0 along axes that were reflected an odd number of times
        (0.0 where it slides), otherwise 1.0.

    Source:
        Cell traversal after Amanatides and Woo 1987, A fast voxel traversal algorithm for ray tracing; the wall rules
        are ours. Reflection keeps a well mixed gas well mixed, where sliding would gather it at the wall.
    Held by:
        tests/properties/test_gas_blocking.py, tests/unit/services/fields/filament/test_filament_step.py
    """
    nx, ny, nz = occupancy.shape
    ox, oy, oz = origin_m[0], origin_m[1], origin_m[2]
    i, j, k = cell_index(x, ox, cell_m), cell_index(y, oy, cell_m), cell_index(z, oz, cell_m)
    wall = -1.0 if reflects else 0.0
    sx = sy = sz = 1.0
    while True:
        tx = _time_to_face(x, dx, ox, cell_m, i)
        ty = _time_to_face(y, dy, oy, cell_m, j)
        tz = _time_to_face(z, dz, oz, cell_m, k)
        t = min(tx, ty, tz)
        if t >= 1.0:
            x = _clamped(x + dx, ox, cell_m, i)
            y = _clamped(y + dy, oy, cell_m, j)
            z = _clamped(z + dz, oz, cell_m, k)
            return x, y, z, False, sx, sy, sz
        x += t * dx
        y += t * dy
        z += t * dz
        rest = 1.0 - t
        dx *= rest
        dy *= rest
        dz *= rest
        ni, nj, nk = i, j, k
        if tx == t:
            ni = i + 1 if dx > 0.0 else i - 1
        elif ty == t:
            nj = j + 1 if dy > 0.0 else j - 1
        else:
            nk = k + 1 if dz > 0.0 else k - 1
        is_inside = 0 <= ni < nx and 0 <= nj < ny and 0 <= nk < nz
        if is_inside and occupancy[ni, nj, nk] == OUTLET:
            return x, y, z, True, sx, sy, sz
        if is_inside and occupancy[ni, nj, nk] != SOLID:
            i, j, k = ni, nj, nk
        elif occupancy[i, j, k] == OUTLET:
            return x, y, z, True, sx, sy, sz
        elif tx == t:
            dx, sx = wall * dx, wall * sx
        elif ty == t:
            dy, sy = wall * dy, wall * sy
        else:
            dz, sz = wall * dz, wall * sz


@numba.njit(cache=True, nogil=True)
def is_step_in_free_air(occupancy, i0, j0, k0, i1, j1, k1):
    """Return whether all cells of the smallest box around two cells are free; false when they are not neighbours.

    Args:
        occupancy: (nx, ny, nz) uint8, 0 free.
        i0, j0, k0: First cell, inside the grid.
        i1, j1, k1: Second cell, anywhere.
    """
    nx, ny, nz = occupancy.shape
    if abs(i1 - i0) > 1 or abs(j1 - j0) > 1 or abs(k1 - k0) > 1:
        return False
    if not (0 <= i1 < nx and 0 <= j1 < ny and 0 <= k1 < nz):
        return False
    for i in range(min(i0, i1), max(i0, i1) + 1):
        for j in range(min(j0, j1), max(j0, j1) + 1):
            for k in range(min(k0, k1), max(k0, k1) + 1):
                if occupancy[i, j, k] != FREE_CELL:
                    return False
    return True


@numba.njit(cache=True, nogil=True)
def positions_in_cells(position_m, origin_m, cell_m, place):
    """Write the positions of filaments in units of cells, counted from the corner of the grid.

    Args:
        position_m: (3 n,) centres, world frame, x y z of one filament after the other [m].
        place: (3 BATCH,) receives the places, axis after axis [1].
    """
    per_cell_m = 1.0 / cell_m
    for p in range(position_m.size // 3):
        place[p] = (position_m[3 * p] - origin_m[0]) * per_cell_m
        place[Y + p] = (position_m[3 * p + 1] - origin_m[1]) * per_cell_m
        place[Z + p] = (position_m[3 * p + 2] - origin_m[2]) * per_cell_m


@numba.njit(cache=True, nogil=True)
def _find_corners(place, n, nx, ny, nz, corner, weight):
    # The lowest of the eight cells whose centres are around each place, as an index into the flat wind, and the
    # upper cells' weights.
    last_x, last_y, last_z = nx - 1.0, ny - 1.0, nz - 1.0
    for p in range(n):
        x = min(max(place[p] - 0.5, 0.0), last_x)
        y = min(max(place[Y + p] - 0.5, 0.0), last_y)
        z = min(max(place[Z + p] - 0.5, 0.0), last_z)
        i, j, k = min(np.int64(x), nx - 2), min(np.int64(y), ny - 2), min(np.int64(z), nz - 2)
        weight[p], weight[Y + p], weight[Z + p] = np.float32(x - i), np.float32(y - j), np.float32(z - k)
        corner[p] = ((i * ny + j) * nz + k) * 3


@numba.njit(cache=True, nogil=True)
def _wind_between_corners(velocity_m_s, n, step_x, step_y, corner, weight, wind_m_s):
    # Unsigned offsets spare the test for negative indices.
    f = velocity_m_s
    for p in range(n):
        a, b, c = weight[p], weight[Y + p], weight[Z + p]
        w00, w10, w01, w11 = (_ONE - a) * (_ONE - b), a * (_ONE - b), (_ONE - a) * b, a * b
        q00 = np.uint64(corner[p])
        q10, q01, q11 = q00 + step_x, q00 + step_y, q00 + step_x + step_y
        low_u = w00 * f[q00] + w10 * f[q10] + w01 * f[q01] + w11 * f[q11]
        low_v = w00 * f[q00 + _1] + w10 * f[q10 + _1] + w01 * f[q01 + _1] + w11 * f[q11 + _1]
        low_w = w00 * f[q00 + _2] + w10 * f[q10 + _2] + w01 * f[q01 + _2] + w11 * f[q11 + _2]
        high_u = w00 * f[q00 + _3] + w10 * f[q10 + _3] + w01 * f[q01 + _3] + w11 * f[q11 + _3]
        high_v = w00 * f[q00 + _4] + w10 * f[q10 + _4] + w01 * f[q01 + _4] + w11 * f[q11 + _4]
        high_w = w00 * f[q00 + _5] + w10 * f[q10 + _5] + w01 * f[q01 + _5] + w11 * f[q11 + _5]
        wind_m_s[p] = (_ONE - c) * low_u + c * high_u
        wind_m_s[Y + p] = (_ONE - c) * low_v + c * high_v
        wind_m_s[Z + p] = (_ONE - c) * low_w + c * high_w


@numba.njit(cache=True, nogil=True)
def wind_at_filaments(velocity_m_s, place, n, corner, weight, wind_m_s):
    """Interpolate the wind at a batch of filaments from the eight cell centres around each.

    Outside the outermost centres the border value holds (no extrapolation).

    Args:
        velocity_m_s: (nx, ny, nz, 3) float32 wind at cell centres, C order, world frame [m/s]; index order ij; at
            least two cells along each axis (see `wind_at_filaments_in_flat_grid`).
        place: (3 BATCH,) where the filaments are, in cells from the corner of the grid, axis after axis [1].
        n: How many filaments, at most BATCH.
        corner: (BATCH,) int64 working memory.
        weight: (3 BATCH,) float32 working memory.
        wind_m_s: (3 BATCH,) float32, receives the wind, world frame, axis after axis [m/s].

    Deviation:
        The same interpolation as `environment.wind_kernels.trilinear_wind` with single-precision weights: the
        difference is about 1e-7 of the wind, the rounding of the stored values.
    Held by:
        tests/unit/services/fields/filament/test_advection_kernels.py (equals the double-precision one)
    """
    nx, ny, nz, _ = velocity_m_s.shape
    _find_corners(place, n, nx, ny, nz, corner, weight)
    step_x, step_y = np.uint64(ny * nz * 3), np.uint64(nz * 3)
    _wind_between_corners(velocity_m_s.reshape(-1), n, step_x, step_y, corner, weight, wind_m_s)


@numba.njit(cache=True, nogil=True)
def wind_at_filaments_in_flat_grid(velocity_m_s, origin_m, cell_m, position_m, wind_m_s):
    """Interpolate the wind at a batch of filaments in a grid that may be one cell thick.

    There is no upper neighbour in such a grid; they are rare, so they go the plain way.

    Args:
        velocity_m_s: (nx, ny, nz, 3) wind at cell centres, world frame [m/s]; index order ij.
        position_m: (3 n,) centres, world frame, x y z of one filament after the other [m].
        wind_m_s: (3 BATCH,) float32, receives the wind, world frame, axis after axis [m/s].

    Held by:
        tests/unit/services/fields/filament/test_advection_kernels.py
    """
    for p in range(position_m.size // 3):
        x, y, z = position_m[3 * p], position_m[3 * p + 1], position_m[3 * p + 2]
        wind_m_s[p], wind_m_s[Y + p], wind_m_s[Z + p] = trilinear_wind(velocity_m_s, origin_m, cell_m, x, y, z)


@numba.njit(cache=True, nogil=True)
def find_reach(is_open, cell_m, n, cell, work):
    """Find the distance that filaments may move without meeting a wall: a cell if all its neighbours are free, else 0.

    A place on a face may count to either cell here: from both, the neighbours of neighbours are out of reach.

    Args:
        is_open: (nx, ny, nz) uint8, not zero where a cell and its 26 neighbours are free (see `plume.find_open_cells`).
        n: How many filaments, at most BATCH.
        cell: (BATCH,) int64 working memory.
        work: (N_WORK,) reads PLACE, sets REACH.
    """
    _, ny, nz = is_open.shape
    reach_m = (1.0 - FACE_MARGIN) * cell_m
    for p in range(n):
        i, j, k = np.int64(work[POSITION + p]), np.int64(work[POSITION + Y + p]), np.int64(work[POSITION + Z + p])
        # A place that rounding puts beyond the grid's upper border counts to another cell of the border: not open.
        cell[p] = min((i * ny + j) * nz + k, is_open.size - 1)
    flat = is_open.reshape(-1)
    for p in range(n):
        work[REACH + p] = reach_m if flat[np.uint64(cell[p])] else 0.0


@numba.njit(cache=True, nogil=True)
def age_filaments(birth_steps, source_index, source_sigma_m, step, step_s, noise_std_m, growth_m2_s, work):
    """Compute the time that filaments move in a step, their random displacement, and their size after the step.

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
    """Compute the upward velocity of filaments relative to the air, b / sigma^q.

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
    """Move filaments as if there were no walls, and mark those that walls cannot affect.

    Free is what stays within its reach or within its cell. A place within FACE_MARGIN of a face counts as bounded, so
    rounding cannot put a filament into another cell than the exact look at walls would.

    Args:
        position_m: (3 n,) centres, world frame, x y z of one filament after the other [m]; n at most BATCH.
        wind_m_s: (3 BATCH,) float32 wind, world frame, axis after axis [m/s].
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
        i, j, k = work[POSITION + p], work[POSITION + Y + p], work[POSITION + Z + p]
        i, j, k = i - math.floor(i) - 0.5, j - math.floor(j) - 0.5, k - math.floor(k) - 0.5
        is_inside = (abs(i) < half) & (abs(j) < half) & (abs(k) < half)
        i, j, k = i + dx * per_cell_m, j + dy * per_cell_m, k + dz * per_cell_m
        stays = is_inside & (abs(i) < half) & (abs(j) < half) & (abs(k) < half)
        reach_m = work[REACH + p]
        is_near = (abs(dx) < reach_m) & (abs(dy) < reach_m) & (abs(dz) < reach_m)
        work[FATE + p] = FREE if is_near | stays else BOUNDED


@numba.njit(cache=True, nogil=True)
def move_near_walls(occupancy, origin_m, cell_m, x, y, z, ax, ay, az, ex, ey, ez):
    """Move a point by the wind's part (a), which slides along walls, then by the eddies' (e), which they reflect.

    Most steps meet none. Arguments and results are those of `trace_reflections`.
    """
    nx, ny, nz = x + (ax + ex), y + (ay + ey), z + (az + ez)
    i, ni = cell_index(x, origin_m[0], cell_m), cell_index(nx, origin_m[0], cell_m)
    j, nj = cell_index(y, origin_m[1], cell_m), cell_index(ny, origin_m[1], cell_m)
    k, nk = cell_index(z, origin_m[2], cell_m), cell_index(nz, origin_m[2], cell_m)
    if (i == ni and j == nj and k == nk) or is_step_in_free_air(occupancy, i, j, k, ni, nj, nk):
        return nx, ny, nz, False, 1.0, 1.0, 1.0
    x, y, z, has_left, _, _, _ = trace_reflections(occupancy, origin_m, cell_m, x, y, z, ax, ay, az, reflects=False)
    if has_left:
        return x, y, z, True, 1.0, 1.0, 1.0
    return trace_reflections(occupancy, origin_m, cell_m, x, y, z, ex, ey, ez, reflects=True)


@numba.njit(cache=True, nogil=True)
def _list_bounded(work, n, bounded):
    # Counting without a branch, which would be unpredictable.
    n_bounded = 0
    for p in range(n):
        bounded[n_bounded] = p
        n_bounded += work[FATE + p] != FREE
    return n_bounded


@numba.njit(cache=True, nogil=True)
def _move_bounded(occupancy, origin_m, cell_m, position_m, wind_m_s, bounded, work):
    # Returns the number of filaments that left the room.
    n_gone = 0
    for p in bounded:
        ax, ay, az, ex, ey, ez = displacement_m(wind_m_s, work, p)
        if not math.isfinite((ax + ex) + (ay + ey) + (az + ez)):
            return NOT_FINITE
        x, y, z = position_m[3 * p], position_m[3 * p + 1], position_m[3 * p + 2]
        x, y, z, has_left, _, _, _ = move_near_walls(occupancy, origin_m, cell_m, x, y, z, ax, ay, az, ex, ey, ez)
        work[MOVED + p], work[MOVED + Y + p], work[MOVED + Z + p] = x, y, z
        if has_left:
            work[FATE + p] = LEFT
            n_gone += 1
    return n_gone


@numba.njit(cache=True, nogil=True)
def _store_all(position_m, sigma_m, work):
    for p in range(sigma_m.size):
        position_m[3 * p] = work[MOVED + p]
        position_m[3 * p + 1] = work[MOVED + Y + p]
        position_m[3 * p + 2] = work[MOVED + Z + p]
    for p in range(sigma_m.size):
        sigma_m[p] = work[SIGMA + p]


@numba.njit(cache=True, nogil=True)
def _compact_remaining(position_m, sigma_m, birth_steps, filament_id, source_index, first, n, n_left, work):
    # Moves the batch's remaining filaments behind those of earlier batches; returns the new end.
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
    position_world_m, sigma_m, birth_steps, filament_id, source_index, n, source_sigma_m, source_buoyancy,
    buoyancy_power, velocity_m_s, occupancy, is_open, origin_m, cell_m, step, step_s, noise_std_m, growth_m2_s, key,
):  # fmt: skip
    """Advance all filaments by one step and drop those that left through an outlet, keeping the order of birth.

    dp = (u(p) + b / sigma^q) dt + eta xi          xi standard normal per axis, eta = sqrt(2 D dt), b along z
    [m] = ([m/s] + [m^(1 + q)/s] / [m^q]) [s] + [m]
    sigma^2 = sigma0^2 + gamma age
    [m2] = [m2] + [m2/s] [s]

    A filament born within the step moves for the rest of it only (eta then with the root of the remaining fraction), so
    the plume does not depend on dt through birth. The number xi depends on (key, step, filament id, axis) alone: not on
    the order or number of filaments.

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
        is_open: (nx, ny, nz) uint8, not zero where a cell and its 26 neighbours are free (see `plume.find_open_cells`).
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
    step_key = derive_step_key(key, step)
    positions_m = position_world_m.reshape(-1)
    work, wind_m_s, weight = np.empty(N_WORK), np.empty(3 * BATCH, np.float32), np.empty(3 * BATCH, np.float32)
    bits, cell, listed = np.empty(3 * BATCH, np.uint64), np.empty(BATCH, np.int64), np.empty(3 * BATCH, np.int64)
    place, normal = work[POSITION:], work[NORMAL:]
    work[RISE : RISE + BATCH] = 0.0
    is_neutral = not source_buoyancy.any()
    is_flat_grid = min(velocity_m_s.shape[:3]) < 2
    n_left = 0
    for first in range(0, n, BATCH):
        m = min(BATCH, n - first)
        batch = slice(first, first + m)
        position_m = positions_m[3 * first : 3 * (first + m)]
        positions_in_cells(position_m, origin_m, cell_m, place)
        if is_flat_grid:
            wind_at_filaments_in_flat_grid(velocity_m_s, origin_m, cell_m, position_m, wind_m_s)
        else:
            wind_at_filaments(velocity_m_s, place, m, cell, weight, wind_m_s)
        find_reach(is_open, cell_m, m, cell, work)
        draw_filament_normals(step_key, filament_id[batch], bits, listed, normal)
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
            _store_all(position_m, sigma_m[batch], work)
            n_left += m
        else:
            n_left = _compact_remaining(
                positions_m, sigma_m, birth_steps, filament_id, source_index, first, m, n_left, work
            )
    return n_left
