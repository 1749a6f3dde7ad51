"""Mixing ratios from filaments: at points, on slices and on whole grids."""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from gslcosim.environment.grid import Grid
from gslcosim.environment.model import Cell, Environment
from gslcosim.errors import ShapeError
from gslcosim.fields.filament.plume import Filaments
from gslcosim.fields.gases import air_density_mol_m3
from gslcosim.fields.reading.concentration_kernels import (
    FilamentTable,
    WallCells,
    add_filaments_at_points_inplace,
    add_filaments_to_grid_inplace,
)
from gslcosim.quantities import Vec3

CUTOFF_SIGMA = 5.0


@dataclass(frozen=True, kw_only=True)
class Walls:
    """What hides gas from a reading: the occupancy grid and its summed table (see `sums_of_solids`)."""

    occupancy: NDArray[np.uint8]
    solid_sums: NDArray[np.int32]
    origin_m: Vec3
    cell_m: float

    @classmethod
    def of(cls, environment: Environment) -> Self:
        """Return the walls of an environment."""
        return cls.of_occupancy(environment.occupancy, environment.grid)

    @classmethod
    def of_occupancy(cls, occupancy: NDArray[np.uint8], grid: Grid) -> Self:
        """Return the walls of (nx, ny, nz) cells; those of another kind than solid do not hide anything."""
        cells = np.ascontiguousarray(occupancy, np.uint8)
        return cls(
            occupancy=cells,
            solid_sums=sums_of_solids(cells),
            origin_m=float3(grid.origin_m),
            cell_m=float(grid.cell_m),
        )


def sums_of_solids(occupancy: NDArray[np.uint8]) -> NDArray[np.int32]:
    """Return (nx + 1, ny + 1, nz + 1) numbers: entry (i, j, k) counts the solid cells with all indices below it."""
    sums = np.zeros(np.add(occupancy.shape, 1), np.int32)
    is_solid = (occupancy == Cell.SOLID).astype(np.int32)
    sums[1:, 1:, 1:] = is_solid.cumsum(0).cumsum(1).cumsum(2)
    return sums


_NO_WALLS = Walls(
    occupancy=np.zeros((1, 1, 1), np.uint8),
    solid_sums=np.zeros((2, 2, 2), np.int32),
    origin_m=(0.0, 0.0, 0.0),
    cell_m=1.0,
)


def wall_cells(walls: Walls | None) -> WallCells:
    """Return walls as kernels take them: arrays of their kind also where there are none."""
    seen_through = _NO_WALLS if walls is None else walls
    return WallCells(
        is_opaque=walls is not None,
        occupancy=seen_through.occupancy,
        solid_sums=seen_through.solid_sums,
        origin_m=seen_through.origin_m,
        cell_m=seen_through.cell_m,
    )


def filament_table(filaments: Filaments, air_mol_m3: float | None = None) -> FilamentTable:
    """Return filaments as kernels take them; see `strength_ppm_m3`."""
    return FilamentTable(
        position_world_m=filaments.position_world_m,
        sigma_m=filaments.sigma_m,
        source_index=filaments.source_index,
        strength_ppm_m3=strength_ppm_m3(filaments.amount_mol, air_mol_m3),
        gas_index=filaments.gas_index,
    )


def strength_ppm_m3(amount_mol: NDArray[np.float64], air_mol_m3: float | None = None) -> NDArray[np.float64]:
    """Return the volume that a filament's gas takes when pure, in millionths: S = 1e6 N / n_air [ppm m3].

    Args:
        amount_mol: (n,) moles of gas.
        air_mol_m3: Moles of air in a cubic metre; absent: at 298 K and 1 atm.
    """
    return amount_mol * (1e6 / (air_density_mol_m3() if air_mol_m3 is None else air_mol_m3))


def mixing_ratio_ppm_at(
    points_world_m: NDArray[np.float64],
    filaments: Filaments,
    *,
    walls: Walls | None = None,
    cutoff_sigma: float = CUTOFF_SIGMA,
    air_mol_m3: float | None = None,
) -> NDArray[np.float64]:
    """Return the mixing ratio of each gas at points, summed over the filaments.

    Args:
        points_world_m: (m, 3) points, world frame, xyz [m].
        filaments: What to sum.
        walls: Hide the gas behind walls; absent: gas passes walls in the reading.
        cutoff_sigma: Distance from which a filament counts as zero, in its standard deviations.
        air_mol_m3: Moles of air in a cubic metre; absent: at 298 K and 1 atm.

    Returns:
        (m, n_gases) mixing ratio [ppm by volume].

    Raises:
        ShapeError: the points are not (m, 3).
    """
    points = checked_points(points_world_m)
    mixing_ratio_ppm = np.zeros((len(points), filaments.n_gases))
    add_filaments_at_points_inplace(
        points,
        filament_table(filaments, air_mol_m3),
        float(cutoff_sigma),
        wall_cells(walls),
        mixing_ratio_ppm,
    )
    return mixing_ratio_ppm


def mixing_ratio_ppm_on_grid(
    filaments: Filaments,
    *,
    first_point_m: Vec3,
    spacing_m: float,
    shape: tuple[int, int, int],
    gas: int = 0,
    cutoff_sigma: float = CUTOFF_SIGMA,
    air_mol_m3: float | None = None,
) -> NDArray[np.float64]:
    """Return the mixing ratio of one gas on a regular grid of points; gas passes walls.

    Args:
        filaments: What to sum.
        first_point_m: The point with index (0, 0, 0), world frame [m].
        spacing_m: Distance of neighbouring points [m].
        shape: Number of points along x, y, z; a horizontal slice has one along z.
        gas: Which gas.
        cutoff_sigma: Distance from which a filament counts as zero, in its standard deviations.
        air_mol_m3: Moles of air in a cubic metre; absent: at 298 K and 1 atm.

    Returns:
        (nx, ny, nz) mixing ratio [ppm by volume], index order ij.
    """
    mixing_ratio_ppm = np.zeros(shape)
    add_filaments_to_grid_inplace(
        filament_table(filaments, air_mol_m3),
        gas,
        float(cutoff_sigma),
        float3(first_point_m),
        float(spacing_m),
        mixing_ratio_ppm,
    )
    return mixing_ratio_ppm


def checked_points(points_world_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (m, 3) points in the form that kernels take.

    Raises:
        ShapeError: the points are not (m, 3).
    """
    points = np.ascontiguousarray(points_world_m, np.float64)
    if points.ndim != 2 or points.shape[1] != 3:
        raise ShapeError(f"points_world_m: expected shape (m, 3), was {points.shape}.")
    return points


def float3(vector: Vec3) -> Vec3:
    """Return a vector as Python floats, the one type kernels are compiled for."""
    return (float(vector[0]), float(vector[1]), float(vector[2]))
