# pyright: basic, reportCallIssue=false
# ruff: noqa: ANN001, ANN201, ANN202 - kernels have no types, and symbols of equations
"""Gas readings of a search: tapes of filaments, plumes that meander, and stored gas."""

import math
from typing import Any

import numpy as np
from llvmlite import ir
from numba.extending import intrinsic

from gslcosim_formats.stored_gas.playback import value_in_cell
from gslcosim_services.fields.mixing_ratio import filament_contribution_ppm, is_box_of_air, is_visible
from gslcosim_services.fields.spatial_index import Blocks, SortedFilaments, add_indexed_filaments_at_points_inplace
from gslcosim_training.batch.free_space import array_at, walls_of
from gslcosim_training.batch.plume_kernels import distances_along_and_across, plume_ppm, spreads_at
from gslcosim_training.batch.random_streams import next_normal_inplace, seed_inplace
from gslcosim_training.batch.reference_free_kernels import reference_free_njit

_ONE = np.uint64(1)


@reference_free_njit()
def begin_paths_inplace(wanders, memory, case, names, seed):
    """Begin the paths of a search's plumes at their first knots; see `gaussian_plume.WanderingPath`.

    Args:
        wanders: (2 n_plumes or more,) records of `WANDER`: sideways and upward, plume by plume; written.
        memory: (n,) numbers of the search, with the knots; written.
        case: Record of `CASE`.
        names: Bytes of the streams' names.
        seed: The search's seed, which counts where the gas has none of its own.
    """
    gas_seed = seed if case.gas_seed < 0 else case.gas_seed
    for w in range(2 * case.n_plumes):
        first = case.first_wander_name + w * case.n_wander_name
        seed_inplace(wanders[w].stream, gas_seed, names[first : first + case.n_wander_name])
        wanders[w].n_knots = 1
        memory[case.first_knot + w * case.n_knots] = next_normal_inplace(wanders[w].stream)


@reference_free_njit()
def _extend_inplace(wander, memory, case, first, n):
    step = math.sqrt(1.0 - case.wander_rho**2)
    while wander.n_knots < n:
        last = memory[first + (wander.n_knots - 1) % case.n_knots]
        knot = case.wander_rho * last + next_normal_inplace(wander.stream) * step
        memory[first + wander.n_knots % case.n_knots] = knot
        wander.n_knots += 1


@reference_free_njit()
def _path_at(memory, case, first, time_s):
    position = time_s / case.knot_s
    i = int(position)
    a = position - i
    scale = math.sqrt((1.0 - a) * (1.0 - a) + a * a + 2.0 * a * (1.0 - a) * case.wander_rho)
    return ((1.0 - a) * memory[first + i % case.n_knots] + a * memory[first + (i + 1) % case.n_knots]) / scale


@reference_free_njit()
def meandering_ppm(plume, i_plume, wanders, memory, case, tick, x_m, y_m, z_m):
    """Return the mixing ratio of a meandering plume [ppm by volume]; see `gaussian_plume.MeanderingPlume`.

    Args:
        plume: Record of `PLUME`: the mean plume.
        i_plume: Which of the case's plumes it is.
        wanders: (2 n_plumes or more,) records of `WANDER`; paths are drawn on to the time.
        memory: (n,) numbers of the search, with the knots; written.
        case: Record of `CASE`.
        tick: The tick that ends.
        x_m: Place, world frame [m].
        y_m: Place, world frame [m].
        z_m: Place, world frame [m].

    Held by:
        extensions/training/tests/integration/test_batch_equals_flight.py
    """
    time_s = (case.warm_up_steps + tick // case.gas_ticks_per_step * case.gas_steps_per_tick) * case.gas_step_s
    sideways, upward = 2 * i_plume, 2 * i_plume + 1
    first_y, first_z = case.first_knot + sideways * case.n_knots, case.first_knot + upward * case.n_knots
    n = int(time_s / case.knot_s) + 2
    _extend_inplace(wanders[sideways], memory, case, first_y, n)
    _extend_inplace(wanders[upward], memory, case, first_z, n)
    along_m, across_m = distances_along_and_across(plume, x_m, y_m)
    left_s = time_s - max(along_m, 0.0) / plume.speed_m_s
    if not along_m > 0.0 or left_s < 0.0:
        return 0.0
    sigma_y_m, sigma_z_m = spreads_at(plume, along_m)
    f, wander = case.instantaneous_frac, math.sqrt(1.0 - case.instantaneous_frac**2)
    aside_m = wander * sigma_y_m * _path_at(memory, case, first_y, left_s)
    rise_m = wander * sigma_z_m * _path_at(memory, case, first_z, left_s)
    return plume_ppm(plume, along_m, across_m - aside_m, z_m, rise_m, f * sigma_y_m, f * sigma_z_m)


@reference_free_njit()
def _column(coordinate_m, origin_m, column_m, n):
    return min(max(int((coordinate_m - origin_m) / column_m), 0), n - 1)


@reference_free_njit()
def sort_frames_inplace(first, rows, origin_m, column_m, nx, ny, starts, members, sorted_numbers, largest_sigma_m):
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
        sorted_numbers: (4, n) written: their x, y, z and sigma [m].
        largest_sigma_m: (n_frames,) written: the largest standard deviation of each frame [m].

    Held by:
        extensions/training/tests/unit/batch/test_gas_readings.py
    """
    for frame in range(len(first) - 1):
        at, n = first[frame], first[frame + 1] - first[frame]
        begins = starts[frame]
        begins[:] = 0
        largest_sigma_m[frame] = 0.0
        for f in range(n):
            i = _column(rows[at + f, 0], origin_m[0], column_m, nx)
            column = i * ny + _column(rows[at + f, 1], origin_m[1], column_m, ny)
            begins[column + 1] += 1
            largest_sigma_m[frame] = max(largest_sigma_m[frame], rows[at + f, 3])
        for column in range(nx * ny):
            begins[column + 1] += begins[column]
        for f in range(n):
            i = _column(rows[at + f, 0], origin_m[0], column_m, nx)
            column = i * ny + _column(rows[at + f, 1], origin_m[1], column_m, ny)
            slot = at + begins[column]
            members[slot] = f
            for k in range(4):
                sorted_numbers[k, slot] = rows[at + f, k]
            begins[column] += 1
        for column in range(nx * ny, 0, -1):
            begins[column] = begins[column - 1]
        begins[0] = 0


# In single precision, for many at a time; `margin_m2` is more than rounding adds.
@reference_free_njit()
def _mark_nearby_inplace(is_nearby, xs_m, ys_m, zs_m, sigmas_m, x_m, y_m, z_m, cutoff_sigma, margin_m2):
    for m in range(len(xs_m)):
        dx, dy, dz, reach = x_m - xs_m[m], y_m - ys_m[m], z_m - zs_m[m], cutoff_sigma * sigmas_m[m]
        is_nearby[m] = dx * dx + dy * dy + dz * dz <= reach * reach + margin_m2


@intrinsic
def _trailing_zeros(typingctx: Any, bits: Any) -> Any:
    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        del context, signature
        return builder.cttz(arguments[0], ir.Constant(ir.IntType(1), 0))

    return bits(bits), codegen


@reference_free_njit()
def _numbers_of(tape, at, n):
    numbers, row = tape.sorted_numbers + at * 4, tape.n_rows * 4
    return (
        array_at(numbers, n, np.float32), array_at(numbers + row, n, np.float32),
        array_at(numbers + 2 * row, n, np.float32), array_at(numbers + 3 * row, n, np.float32),
    )  # fmt: skip


@reference_free_njit()
def near_filaments_inplace(tape, frame, x_m, y_m, z_m, cutoff_sigma, work):
    """Write where those filaments of a frame stand that are within their cut-off of a place; return how many.

    Args:
        tape: Record of `TAPE`.
        frame: Which frame.
        x_m: Place, world frame [m].
        y_m: Place, world frame [m].
        z_m: Place, world frame [m].
        cutoff_sigma: Distance from which a filament counts as zero, in its standard deviations.
        work: Record of `WORK`; its `hits` are written: where they stand in the sorted frame, in the order that
            they have in the tape. `marks` are zeros, and are left so.

    Held by:
        extensions/training/tests/unit/batch/test_gas_readings.py
    """
    nx, ny = tape.shape[0], tape.shape[1]
    n_columns = nx * ny
    most = work.most_filaments
    hits, slots = array_at(work.hits, most, np.int32), array_at(work.slots, most, np.int32)
    marks, is_nearby = array_at(work.marks, most // 64 + 1, np.uint64), array_at(work.is_nearby, most, np.uint8)
    first = array_at(tape.first, tape.n_frames + 1, np.int64)
    at = first[frame]
    n = first[frame + 1] - at
    xs_m, ys_m, zs_m, sigmas_m = _numbers_of(tape, at, n)
    members = array_at(tape.members + at * 4, n, np.int32)
    starts = array_at(tape.starts + frame * (n_columns + 1) * 4, n_columns + 1, np.int32)
    # No filament of the frame reaches further than this, and a hair.
    reach_m = 1.000001 * cutoff_sigma * np.float64(array_at(tape.largest_sigma_m, tape.n_frames, np.float32)[frame])
    i_first = _column(x_m - reach_m, tape.origin_m[0], tape.column_m, nx)
    i_last = _column(x_m + reach_m, tape.origin_m[0], tape.column_m, nx)
    j_first = _column(y_m - reach_m, tape.origin_m[1], tape.column_m, ny)
    j_last = _column(y_m + reach_m, tape.origin_m[1], tape.column_m, ny)
    margin_m2 = np.float32(1e-6 * reach_m * (abs(x_m) + abs(y_m) + abs(z_m) + reach_m))
    x, y, z, cutoff = np.float32(x_m), np.float32(y_m), np.float32(z_m), np.float32(cutoff_sigma)
    n_hits = 0
    for i in range(i_first, i_last + 1):
        # Columns along y stand side by side.
        begin, end = starts[i * ny + j_first], starts[i * ny + j_last + 1]
        _mark_nearby_inplace(
            is_nearby, xs_m[begin:end], ys_m[begin:end], zs_m[begin:end], sigmas_m[begin:end], x, y, z, cutoff,
            margin_m2,
        )  # fmt: skip
        for k in range(end - begin):
            if not is_nearby[k]:
                continue
            m = begin + k
            fx, fy, fz = np.float64(xs_m[m]), np.float64(ys_m[m]), np.float64(zs_m[m])
            s = np.float64(sigmas_m[m])
            d2 = (x_m - fx) * (x_m - fx) + (y_m - fy) * (y_m - fy) + (z_m - fz) * (z_m - fz)
            if d2 > (cutoff_sigma * s) * (cutoff_sigma * s):
                continue
            f = members[m]
            slots[f] = m
            marks[f >> 6] |= _ONE << np.uint64(f & 63)
            n_hits += 1
    # Back into the tape's order, in which they are summed.
    k = 0
    for word in range((n + 63) >> 6):
        bits = marks[word]
        if bits == 0:
            continue
        marks[word] = 0
        while bits != 0:
            hits[k] = slots[(word << 6) + np.int64(_trailing_zeros(bits))]
            bits &= bits - _ONE
            k += 1
    return n_hits


@reference_free_njit()
def add_tape_inplace(tape, frame, room, x_m, y_m, z_m, cutoff_sigma, strengths, gas_of_source, work, ppm):
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
        work: Record of `WORK`.
        ppm: (n_gases,) mixing ratios [ppm]; added to.

    Held by:
        extensions/training/tests/integration/test_batch_equals_flight.py
    """
    n_hits = near_filaments_inplace(tape, frame, x_m, y_m, z_m, cutoff_sigma, work)
    if n_hits == 0:
        return
    hits = array_at(work.hits, work.most_filaments, np.int32)
    first = array_at(tape.first, tape.n_frames + 1, np.int64)
    at = first[frame]
    n = first[frame + 1] - at
    xs_m, ys_m, zs_m, sigmas_m = _numbers_of(tape, at, n)
    members = array_at(tape.members + at * 4, n, np.int32)
    sources = array_at(tape.sources + at, n, np.uint8)
    walls = walls_of(room)
    x0, x1, y0, y1, z0, z1 = x_m, x_m, y_m, y_m, z_m, z_m
    for k in range(n_hits):
        m = hits[k]
        fx, fy, fz = np.float64(xs_m[m]), np.float64(ys_m[m]), np.float64(zs_m[m])
        x0, x1, y0, y1, z0, z1 = min(x0, fx), max(x1, fx), min(y0, fy), max(y1, fy), min(z0, fz), max(z1, fz)
    # Where all that is around them is air, nobody hides.
    is_open = is_box_of_air(walls, x0, x1, y0, y1, z0, z1)
    for k in range(n_hits):
        m = hits[k]
        fx, fy, fz = np.float64(xs_m[m]), np.float64(ys_m[m]), np.float64(zs_m[m])
        s = np.float64(sigmas_m[m])
        if not (is_open or is_visible(walls, x_m, y_m, z_m, fx, fy, fz)):
            continue
        source = 0
        if tape.sources != 0:
            source = sources[members[m]]
        d2 = (x_m - fx) * (x_m - fx) + (y_m - fy) * (y_m - fy) + (z_m - fz) * (z_m - fz)
        ppm[gas_of_source[source]] += filament_contribution_ppm(strengths[source], s, d2)


@reference_free_njit()
def add_frame_inplace(frame, room, place_m, cutoff_sigma, work, ppm):
    """Add what a frame contributes at a place; see `PlaybackField`, and `FilamentField` where it uses its index.

    Args:
        frame: Record of `FRAME`.
        room: Record of `ROOM`; its walls hide filaments.
        place_m: (1, 3) place, world frame [m].
        cutoff_sigma: Distance from which a filament counts as zero, in its standard deviations.
        work: Record of `WORK`.
        ppm: (1, n_gases) mixing ratios of those that are released [ppm]; added to.

    Held by:
        extensions/training/tests/integration/test_batch_equals_flight.py
    """
    if frame.ppm != 0:
        shape = (frame.shape[0], frame.shape[1], frame.shape[2])
        values = array_at(frame.ppm, shape, np.float32)
        x, y, z = place_m[0, 0], place_m[0, 1], place_m[0, 2]
        ppm[0, 0] += value_in_cell(values, frame.origin_m, frame.cell_m, frame.is_plane != 0, x, y, z)
        return
    n, (nx, ny, nz) = frame.n_filaments, (frame.n_blocks[0], frame.n_blocks[1], frame.n_blocks[2])
    blocks = Blocks(
        (frame.block_origin_m[0], frame.block_origin_m[1], frame.block_origin_m[2]),
        frame.block_m,
        (nx, ny, nz),
        array_at(frame.first, nx * ny * nz + 1, np.int32),
        array_at(frame.largest_sigma_m, nx * ny, np.float64),
    )
    rows = SortedFilaments(
        array_at(frame.x, n, np.float64),
        array_at(frame.y, n, np.float64),
        array_at(frame.z, n, np.float64),
        array_at(frame.exponent_per_m2, n, np.float64),
        array_at(frame.centre_ppm, n, np.float64),
        array_at(frame.gas, n, np.int32),
        array_at(frame.gas, n, np.int32),
        array_at(work.shares, work.most_filaments, np.float64),
    )
    largest_m, walls = frame.largest_of_all_m, walls_of(room)
    add_indexed_filaments_at_points_inplace(place_m, blocks, rows, largest_m, cutoff_sigma, walls, ppm)
