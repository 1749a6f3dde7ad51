# pyright: basic
"""Mixing ratio that filaments add up to at points and on grids, with walls that hide them.

Arguments of several functions: `points_world_m` (m, 3) points, world frame, xyz [m]; `walls` those that hide gas,
`Walls`; `cutoff_sigma` distance from which a filament counts as zero, in its standard deviations.
"""

# ruff: noqa: ANN001, ANN201, ANN202 - kernels have no types, and symbols of equations

import math
from collections.abc import Callable
from typing import Any, NamedTuple, Self

import numba
import numpy as np
from numpy.typing import NDArray

from gslcosim.base import elementary
from gslcosim.base.errors import ShapeError
from gslcosim.base.gases import air_density_mol_m3
from gslcosim.base.quantities import Vec3
from gslcosim.environment.grid_kernels import is_line_of_sight_free
from gslcosim.environment.model import Cell, Environment, Grid
from gslcosim_services.fields.filament.filament_step import cell_index
from gslcosim_services.fields.filament.plume import Filaments

NORMALISATION = 2.0 * math.pi * math.sqrt(2.0 * math.pi)

CUTOFF_SIGMA = 5.0


class Walls(NamedTuple):
    """Walls that hide gas from readings, in the form for kernels.

    `is_opaque` is false where no cell is solid; `occupancy` (nx, ny, nz) uint8, 1 is solid; `solid_sums`
    (nx + 1, ny + 1, nz + 1) int32, number of solid cells below each corner (see `build_solid_sums`); `origin_m` (3,)
    corner of cell (0, 0, 0), world frame [m]; `cell_m` edge of the cubic cells [m].
    """

    is_opaque: bool
    occupancy: Any
    solid_sums: Any
    origin_m: Any
    cell_m: float

    @classmethod
    def of(cls, environment: Environment) -> Self:
        """Return the walls of an environment."""
        return cls.of_occupancy(environment.occupancy, environment.grid)

    @classmethod
    def of_occupancy(cls, occupancy: NDArray[np.uint8], grid: Grid) -> Self:
        """Return the walls of (nx, ny, nz) cells; those of another kind than solid do not hide anything."""
        cells = np.ascontiguousarray(occupancy, np.uint8)
        sums = build_solid_sums(cells)
        return cls(bool(sums[-1, -1, -1]), cells, sums, to_float3(grid.origin_m), float(grid.cell_m))


class FilamentArrays(NamedTuple):
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
def filament_position(position_world_m, f):
    """Return a filament's position in double precision, whatever the table has: sums are of doubles.

    Args:
        position_world_m: (n, 3) places [m], in double or single precision.
        f: Which filament.

    Held by:
        tests/unit/services/fields/test_mixing_ratio.py
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
    """Return whether no cell that touches a box is solid; outside the grid nothing is.

    Args:
        x0, y0, z0: Least corner of the box, world frame [m].
        x1, y1, z1: Greatest corner of it, finite.

    Held by:
        tests/unit/services/fields/test_mixing_ratio.py
    """
    solid_sums, origin_m, cell_m = walls.solid_sums, walls.origin_m, walls.cell_m
    nx, ny, nz = solid_sums.shape[0] - 1, solid_sums.shape[1] - 1, solid_sums.shape[2] - 1
    i0, i1 = max(cell_index(x0, origin_m[0], cell_m), 0), min(cell_index(x1, origin_m[0], cell_m), nx - 1)
    j0, j1 = max(cell_index(y0, origin_m[1], cell_m), 0), min(cell_index(y1, origin_m[1], cell_m), ny - 1)
    k0, k1 = max(cell_index(z0, origin_m[2], cell_m), 0), min(cell_index(z1, origin_m[2], cell_m), nz - 1)
    return i0 > i1 or j0 > j1 or k0 > k1 or _n_solid_in_box(solid_sums, i0, j0, k0, i1, j1, k1) == 0


@numba.njit(cache=True, nogil=True)
def is_visible(walls, ax, ay, az, bx, by, bz):
    """Return whether no solid cell lies between two points; at once where the box around them is all air.

    The same answer as `environment.sight_kernels.is_line_of_sight_free`, several times faster in open rooms.

    Args:
        ax, ay, az: First point, world frame [m].
        bx, by, bz: Second point, world frame [m].

    Held by:
        tests/unit/services/fields/test_mixing_ratio.py (equals the plain traversal)
    """
    if is_box_of_air(walls, min(ax, bx), max(ax, bx), min(ay, by), max(ay, by), min(az, bz), max(az, bz)):
        return True
    return is_line_of_sight_free(walls.occupancy, walls.origin_m, walls.cell_m, ax, ay, az, bx, by, bz)


@numba.njit(cache=True, nogil=True)
def filament_contribution_ppm(strength_ppm_m3, sigma_m, distance2_m2):
    """Return the mixing ratio that a filament adds at a distance [ppm]; see `add_filaments_at_points_inplace`.

    Args:
        strength_ppm_m3: Its gas as volume of pure gas [ppm m3].
        sigma_m: Its standard deviation [m], > 0.
        distance2_m2: Square of the distance from its centre [m2].
    """
    s = sigma_m
    return strength_ppm_m3 / (NORMALISATION * s * s * s) * elementary.exp(-0.5 * distance2_m2 / (s * s))


@numba.njit(cache=True, nogil=True, inline="always")
def add_adjusted_filaments_inplace(
    points_world_m, filaments, cutoff_sigma, walls, mixing_ratio_ppm, adjust_share, surroundings
):
    """Add to each point the contribution of every filament, adjusted for its surroundings; see the callers.

    It is inlined into its callers at compilation: passing the tuples on costs several times the sum.

    Args:
        filaments: `FilamentArrays`.
        mixing_ratio_ppm: (m, n_gases) mixing ratios [ppm by volume]; added to.
        adjust_share: Compiled function of a contribution [ppm], `surroundings`, the point, the filament's centre and
            its standard deviation; it returns the adjusted contribution.
        surroundings: Data for `adjust_share`.

    Returns:
        (m,) mean standard deviation of the filaments at the points, by mixing ratio, walls or not [m]; or 0.

    Held by:
        tests/unit/services/fields/test_mixing_ratio.py, tests/unit/services/fields/test_wall_images.py
    """
    position_world_m, sigma_m = filaments.position_world_m, filaments.sigma_m
    mean_m = np.zeros(points_world_m.shape[0])
    for p in range(points_world_m.shape[0]):
        x, y, z = points_world_m[p, 0], points_world_m[p, 1], points_world_m[p, 2]
        total = 0.0
        for f in range(sigma_m.shape[0]):
            fx, fy, fz = filament_position(position_world_m, f)
            s = np.float64(sigma_m[f])
            d2 = (x - fx) * (x - fx) + (y - fy) * (y - fy) + (z - fz) * (z - fz)
            if d2 > (cutoff_sigma * s) * (cutoff_sigma * s):
                continue
            source = filaments.source_index[f]
            share = filament_contribution_ppm(filaments.strength_ppm_m3[source], s, d2)
            total += share
            mean_m[p] += share * s
            if walls.is_opaque and not is_visible(walls, x, y, z, fx, fy, fz):
                continue
            share = adjust_share(share, surroundings, x, y, z, fx, fy, fz, s)
            mixing_ratio_ppm[p, filaments.gas_index[source]] += share
        mean_m[p] /= max(total, 1e-300)
    return mean_m


@numba.njit(cache=True, nogil=True, inline="always")
def _keep_share(share, surroundings, x, y, z, fx, fy, fz, s):
    return share


@numba.njit(cache=True, nogil=True)
def add_filaments_at_points_inplace(points_world_m, filaments, cutoff_sigma, walls, mixing_ratio_ppm):
    """Add to each point the contribution of every filament to its mixing ratio, and return their mean size there.

    X = sum of S / ((2 pi)^(3/2) s^3) exp(-d^2 / (2 s^2))   over filaments with d <= cutoff s that are in sight
    [ppm] = [ppm m3] / [m3]; the exponent is dimensionless. The integral over all space is S (up to the cut-off).

    Args:
        filaments: `FilamentArrays`; its gases are columns of the result.
        mixing_ratio_ppm: (m, n_gases) mixing ratios [ppm by volume]; added to.

    Source:
        GADEN, gaden_player/src/simulation_player.cpp: sum, cut-off at 5 sigma, line of sight.
    Deviation:
        The line of sight is exact and includes both end cells; GADEN samples it and skips the ends.
    Left out:
        Reflection of a filament's Gaussian at walls: gas beyond a wall is lost from the reading.
    Held by:
        tests/unit/services/fields/test_mixing_ratio.py, tests/analytic/test_gas_concentration.py
        (GSL-Bench's grids)
    """
    return add_adjusted_filaments_inplace(
        points_world_m, filaments, cutoff_sigma, walls, mixing_ratio_ppm, _keep_share, None
    )


@numba.njit(cache=True, nogil=True)
def _first_and_last(coordinate_m, reach_m, origin_m, spacing_m, n):
    # Indices of the first and the last sample point within reach, clipped to the n that there are.
    first = math.ceil((coordinate_m - reach_m - origin_m) / spacing_m)
    last = math.floor((coordinate_m + reach_m - origin_m) / spacing_m)
    return max(int(first), 0), min(int(last), n - 1)


@numba.njit(cache=True, nogil=True)
def _sample_gaussian(coordinate_m, s, origin_m, spacing_m, first, last, qq, gaussian, offset2_m2):
    # exp(-d^2 / (2 s^2)) at equidistant points by two products each instead of an exponential:
    # g(d + h) = g(d) q(d) and q(d + h) = q(d) qq, qq = exp(-h^2 / s^2). Rounding grows with the square of their number:
    # below 1e-12 for the hundred that there are in practice.
    d = origin_m + first * spacing_m - coordinate_m
    g = elementary.exp(-0.5 * d * d / (s * s))
    q = elementary.exp(-(d + 0.5 * spacing_m) * spacing_m / (s * s)) if last > first else 0.0
    for i in range(first, last + 1):
        d = origin_m + i * spacing_m - coordinate_m
        gaussian[i] = g
        offset2_m2[i] = d * d
        g *= q
        q *= qq


@numba.njit(cache=True, nogil=True, inline="always")
def _add_row(row_ppm, ppm, rest_m2, first, last, gaussian, offset2_m2):
    # The part of a row within reach: a run without a branch, for vector instructions, nor a test for negative indices.
    for k in range(np.uint64(first), np.uint64(last + 1)):
        row_ppm[k] += ppm * gaussian[k] if offset2_m2[k] <= rest_m2 else 0.0


@numba.njit(cache=True, nogil=True)
def add_filaments_to_grid_inplace(filaments, gas, cutoff_sigma, first_point_m, spacing_m, mixing_ratio_ppm):
    """Add to a regular grid of points the contribution of every filament of one gas, filament by filament.

    The same sum as `add_filaments_at_points_inplace` without walls. A filament's Gaussian is the product of three,
    one per axis, so its cost is that of the points within its cut-off and a product each.

    Args:
        filaments: `FilamentArrays`.
        gas: Which gas to sum.
        first_point_m: (3,) the point with index (0, 0, 0), world frame [m].
        spacing_m: Distance of neighbouring points, equal along all axes [m].
        mixing_ratio_ppm: (nx, ny, nz) mixing ratio [ppm by volume], index order ij; added to. A slice has nz = 1.

    Held by:
        tests/unit/services/fields/test_mixing_ratio.py (equals the sum at points, box of three side
        lengths),
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
        x, y, z = filament_position(position_world_m, f)
        k0, k1 = _first_and_last(z, reach_m, first_point_m[2], spacing_m, nz)
        i0, i1 = _first_and_last(x, reach_m, first_point_m[0], spacing_m, nx)
        j0, j1 = _first_and_last(y, reach_m, first_point_m[1], spacing_m, ny)
        if k0 > k1 or i0 > i1 or j0 > j1:
            continue
        qq = elementary.exp(-spacing_m * spacing_m / (s * s))
        _sample_gaussian(x, s, first_point_m[0], spacing_m, i0, i1, qq, gx, dx2)
        _sample_gaussian(y, s, first_point_m[1], spacing_m, j0, j1, qq, gy, dy2)
        _sample_gaussian(z, s, first_point_m[2], spacing_m, k0, k1, qq, gz, dz2)
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


def build_solid_sums(occupancy: NDArray[np.uint8]) -> NDArray[np.int32]:
    """Return (nx + 1, ny + 1, nz + 1) numbers: entry (i, j, k) counts the solid cells with all indices below it."""
    sums = np.zeros(np.add(occupancy.shape, 1), np.int32)
    is_solid = (occupancy == Cell.SOLID).astype(np.int32)
    sums[1:, 1:, 1:] = is_solid.cumsum(0).cumsum(1).cumsum(2)
    return sums


def build_filament_arrays(filaments: Filaments) -> FilamentArrays:
    """Return filaments as kernels take them; see `strength_ppm_m3`."""
    return FilamentArrays(
        position_world_m=filaments.position_world_m,
        sigma_m=filaments.sigma_m,
        source_index=filaments.source_index,
        strength_ppm_m3=strength_ppm_m3(filaments.amount_mol),
        gas_index=filaments.gas_index,
    )


def strength_ppm_m3(amount_mol: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the volume that (n,) filaments' gas [mol] takes when pure, in millionths: S = 1e6 N / n_air [ppm m3].

    n_air is that of air at 298 K and 1 atm.
    """
    return amount_mol * (1e6 / air_density_mol_m3())


def mixing_ratio_ppm_at(
    points_world_m: NDArray[np.float64],
    filaments: Filaments,
    *,
    walls: Walls | None = None,
    cutoff_sigma: float = CUTOFF_SIGMA,
) -> NDArray[np.float64]:
    """Return the mixing ratio of each gas at points, summed over the filaments.

    Args:
        filaments: Filaments to sum.
        walls: Walls that hide the gas behind them; absent: gas passes walls in the reading.

    Returns:
        (m, n_gases) mixing ratio [ppm by volume].
    """
    return mixing_ratio_and_size_at(points_world_m, filaments, walls=walls, cutoff_sigma=cutoff_sigma)[0]


def mixing_ratio_and_size_at(
    points_world_m: NDArray[np.float64],
    filaments: Filaments,
    *,
    walls: Walls | None,
    cutoff_sigma: float,
    add: Callable[..., NDArray[np.float64]] = add_filaments_at_points_inplace,
    surroundings: tuple[Any, ...] = (),
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return what `mixing_ratio_ppm_at` does, and the (m,) mean size of the filaments at the points [m].

    Args:
        add: Kernel that adds filaments at points.
        surroundings: Its arguments after the walls.
    """
    points = check_points(points_world_m)
    mixing_ratio_ppm = np.zeros((len(points), filaments.n_gases))
    seen, hiding = build_filament_arrays(filaments), walls or NO_WALLS
    return mixing_ratio_ppm, add(points, seen, float(cutoff_sigma), hiding, *surroundings, mixing_ratio_ppm)


def mixing_ratio_ppm_on_grid(
    filaments: Filaments,
    *,
    first_point_m: Vec3,
    spacing_m: float,
    shape: tuple[int, int, int],
    gas: int = 0,
    cutoff_sigma: float = CUTOFF_SIGMA,
) -> NDArray[np.float64]:
    """Return the mixing ratio of one gas on a regular grid of points; gas passes walls.

    Args:
        filaments: Filaments to sum.
        first_point_m: The point with index (0, 0, 0), world frame [m].
        spacing_m: Distance of neighbouring points [m].
        shape: Number of points along x, y, z; a horizontal slice has one along z.
        gas: Index of the gas.

    Returns:
        (nx, ny, nz) mixing ratio [ppm by volume], index order ij.
    """
    mixing_ratio_ppm = np.zeros(shape)
    add_filaments_to_grid_inplace(
        build_filament_arrays(filaments),
        gas,
        float(cutoff_sigma),
        to_float3(first_point_m),
        float(spacing_m),
        mixing_ratio_ppm,
    )
    return mixing_ratio_ppm


def check_points(points_world_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (m, 3) points in the form that kernels take."""
    points = np.ascontiguousarray(points_world_m, np.float64)
    if points.ndim != 2 or points.shape[1] != 3:
        raise ShapeError(f"points_world_m: expected shape (m, 3), was {points.shape}.")
    return points


def to_float3(vector: Vec3) -> Vec3:
    """Return a vector as Python floats, the one type kernels are compiled for."""
    return (float(vector[0]), float(vector[1]), float(vector[2]))


NO_WALLS = Walls.of_occupancy(np.zeros((1, 1, 1), np.uint8), Grid(origin_m=(0, 0, 0), cell_m=1.0, shape=(1, 1, 1)))
