# pyright: basic
# ruff: noqa: ANN001, ANN201, ANN202 - kernels have no types, and symbols of equations
"""Images of filaments at walls: the part of a Gaussian behind a wall is reflected into the room."""

import math
from typing import NamedTuple, Self

import numba
import numpy as np
from numpy.typing import NDArray

from gslcosim.base import elementary
from gslcosim.base.quantities import Vec3
from gslcosim.environment.grid_kernels import SOLID
from gslcosim.environment.model import Environment
from gslcosim_services.fields.filament.filament_step import FREE_CELL, cell_index
from gslcosim_services.fields.mixing_ratio import add_adjusted_filaments_inplace, to_float3

NO_WALL = 255


def count_cells_to_walls(occupancy: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return the number of cells of air between each cell and the next wall along -x, +x, -y, +y, -z and +z.

    The border of the grid is a wall. NO_WALL where an outlet comes first, or the wall is too far to count.

    Args:
        occupancy: (nx, ny, nz) uint8, 0 free, 1 solid, 2 outlet.

    Returns:
        (nx, ny, nz, 6) uint8.
    """
    counts = np.empty((*occupancy.shape, 6), np.uint8)
    for side in range(6):
        # Away from the wall, from layer to layer.
        layers, found = (
            np.moveaxis(of, side // 2, 0)[:: -1 if side % 2 else 1] for of in (occupancy, counts[..., side])
        )
        n = np.zeros(layers.shape[1:], np.int64)
        for layer, found_here in zip(layers, found, strict=True):
            found_here[...] = np.where(layer == FREE_CELL, n, NO_WALL)
            n = np.where(layer == FREE_CELL, np.minimum(n + 1, NO_WALL), np.where(layer == SOLID, 0, NO_WALL))
    return counts


@numba.njit(cache=True, nogil=True, inline="always")
def _image_factor(point_m, centre_m, s, low_m, high_m):
    # 1 + exp(-(d_image^2 - d^2) / (2 s^2)) for the wall below and the wall above; d^2 differ by 4 times both distances.
    factor = 1.0
    for gap_m, far_m in ((point_m - low_m, centre_m - low_m), (high_m - point_m, high_m - centre_m)):
        # Less than exp(-38) is lost in rounding.
        if gap_m > 0.0 and 2.0 * gap_m * far_m < 38.0 * s * s:
            factor += elementary.exp(-2.0 * gap_m * far_m / (s * s))
    return factor


@numba.njit(cache=True, nogil=True)
def add_imaged_filaments_at_points_inplace(
    points_world_m, filaments, cutoff_sigma, walls, counts, origin_m, cell_m, mixing_ratio_ppm
):
    """Add to each point what every filament contributes, its images at the walls around it included.

    Along each axis exp(-(x - x0)^2 / 2 s^2) becomes the same of x0 and of its mirror images at the walls before and
    behind the filament's centre: a room of one box keeps all gas, up to images of images.

    Args:
        points_world_m: (m, 3) points, world frame, xyz [m].
        filaments: `FilamentArrays`.
        cutoff_sigma: Distance from which a filament counts as zero, in its standard deviations.
        walls: `Walls`.
        counts: (nx, ny, nz, 6) of `count_cells_to_walls`.
        origin_m: (3,) corner of cell (0, 0, 0), world frame [m].
        cell_m: Edge of the cubic cells [m].
        mixing_ratio_ppm: (m, n_gases) mixing ratios [ppm by volume]; added to.

    Source:
        The method of images, as for the ground of a Gaussian plume: Pasquill and Smith 1983, Atmospheric Diffusion.
    Left out:
        Edges of obstacles: each wall counts as a plane as far as the filament reaches, and a point beyond the plane
        receives nothing from it. Images of images.
    Held by:
        tests/unit/services/fields/test_wall_images.py
    """
    return add_adjusted_filaments_inplace(
        points_world_m, filaments, cutoff_sigma, walls, mixing_ratio_ppm, _add_images, (counts, origin_m, cell_m)
    )


# Contribution of a filament with its images, from the air around the cell of its centre.
@numba.njit(cache=True, nogil=True, inline="always")
def _add_images(share, surroundings, x, y, z, fx, fy, fz, s):
    counts, origin_m, cell_m = surroundings
    nx, ny, nz, _ = counts.shape
    i = min(max(cell_index(fx, origin_m[0], cell_m), 0), nx - 1)
    j = min(max(cell_index(fy, origin_m[1], cell_m), 0), ny - 1)
    k = min(max(cell_index(fz, origin_m[2], cell_m), 0), nz - 1)
    n = counts[i, j, k]
    share *= _image_factor(x, fx, s, _low(origin_m[0], cell_m, i, n[0]), _high(origin_m[0], cell_m, i, n[1]))
    share *= _image_factor(y, fy, s, _low(origin_m[1], cell_m, j, n[2]), _high(origin_m[1], cell_m, j, n[3]))
    share *= _image_factor(z, fz, s, _low(origin_m[2], cell_m, k, n[4]), _high(origin_m[2], cell_m, k, n[5]))
    return share


# Position of the wall below and of the wall above along an axis, from the centre's cell i and its n cells of air.
@numba.njit(cache=True, nogil=True)
def _low(origin_m, cell_m, i, n):
    return -math.inf if n == NO_WALL else origin_m + (i - np.int64(n)) * cell_m


@numba.njit(cache=True, nogil=True)
def _high(origin_m, cell_m, i, n):
    return math.inf if n == NO_WALL else origin_m + (i + 1 + np.int64(n)) * cell_m


class WallImages(NamedTuple):
    """Walls of a room that reflect filaments' gas, for grids of cells; see `add_imaged_filaments_at_points_inplace`."""

    counts: NDArray[np.uint8]
    origin_m: Vec3
    cell_m: float

    @classmethod
    def of(cls, environment: Environment) -> Self:
        """Return the walls of a room."""
        counts = count_cells_to_walls(np.ascontiguousarray(environment.occupancy, np.uint8))
        return cls(counts, to_float3(environment.grid.origin_m), float(environment.grid.cell_m))
