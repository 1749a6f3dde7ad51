"""The mixing ratio that filaments add up to, at points and on grids."""
# pyright: basic

import math
from typing import Any, NamedTuple

import numba
import numpy as np

from gslcosim.environment.sight_kernels import is_line_of_sight_free
from gslcosim.fields.filament.trace_kernels import cell_index

NORMALISATION = (2.0 * math.pi) ** 1.5


class WallCells(NamedTuple):
    """What hides gas from a reading, as kernels take it.

    `is_opaque` says whether gas is hidden at all; `occupancy` (nx, ny, nz) uint8, 1 is solid; `solid_sums`
    (nx + 1, ny + 1, nz + 1) int32, number of solid cells below each corner (see `sums_of_solids`); `origin_m` (3,)
    corner of cell (0, 0, 0), world frame [m]; `cell_m` edge of the cubic cells [m].
    """

    is_opaque: bool
    occupancy: Any
    solid_sums: Any
    origin_m: Any
    cell_m: float


class FilamentTable(NamedTuple):
    """Filaments of one instant, as kernels take them.

    `position_world_m` (n, 3) centres, world frame, xyz [m]; `sigma_m` (n,) standard deviations s [m], > 0;
    `source_index` (n,) int32 index into the next two: `strength_ppm_m3` (n_sources,) a filament's gas as volume of pure
    gas, S = 1e6 N / n_air [ppm m3], `gas_index` (n_sources,) int32 gas of each source.
    """

    position_world_m: Any
    sigma_m: Any
    source_index: Any
    strength_ppm_m3: Any
    gas_index: Any


@numba.njit(cache=True, nogil=True)
def place_of(position_world_m, f):
    """Return a filament's place in double precision, whatever the table has: sums are of doubles.

    Args:
        position_world_m: (n, 3) places [m], in double or single precision.
        f: Which filament.

    Held by:
        tests/unit/fields/reading/test_concentration.py
    """
    return (
        np.float64(position_world_m[f, 0]),
        np.float64(position_world_m[f, 1]),
        np.float64(position_world_m[f, 2]),
    )


@numba.njit(cache=True, nogil=True)
def _n_solid_in_box(solid_sums, i0, j0, k0, i1, j1, k1):
    # Solid cells from (i0, j0, k0) to (i1, j1, k1), both included: inclusion and exclusion on the summed table.
    return (
        solid_sums[i1 + 1, j1 + 1, k1 + 1]
        - solid_sums[i0, j1 + 1, k1 + 1]
        - solid_sums[i1 + 1, j0, k1 + 1]
        - solid_sums[i1 + 1, j1 + 1, k0]
        + solid_sums[i0, j0, k1 + 1]
        + solid_sums[i0, j1 + 1, k0]
        + solid_sums[i1 + 1, j0, k0]
        - solid_sums[i0, j0, k0]
    )


@numba.njit(cache=True, nogil=True)
def is_box_of_air(walls, x0, x1, y0, y1, z0, z1):
    """Tell whether no cell that touches a box is solid; outside the grid nothing is.

    Args:
        walls: `WallCells`.
        x0: Least x of the box, world frame [m]; y0 and z0 likewise.
        x1: Greatest x of the box, world frame [m], finite; y1 and z1 likewise.
        y0: See x0.
        y1: See x1.
        z0: See x0.
        z1: See x1.

    Held by:
        tests/unit/fields/reading/test_concentration.py
    """
    solid_sums, origin_m, cell_m = walls.solid_sums, walls.origin_m, walls.cell_m
    nx, ny, nz = solid_sums.shape[0] - 1, solid_sums.shape[1] - 1, solid_sums.shape[2] - 1
    i0, i1 = max(cell_index(x0, origin_m[0], cell_m), 0), min(cell_index(x1, origin_m[0], cell_m), nx - 1)
    j0, j1 = max(cell_index(y0, origin_m[1], cell_m), 0), min(cell_index(y1, origin_m[1], cell_m), ny - 1)
    k0, k1 = max(cell_index(z0, origin_m[2], cell_m), 0), min(cell_index(z1, origin_m[2], cell_m), nz - 1)
    return i0 > i1 or j0 > j1 or k0 > k1 or _n_solid_in_box(solid_sums, i0, j0, k0, i1, j1, k1) == 0


@numba.njit(cache=True, nogil=True)
def is_seen(walls, ax, ay, az, bx, by, bz):
    """Tell whether no solid cell lies between two points; at once where the box around them is all air.

    The same answer as `environment.sight_kernels.is_line_of_sight_free`, several times faster in open rooms.

    Args:
        walls: `WallCells`.
        ax: First point, world frame [m].
        ay: First point, world frame [m].
        az: First point, world frame [m].
        bx: Second point, world frame [m].
        by: Second point, world frame [m].
        bz: Second point, world frame [m].

    Held by:
        tests/unit/fields/reading/test_concentration.py (equals the plain traversal)
    """
    if is_box_of_air(walls, min(ax, bx), max(ax, bx), min(ay, by), max(ay, by), min(az, bz), max(az, bz)):
        return True
    return is_line_of_sight_free(walls.occupancy, walls.origin_m, walls.cell_m, ax, ay, az, bx, by, bz)


@numba.njit(cache=True, nogil=True)
def share_of_filament_ppm(strength_ppm_m3, sigma_m, distance2_m2):
    """Return what a filament adds to the mixing ratio at a distance [ppm]; see `add_filaments_at_points_inplace`.

    Args:
        strength_ppm_m3: Its gas as volume of pure gas [ppm m3].
        sigma_m: Its standard deviation [m], > 0.
        distance2_m2: Square of the distance from its centre [m2].
    """
    s = sigma_m
    return strength_ppm_m3 / (NORMALISATION * s * s * s) * math.exp(-0.5 * distance2_m2 / (s * s))


@numba.njit(cache=True, nogil=True)
def add_filaments_at_points_inplace(points_world_m, filaments, cutoff_sigma, walls, mixing_ratio_ppm):
    """Add to each point what every filament contributes to its mixing ratio.

    X = sum of S / ((2 pi)^(3/2) s^3) exp(-d^2 / (2 s^2))   over filaments with d <= cutoff s that are in sight
    [ppm] = [ppm m3] / [m3]; the exponent is dimensionless. The integral over all space is S (up to the cut-off).

    Args:
        points_world_m: (m, 3) points, world frame, xyz [m].
        filaments: `FilamentTable`; its gases are columns of the result.
        cutoff_sigma: Distance from which a filament counts as zero, in its standard deviations.
        walls: `WallCells`.
        mixing_ratio_ppm: (m, n_gases) mixing ratios [ppm by volume]; added to.

    Source:
        GADEN, gaden_player/src/simulation_player.cpp: sum, cut-off at 5 sigma, line of sight.
    Deviation:
        The line of sight is exact and includes both end cells; GADEN samples it and skips the ends.
    Left out:
        Reflection of a filament's Gaussian at walls: gas beyond a wall is lost from the reading.
    Held by:
        tests/unit/fields/reading/test_concentration.py, tests/analytic/test_gas_concentration.py (GSL-Bench's grids)
    """
    position_world_m, sigma_m = filaments.position_world_m, filaments.sigma_m
    for p in range(points_world_m.shape[0]):
        x, y, z = points_world_m[p, 0], points_world_m[p, 1], points_world_m[p, 2]
        for f in range(sigma_m.shape[0]):
            fx, fy, fz = place_of(position_world_m, f)
            s = np.float64(sigma_m[f])
            d2 = (x - fx) * (x - fx) + (y - fy) * (y - fy) + (z - fz) * (z - fz)
            if d2 > (cutoff_sigma * s) * (cutoff_sigma * s):
                continue
            if walls.is_opaque and not is_seen(walls, x, y, z, fx, fy, fz):
                continue
            source = filaments.source_index[f]
            share = share_of_filament_ppm(filaments.strength_ppm_m3[source], s, d2)
            mixing_ratio_ppm[p, filaments.gas_index[source]] += share


@numba.njit(cache=True, nogil=True)
def _first_and_last(coordinate_m, reach_m, origin_m, spacing_m, n):
    # Indices of the first and the last sample point within reach, clipped to the n that there are.
    first = math.ceil((coordinate_m - reach_m - origin_m) / spacing_m)
    last = math.floor((coordinate_m + reach_m - origin_m) / spacing_m)
    return max(int(first), 0), min(int(last), n - 1)


@numba.njit(cache=True, nogil=True)
def _sample_gaussian(coordinate_m, s, origin_m, spacing_m, first, last, gaussian, offset2_m2):
    # exp(-d^2 / (2 s^2)) at equidistant points by two products each instead of an exponential:
    # g(d + h) = g(d) q(d) and q(d + h) = q(d) exp(-h^2 / s^2). Rounding grows with the square of their number:
    # below 1e-12 for the hundred that there are in practice.
    d = origin_m + first * spacing_m - coordinate_m
    g = math.exp(-0.5 * d * d / (s * s))
    q = math.exp(-(d + 0.5 * spacing_m) * spacing_m / (s * s))
    qq = math.exp(-spacing_m * spacing_m / (s * s))
    for i in range(first, last + 1):
        d = origin_m + i * spacing_m - coordinate_m
        gaussian[i] = g
        offset2_m2[i] = d * d
        g *= q
        q *= qq


@numba.njit(cache=True, nogil=True)
def _add_row(row_ppm, ppm, rest_m2, first, last, gaussian, offset2_m2):
    # The part of a row within reach: a run without a branch on unit stride, for vector instructions.
    n = last + 1 - first
    some_ppm, g, d2 = row_ppm[first : last + 1], gaussian[first : last + 1], offset2_m2[first : last + 1]
    for k in range(n):
        some_ppm[k] += ppm * g[k] if d2[k] <= rest_m2 else 0.0


@numba.njit(cache=True, nogil=True)
def add_filaments_to_grid_inplace(filaments, gas, cutoff_sigma, first_point_m, spacing_m, mixing_ratio_ppm):
    """Add to a regular grid of points what every filament of one gas contributes, filament by filament.

    The same sum as `add_filaments_at_points_inplace` without walls. A filament's Gaussian is the product of three,
    one per axis, so its cost is that of the points within its cut-off and a product each.

    Args:
        filaments: `FilamentTable`.
        gas: Which gas to sum.
        cutoff_sigma: Distance from which a filament counts as zero, in its standard deviations.
        first_point_m: (3,) the point with index (0, 0, 0), world frame [m].
        spacing_m: Distance of neighbouring points, equal along all axes [m].
        mixing_ratio_ppm: (nx, ny, nz) mixing ratio [ppm by volume], index order ij; added to. A slice has nz = 1.

    Held by:
        tests/unit/fields/reading/test_concentration.py (equals the sum at points, box of three side lengths),
        tests/analytic/test_gas_concentration.py (GSL-Bench's grids)
    """
    position_world_m, sigma_m = filaments.position_world_m, filaments.sigma_m
    nx, ny, nz = mixing_ratio_ppm.shape
    gx, gy, gz = np.empty(nx), np.empty(ny), np.empty(nz)
    dx2, dy2, dz2 = np.empty(nx), np.empty(ny), np.empty(nz)
    for f in range(sigma_m.shape[0]):
        source = filaments.source_index[f]
        if filaments.gas_index[source] != gas:
            continue
        s = np.float64(sigma_m[f])
        reach_m = cutoff_sigma * s
        x, y, z = place_of(position_world_m, f)
        k0, k1 = _first_and_last(z, reach_m, first_point_m[2], spacing_m, nz)
        i0, i1 = _first_and_last(x, reach_m, first_point_m[0], spacing_m, nx)
        j0, j1 = _first_and_last(y, reach_m, first_point_m[1], spacing_m, ny)
        if k0 > k1 or i0 > i1 or j0 > j1:
            continue
        _sample_gaussian(x, s, first_point_m[0], spacing_m, i0, i1, gx, dx2)
        _sample_gaussian(y, s, first_point_m[1], spacing_m, j0, j1, gy, dy2)
        _sample_gaussian(z, s, first_point_m[2], spacing_m, k0, k1, gz, dz2)
        centre_ppm = filaments.strength_ppm_m3[source] / (NORMALISATION * s * s * s)
        reach2_m2 = reach_m * reach_m
        if nz == 1:
            plane = mixing_ratio_ppm.reshape(nx, ny)
            for i in range(i0, i1 + 1):
                rest_m2 = reach2_m2 - dz2[0] - dx2[i]
                if rest_m2 >= 0.0:
                    _add_row(plane[i], centre_ppm * gz[0] * gx[i], rest_m2, j0, j1, gy, dy2)
            continue
        for i in range(i0, i1 + 1):
            for j in range(j0, j1 + 1):
                column_ppm = centre_ppm * gx[i] * gy[j]
                rest_m2 = reach2_m2 - dx2[i] - dy2[j]
                if rest_m2 < 0.0:
                    continue
                _add_row(mixing_ratio_ppm[i, j], column_ppm, rest_m2, k0, k1, gz, dz2)
