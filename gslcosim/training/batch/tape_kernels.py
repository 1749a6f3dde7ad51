"""Readings of a tape of filaments: the sum of a single flight, in its order, of those that may be near only."""
# pyright: basic, reportCallIssue=false

import numba
import numpy as np

from gslcosim.fields.reading.concentration_kernels import WallCells, is_seen, share_of_filament_ppm
from gslcosim.training.batch.space_kernels import array_at


@numba.njit(cache=True, nogil=True, _nrt=False)
def _column(coordinate_m, origin_m, column_m, n):
    return min(max(int((coordinate_m - origin_m) / column_m), 0), n - 1)


@numba.njit(cache=True, nogil=True, _nrt=False)
def sort_frames_inplace(first, rows, origin_m, column_m, nx, ny, starts, members, largest_sigma_m):
    """Sort the filaments of each frame of a tape into columns of space, in their order.

    Args:
        first: (n_frames + 1,) where each frame begins.
        rows: (n, 4) x, y, z and sigma [m].
        origin_m: (2,) corner of the first column, world frame [m]; what lies outside counts to the border.
        column_m: Edge of the columns [m].
        nx: Columns along x.
        ny: Columns along y.
        starts: (n_frames, nx ny + 1) written: where each column's filaments begin, from the frame's first on.
        members: (n,) written: which filaments of the frame they are.
        largest_sigma_m: (n_frames, nx ny) written: the largest standard deviation in each column [m].

    Held by:
        tests/unit/training/batch/test_tape_kernels.py
    """
    for frame in range(len(first) - 1):
        at, n = first[frame], first[frame + 1] - first[frame]
        begins, largest = starts[frame], largest_sigma_m[frame]
        begins[:] = 0
        largest[:] = 0.0
        for f in range(n):
            i = _column(rows[at + f, 0], origin_m[0], column_m, nx)
            column = i * ny + _column(rows[at + f, 1], origin_m[1], column_m, ny)
            begins[column + 1] += 1
            largest[column] = max(largest[column], rows[at + f, 3])
        for column in range(nx * ny):
            begins[column + 1] += begins[column]
        for f in range(n):
            i = _column(rows[at + f, 0], origin_m[0], column_m, nx)
            column = i * ny + _column(rows[at + f, 1], origin_m[1], column_m, ny)
            members[at + begins[column]] = f
            begins[column] += 1
        for column in range(nx * ny, 0, -1):
            begins[column] = begins[column - 1]
        begins[0] = 0


@numba.njit(cache=True, nogil=True, _nrt=False)
def _gap2_m2(coordinate_m, origin_m, column_m, i, n):
    # Square of the distance to a column's extent; those of the border reach on for ever.
    low, high = origin_m + i * column_m, origin_m + (i + 1) * column_m
    gap = 0.0
    if i > 0:
        gap = max(gap, low - coordinate_m)
    if i < n - 1:
        gap = max(gap, coordinate_m - high)
    return gap * gap


@numba.njit(cache=True, nogil=True, _nrt=False)
def _sort_inplace(hits, n):
    # By insertion: they come in runs that are sorted.
    for k in range(1, n):
        hit = hits[k]
        j = k - 1
        while j >= 0 and hits[j] > hit:
            hits[j + 1] = hits[j]
            j -= 1
        hits[j + 1] = hit


@numba.njit(cache=True, nogil=True, _nrt=False)
def near_filaments_inplace(tape, frame, x_m, y_m, z_m, cutoff_sigma, hits):
    """Write which filaments of a frame are within their cut-off of a place, in their order; return how many.

    Args:
        tape: Record of `TAPE`.
        frame: Which frame.
        x_m: Place, world frame [m].
        y_m: Place, world frame [m].
        z_m: Place, world frame [m].
        cutoff_sigma: Distance from which a filament counts as zero, in its standard deviations.
        hits: (n,) written; as long as the largest frame.

    Held by:
        tests/unit/training/batch/test_tape_kernels.py
    """
    nx, ny = tape.shape[0], tape.shape[1]
    n_columns = nx * ny
    first = array_at(tape.first, tape.n_frames + 1, np.int64)
    at = first[frame]
    n = first[frame + 1] - at
    rows = array_at(tape.rows + at * 16, (n, 4), np.float32)
    members = array_at(tape.members + at * 4, n, np.int32)
    starts = array_at(tape.starts + frame * (n_columns + 1) * 4, n_columns + 1, np.int32)
    largest = array_at(tape.largest_sigma_m + frame * n_columns * 4, n_columns, np.float32)
    # No filament of the frame reaches further than this, and a hair.
    reach_m = 1.000001 * cutoff_sigma * np.float64(array_at(tape.frame_sigma_m, tape.n_frames, np.float32)[frame])
    i_first = _column(x_m - reach_m, tape.origin_m[0], tape.column_m, nx)
    i_last = _column(x_m + reach_m, tape.origin_m[0], tape.column_m, nx)
    j_first = _column(y_m - reach_m, tape.origin_m[1], tape.column_m, ny)
    j_last = _column(y_m + reach_m, tape.origin_m[1], tape.column_m, ny)
    n_hits = 0
    for i in range(i_first, i_last + 1):
        gap_x2 = _gap2_m2(x_m, tape.origin_m[0], tape.column_m, i, nx)
        for j in range(j_first, j_last + 1):
            column = i * ny + j
            begin, end = starts[column], starts[column + 1]
            if begin == end:
                continue
            reach_m = cutoff_sigma * np.float64(largest[column])
            # A hair more, so that rounding of the gap leaves nobody out.
            if gap_x2 + _gap2_m2(y_m, tape.origin_m[1], tape.column_m, j, ny) > reach_m * reach_m * 1.000001:
                continue
            for m in range(begin, end):
                f = members[m]
                fx, fy, fz = np.float64(rows[f, 0]), np.float64(rows[f, 1]), np.float64(rows[f, 2])
                s = np.float64(rows[f, 3])
                d2 = (x_m - fx) * (x_m - fx) + (y_m - fy) * (y_m - fy) + (z_m - fz) * (z_m - fz)
                if d2 > (cutoff_sigma * s) * (cutoff_sigma * s):
                    continue
                hits[n_hits] = f
                n_hits += 1
    _sort_inplace(hits, n_hits)
    return n_hits


@numba.njit(cache=True, nogil=True, _nrt=False)
def add_tape_inplace(tape, frame, room, x_m, y_m, z_m, cutoff_sigma, strengths, gas_of_source, hits, ppm):
    """Add what the filaments of a frame contribute at a place; the same sum as `add_filaments_at_points_inplace`.

    Args:
        tape: Record of `TAPE`.
        frame: Which frame.
        room: Record of `ROOM`; its walls hide filaments.
        x_m: Place, world frame [m].
        y_m: Place, world frame [m].
        z_m: Place, world frame [m].
        cutoff_sigma: Distance from which a filament counts as zero, in its standard deviations.
        strengths: (n_sources,) a filament's gas as volume of pure gas [ppm m3].
        gas_of_source: (n_sources,) which gas it is.
        hits: (n,) scratch; as long as the largest frame.
        ppm: (n_gases,) mixing ratios [ppm]; added to.

    Held by:
        tests/integration/training/test_batch_equals_flight.py
    """
    n_hits = near_filaments_inplace(tape, frame, x_m, y_m, z_m, cutoff_sigma, hits)
    if n_hits == 0:
        return
    first = array_at(tape.first, tape.n_frames + 1, np.int64)
    at = first[frame]
    n = first[frame + 1] - at
    rows = array_at(tape.rows + at * 16, (n, 4), np.float32)
    nx, ny, nz = room.shape[0], room.shape[1], room.shape[2]
    is_opaque = True
    walls = WallCells(
        is_opaque,
        array_at(room.occupancy, (nx, ny, nz), np.uint8),
        array_at(room.solid_sums, (nx + 1, ny + 1, nz + 1), np.int32),
        (room.origin_m[0], room.origin_m[1], room.origin_m[2]),
        room.cell_m,
    )
    for k in range(n_hits):
        f = hits[k]
        fx, fy, fz = np.float64(rows[f, 0]), np.float64(rows[f, 1]), np.float64(rows[f, 2])
        s = np.float64(rows[f, 3])
        if not is_seen(walls, x_m, y_m, z_m, fx, fy, fz):
            continue
        source = 0
        if tape.sources != 0:
            source = array_at(tape.sources + at, n, np.uint8)[f]
        d2 = (x_m - fx) * (x_m - fx) + (y_m - fy) * (y_m - fy) + (z_m - fz) * (z_m - fz)
        ppm[gas_of_source[source]] += share_of_filament_ppm(strengths[source], s, d2)
