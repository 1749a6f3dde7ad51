"""One stored instant of gas, as other simulators write it, in this project's units."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gslcosim.environment.grid import Grid
from gslcosim.errors import EnvironmentDataError
from gslcosim.fields.filament.plume import Filaments
from gslcosim.fields.gases import GASES, air_density_mol_m3
from gslcosim.quantities import Vec3

# Beyond these a size is a fault of the file; the cube of a far smaller one would round to zero.
LEAST_SIGMA_M = 1e-4
LARGEST_SIGMA_M = 100.0
LARGEST_GRID_CELLS = 10**9
LARGEST_ROOM_M = 1e5
# Pure gas; a filament's centre cannot hold more, but for rounding.
LARGEST_CENTRE_PPM = 1.001e6
# Air from 3,000 m up to a pressure chamber, from frost to a furnace [mol/cm3]; at 298 K and 1 atm it is 4.09e-5.
AIR_MOL_CM3 = (4e-6, 4e-4)


@dataclass(frozen=True, kw_only=True)
class GasFrame:
    """What a frame file holds.

    Either `filaments` or `mixing_ratio_ppm` (nx, ny, nz) at the cell centres of `grid` is there. Amounts are converted
    to this project's reference air (298 K, 1 atm), so that readings are those of the writer's own air. `gas` and
    `source_position_m` are absent where the format does not tell. `version` is the format's. A grid of one layer
    `is_plane` when it holds at all heights.
    """

    version: str
    grid: Grid
    gas: str | None
    source_position_m: Vec3 | None
    wind_index: int
    filaments: Filaments | None
    mixing_ratio_ppm: NDArray[np.float32] | None = None
    is_plane: bool = False


def grid_of_frame(path: Path, *, min_m: Vec3, max_m: Vec3, cell_m: float, shape: tuple[int, int, int]) -> Grid:
    """Return the grid that a frame's head describes.

    Raises:
        EnvironmentDataError: sizes are not finite or not positive, or the corners do not fit the cells.
    """
    # NaN is not below either.
    is_sound = bool((abs(np.array([*min_m, *max_m, cell_m])) < LARGEST_ROOM_M).all()) and cell_m > 0 and min(shape) > 0
    if not is_sound or int(np.prod(np.array(shape, object))) > LARGEST_GRID_CELLS:
        raise EnvironmentDataError(
            f"gas frame: expected a grid of positive size within {LARGEST_ROOM_M:g} m, "
            f"was {shape} cells of {cell_m} m from {min_m} to {max_m}. File: {path}"
        )
    sides_m = np.subtract(max_m, min_m)
    if not (abs(sides_m - np.multiply(shape, cell_m)) <= cell_m).all():
        raise EnvironmentDataError(
            f"gas frame: expected {shape} cells of {cell_m:g} m between its corners, was {sides_m} m. File: {path}"
        )
    return Grid(origin_m=min_m, cell_m=cell_m, shape=shape)


def edge_of_cube(path: Path, cell_m: Vec3) -> float:
    """Return the edge of cells [m] that a format describes by three.

    Raises:
        EnvironmentDataError: they are no cubes.
    """
    if not np.allclose(cell_m, cell_m[0], rtol=1e-6, atol=0.0):
        raise EnvironmentDataError(f"gas frame: expected cubic cells, was {cell_m} m. File: {path}")
    return cell_m[0]


def place_of_source(path: Path, grid: Grid, position_m: Vec3) -> Vec3:
    """Return where a frame's head says that the source is, world frame [m].

    Raises:
        EnvironmentDataError: it is outside the grid.
    """
    low, high = np.subtract(grid.origin_m, grid.cell_m), np.add(grid.max_m, grid.cell_m)
    if not ((low <= position_m) & (position_m <= high)).all():
        raise EnvironmentDataError(
            f"gas frame: expected a source between {grid.origin_m} and {grid.max_m} m, was {position_m}. File: {path}"
        )
    return position_m


def filaments_of_frame(
    path: Path,
    grid: Grid,
    *,
    position_m: NDArray[np.float64],
    sigma_cm: NDArray[np.float64],
    amount_mol: float,
    air_mol_cm3: float,
) -> Filaments:
    """Return checked filaments in this project's units.

    Args:
        path: The file, for errors.
        grid: Where filaments may be.
        position_m: (n, 3) centres [m].
        sigma_cm: (n,) standard deviations [cm].
        amount_mol: Gas in each filament [mol].
        air_mol_cm3: Moles of air in a cubic centimetre, as the writer had it.

    Raises:
        EnvironmentDataError: a value is not finite or out of its range.
    """
    if not (0.0 < amount_mol < 1e3 and AIR_MOL_CM3[0] < air_mol_cm3 < AIR_MOL_CM3[1]):
        raise EnvironmentDataError(
            f"gas frame: expected moles in a filament and in a cm3 of air, was {amount_mol} and {air_mol_cm3}. "
            f"File: {path}"
        )
    low, high = np.subtract(grid.origin_m, grid.cell_m), np.add(grid.max_m, grid.cell_m)
    is_inside = ((position_m >= low) & (position_m <= high)).all(axis=1)
    sigma_m = 0.01 * sigma_cm
    is_sound = is_inside & (sigma_m > LEAST_SIGMA_M) & (sigma_m < LARGEST_SIGMA_M)
    if not is_sound.all():
        i = int(np.argmin(is_sound))
        raise EnvironmentDataError(
            f"gas frame: expected filaments inside the grid with a size, filament {i} is at {position_m[i]} m "
            f"with sigma {sigma_cm[i]} cm. File: {path}"
        )
    _check_strength(path, sigma_cm, amount_mol, air_mol_cm3)
    return Filaments(
        position_world_m=np.ascontiguousarray(position_m, np.float64),
        sigma_m=np.ascontiguousarray(sigma_m, np.float64),
        source_index=np.zeros(len(sigma_m), np.int32),
        amount_mol=np.array([amount_mol * air_density_mol_m3() / (air_mol_cm3 * 1e6)]),
        gas_index=np.zeros(1, np.int32),
    )


def _check_strength(path: Path, sigma_cm: NDArray[np.float64], amount_mol: float, air_mol_cm3: float) -> None:
    least_cm = float(sigma_cm.min(initial=np.inf))
    centre_ppm = 1e6 * amount_mol / (air_mol_cm3 * (2.0 * np.pi) ** 1.5 * least_cm**3)
    if centre_ppm > LARGEST_CENTRE_PPM:
        raise EnvironmentDataError(
            f"gas frame: expected filaments of at most pure gas, 1e6 ppm, was {centre_ppm:.3g} ppm in one of "
            f"{amount_mol} mol and sigma {least_cm} cm. File: {path}"
        )


def gas_of_code(path: Path, code: int) -> str:
    """Return the name of a gas by GADEN's number.

    Raises:
        EnvironmentDataError: there is no such gas.
    """
    names = {gas.gaden_code: name for name, gas in GASES.items() if gas.gaden_code is not None}
    if code not in names:
        raise EnvironmentDataError(f"gas frame: expected a gas code from 0 to {max(names)}, was {code}. File: {path}")
    return names[code]
