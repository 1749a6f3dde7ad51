# pyright: basic
"""Spatial index of filaments by blocks, for many readings of one instant."""

# ruff: noqa: ANN001, ANN201, ANN202 - kernels have no types, and symbols of equations

import math
from typing import Any, NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from gslcosim.base import elementary
from gslcosim.base.quantities import Vec3
from gslcosim_services.fields.filament.plume import Filaments
from gslcosim_services.fields.mixing_ratio import (
    CUTOFF_SIGMA,
    NO_WALLS,
    NORMALISATION,
    Walls,
    build_filament_arrays,
    check_points,
    filament_position,
    is_box_of_air,
    is_visible,
    to_float3,
)

EXP_MINUS_MIDDLE = elementary.exp(-6.25)

BLOCK_M = 0.8
# Larger rooms have larger blocks: a table of more would cost more than it saves.
MAX_BLOCKS = 4_000_000


class Blocks(NamedTuple):
    """Cubic blocks of space, and the index of each block's first filament.

    Block (i, j, k) has the number (i n_y + j) n_z + k, so the blocks of a vertical column follow one another.
    `origin_m` (3,) corner of block (0, 0, 0), world frame [m], points outside count to the border's blocks; `block_m`
    edge [m]; `n_blocks` (3,) number along x, y, z; `first` (n_x n_y n_z + 1,) int32 index of each block's first
    filament; `largest_sigma_m` (n_x n_y,) largest standard deviation in each column [m].
    """

    origin_m: Any
    block_m: float
    n_blocks: Any
    first: Any
    largest_sigma_m: Any


class SortedFilaments(NamedTuple):
    """Filaments by block, (>= n,) each.

    `x`, `y`, `z` centres, world frame [m]; `exponent_per_m2` 1 / (2 s^2) [1/m2]; `centre_ppm` mixing ratio at the
    centre [ppm]; `gas` int32; `key` int32 and `shares` are work space.
    """

    x: Any
    y: Any
    z: Any
    exponent_per_m2: Any
    centre_ppm: Any
    gas: Any
    key: Any
    shares: Any


@numba.njit(cache=True, nogil=True)
def _block(coordinate_m, origin_m, block_m, n):
    return min(max(int((coordinate_m - origin_m) / block_m), 0), n - 1)


@numba.njit(cache=True, nogil=True)
def sort_into_blocks_inplace(filaments, blocks, rows):
    """Sort filaments by block (counting sort, stable) and compute each one's terms for a reading.

    Args:
        filaments: `FilamentTable`.
        blocks: `Blocks`; `first` and `largest_sigma_m` are filled in.
        rows: `SortedFilaments`, filled in.

    Held by:
        tests/unit/services/fields/test_spatial_index.py
    """
    position_world_m, sigma_m, source_index = filaments.position_world_m, filaments.sigma_m, filaments.source_index
    origin_m, block_m, first, largest_sigma_m = blocks.origin_m, blocks.block_m, blocks.first, blocks.largest_sigma_m
    n_x, n_y, n_z = blocks.n_blocks
    key, x, y, z, gas = rows.key, rows.x, rows.y, rows.z, rows.gas
    exponent_per_m2, centre_ppm = rows.exponent_per_m2, rows.centre_ppm
    first[:] = 0
    largest_sigma_m[:] = 0.0
    n = sigma_m.shape[0]
    for f in range(n):
        at_x, at_y, at_z = filament_position(position_world_m, f)
        i = _block(at_x, origin_m[0], block_m, n_x)
        j = _block(at_y, origin_m[1], block_m, n_y)
        k = _block(at_z, origin_m[2], block_m, n_z)
        column = i * n_y + j
        largest_sigma_m[column] = max(largest_sigma_m[column], sigma_m[f])
        key[f] = column * n_z + k
        first[key[f] + 1] += 1
    for b in range(1, first.shape[0]):
        first[b] += first[b - 1]
    # Counting forward moves each block's begin to its end; shifting by one afterwards restores it.
    for f in range(n):
        at = first[key[f]]
        first[key[f]] = at + 1
        s = np.float64(sigma_m[f])
        source = source_index[f]
        x[at], y[at], z[at] = filament_position(position_world_m, f)
        exponent_per_m2[at] = 0.5 / (s * s)
        centre_ppm[at] = filaments.strength_ppm_m3[source] / (NORMALISATION * s * s * s)
        gas[at] = filaments.gas_index[source]
    for b in range(first.shape[0] - 1, 0, -1):
        first[b] = first[b - 1]
    first[0] = 0


@numba.njit(cache=True, nogil=True)
def _gap2_m2(coordinate_m, origin_m, block_m, i):
    # Square of the distance from a coordinate to block i's extent.
    low = origin_m + i * block_m
    gap = max(low - coordinate_m, coordinate_m - (low + block_m), 0.0)
    return gap * gap


@numba.njit(cache=True, nogil=True)
def exp_minus(e):
    """Return exp(-e) for 0 <= e <= 12.5, to 1e-14 of it, in operations that all have vector instructions.

    exp(-e) = exp(-6.25) (sum over i < 12 of r^i / i!)^32      r = (6.25 - e) / 32, |r| <= 0.2

    Source:
        Taylor series; its remainder 0.2^12 / 12! is below the rounding of float64.
    Held by:
        tests/unit/services/fields/test_spatial_index.py
    """
    r = (6.25 - e) * 0.03125
    p = 1.0 / 39916800.0
    p = p * r + 1.0 / 3628800.0
    p = p * r + 1.0 / 362880.0
    p = p * r + 1.0 / 40320.0
    p = p * r + 1.0 / 5040.0
    p = p * r + 1.0 / 720.0
    p = p * r + 1.0 / 120.0
    p = p * r + 1.0 / 24.0
    p = p * r + 1.0 / 6.0
    p = p * r + 0.5
    p = p * r + 1.0
    p = p * r + 1.0
    p = p * p
    p = p * p
    p = p * p
    p = p * p
    return p * p * EXP_MINUS_MIDDLE


@numba.njit(cache=True, nogil=True)
def _add_visible(px, py, pz, rows, begin, end, largest_exponent, row_ppm):
    # Filaments that are all in sight: no branch depends on one of them and indices count from zero, which is what
    # lets the compiler treat four at once (1 ns each instead of 5 ns).
    run = slice(begin, end)
    x, y, z, gas, shares = rows.x[run], rows.y[run], rows.z[run], rows.gas[run], rows.shares
    exponent_per_m2, centre_ppm = rows.exponent_per_m2[run], rows.centre_ppm[run]
    n = x.shape[0]
    for f in range(n):
        dx, dy, dz = x[f] - px, y[f] - py, z[f] - pz
        exponent = (dx * dx + dy * dy + dz * dz) * exponent_per_m2[f]
        shares[f] = centre_ppm[f] * exp_minus(exponent) if exponent <= largest_exponent else 0.0
    if row_ppm.shape[0] > 1:
        for f in range(n):
            row_ppm[gas[f]] += shares[f]
        return
    a, b, c, d = 0.0, 0.0, 0.0, 0.0
    whole = n - n % 4
    for f in range(0, whole, 4):
        a += shares[f]
        b += shares[f + 1]
        c += shares[f + 2]
        d += shares[f + 3]
    for f in range(whole, n):
        a += shares[f]
    row_ppm[0] += (a + b) + (c + d)


@numba.njit(cache=True, nogil=True)
def _add_one_by_one(px, py, pz, rows, begin, end, largest_exponent, is_hidden, walls, row_ppm):
    # A run of filaments of which some may be hidden.
    for f in range(begin, end):
        x, y, z = rows.x[f], rows.y[f], rows.z[f]
        dx, dy, dz = x - px, y - py, z - pz
        exponent = (dx * dx + dy * dy + dz * dz) * rows.exponent_per_m2[f]
        if exponent > largest_exponent:
            continue
        if is_hidden and not is_visible(walls, px, py, pz, x, y, z):
            continue
        row_ppm[rows.gas[f]] += rows.centre_ppm[f] * elementary.exp(-exponent)


@numba.njit(cache=True, nogil=True)
def _extent(i0, i1, n, origin_m, block_m, coordinate_m, reach_m):
    # From least to greatest coordinate that blocks i0 to i1 and the point may cover together, within the point's
    # reach; the outermost blocks also hold what lies beyond them.
    low = coordinate_m - reach_m if i0 == 0 else min(origin_m + i0 * block_m, coordinate_m)
    high = coordinate_m + reach_m if i1 == n - 1 else max(origin_m + (i1 + 1) * block_m, coordinate_m)
    return low, high


@numba.njit(cache=True, nogil=True)
def add_indexed_filaments_at_points_inplace(
    points_world_m, blocks, rows, largest_of_all_m, cutoff_sigma, walls, mixing_ratio_ppm
):
    """Add to each point what the filaments around it contribute; the same sum as without the index.

    Only columns of blocks within the cut-off of their own largest filament are searched. The order of the sum differs
    from `add_filaments_at_points_inplace`, so results agree to rounding only.

    Args:
        points_world_m: (m, 3) points, world frame, xyz [m].
        blocks: `Blocks` of `sort_into_blocks_inplace`.
        rows: `SortedFilaments` of it.
        largest_of_all_m: Largest standard deviation of all [m].
        cutoff_sigma: Distance from which a filament counts as zero, in its standard deviations.
        walls: `Walls`.
        mixing_ratio_ppm: (m, n_gases) mixing ratios [ppm by volume]; added to.

    Held by:
        tests/unit/services/fields/test_spatial_index.py (equals the plain sum, box of three side lengths)
    """
    origin_m, block_m, first, largest_sigma_m = blocks.origin_m, blocks.block_m, blocks.first, blocks.largest_sigma_m
    n_x, n_y, n_z = blocks.n_blocks
    largest_exponent = 0.5 * cutoff_sigma * cutoff_sigma
    reach_m = cutoff_sigma * largest_of_all_m
    can_use_vectors = largest_exponent <= 12.5
    for p in range(points_world_m.shape[0]):
        px, py, pz = points_world_m[p, 0], points_world_m[p, 1], points_world_m[p, 2]
        row_ppm = mixing_ratio_ppm[p]
        is_all_seen = not walls.is_opaque or is_box_of_air(
            walls, px - reach_m, px + reach_m, py - reach_m, py + reach_m, pz - reach_m, pz + reach_m
        )
        i0, i1 = _block(px - reach_m, origin_m[0], block_m, n_x), _block(px + reach_m, origin_m[0], block_m, n_x)
        j0, j1 = _block(py - reach_m, origin_m[1], block_m, n_y), _block(py + reach_m, origin_m[1], block_m, n_y)
        for i in range(i0, i1 + 1):
            gap_x2 = _gap2_m2(px, origin_m[0], block_m, i)
            for j in range(j0, j1 + 1):
                column = i * n_y + j
                column_reach_m = cutoff_sigma * largest_sigma_m[column]
                # Points outside the index's box are in its border's blocks: the distance of those is no bound.
                is_border = i == 0 or i == n_x - 1 or j == 0 or j == n_y - 1
                gap2_m2 = 0.0 if is_border else gap_x2 + _gap2_m2(py, origin_m[1], block_m, j)
                rest_m2 = column_reach_m * column_reach_m - gap2_m2
                if rest_m2 < 0.0 or column_reach_m == 0.0:
                    continue
                half_m = math.sqrt(rest_m2)
                k0 = _block(pz - half_m, origin_m[2], block_m, n_z)
                k1 = _block(pz + half_m, origin_m[2], block_m, n_z)
                begin, end = first[column * n_z + k0], first[column * n_z + k1 + 1]
                if begin == end:
                    continue
                is_column_seen = is_all_seen
                if not is_all_seen:
                    xl, xh = _extent(i, i, n_x, origin_m[0], block_m, px, reach_m)
                    yl, yh = _extent(j, j, n_y, origin_m[1], block_m, py, reach_m)
                    zl, zh = _extent(k0, k1, n_z, origin_m[2], block_m, pz, reach_m)
                    is_column_seen = is_box_of_air(walls, xl, xh, yl, yh, zl, zh)
                if is_column_seen and can_use_vectors:
                    _add_visible(px, py, pz, rows, begin, end, largest_exponent, row_ppm)
                else:
                    is_hidden = walls.is_opaque and not is_column_seen
                    _add_one_by_one(px, py, pz, rows, begin, end, largest_exponent, is_hidden, walls, row_ppm)


class FilamentIndex:
    """Sorts filaments into blocks of space; the cost of a reading is then that of its neighbourhood.

    Building costs about as much as three readings without it, so it pays from four readings of one instant on.
    Filaments outside the box count to its border: the box is a matter of speed, not of the result.
    """

    def __init__(self, *, min_m: Vec3, max_m: Vec3, block_m: float = BLOCK_M) -> None:
        sides_m = np.subtract(max_m, min_m)
        block_m *= max(1.0, math.sqrt(float(np.prod(sides_m / block_m + 1.0)) / MAX_BLOCKS))
        n_x, n_y, n_z = (max(1, int(np.ceil(side_m / block_m - 1e-9))) for side_m in sides_m)
        self._blocks = Blocks(
            origin_m=to_float3(min_m),
            block_m=float(block_m),
            n_blocks=(n_x, n_y, n_z),
            first=np.zeros(n_x * n_y * n_z + 1, np.int32),
            largest_sigma_m=np.zeros(n_x * n_y),
        )
        self._n_gases = 1
        self._rows = _allocate_rows(1024)

    def build(self, filaments: Filaments) -> None:
        """Sort a copy of the filaments of one instant, which readings then sum."""
        if len(filaments.sigma_m) > len(self._rows.key):
            self._rows = _allocate_rows(2 * len(filaments.sigma_m))
        self._n_gases = filaments.n_gases
        sort_into_blocks_inplace(build_filament_arrays(filaments), self._blocks, self._rows)

    @property
    def tables(self) -> tuple[Blocks, SortedFilaments]:
        """The blocks, and the filaments by block; overwritten when the next instant is sorted."""
        return self._blocks, self._rows

    def mixing_ratio_ppm_at(
        self, points_world_m: NDArray[np.float64], *, walls: Walls | None = None, cutoff_sigma: float = CUTOFF_SIGMA
    ) -> NDArray[np.float64]:
        """Return the (m, n_gases) mixing ratio [ppm by volume] at (m, 3) points; see `mixing_ratio_ppm_at`."""
        points = check_points(points_world_m)
        mixing_ratio_ppm = np.zeros((len(points), self._n_gases))
        add_indexed_filaments_at_points_inplace(
            points,
            self._blocks,
            self._rows,
            float(self._blocks.largest_sigma_m.max()),
            float(cutoff_sigma),
            walls or NO_WALLS,
            mixing_ratio_ppm,
        )
        return mixing_ratio_ppm


def _allocate_rows(capacity: int) -> SortedFilaments:
    return SortedFilaments(
        x=np.zeros(capacity),
        y=np.zeros(capacity),
        z=np.zeros(capacity),
        exponent_per_m2=np.zeros(capacity),
        centre_ppm=np.zeros(capacity),
        gas=np.zeros(capacity, np.int32),
        key=np.zeros(capacity, np.int32),
        shares=np.zeros(capacity),
    )
