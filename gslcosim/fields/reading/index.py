"""An index of filaments by place, for many readings of one instant."""

import numpy as np
from numpy.typing import NDArray

from gslcosim.fields.filament.plume import Filaments
from gslcosim.fields.reading.concentration import (
    CUTOFF_SIGMA,
    Walls,
    checked_points,
    filament_table,
    float3,
    wall_cells,
)
from gslcosim.fields.reading.index_kernels import (
    Blocks,
    SortedFilaments,
    add_indexed_filaments_at_points_inplace,
    sort_into_blocks_inplace,
)
from gslcosim.quantities import Vec3

BLOCK_M = 0.8
# Larger rooms have larger blocks: a table of more would cost more than it saves.
MOST_BLOCKS = 4_000_000


class FilamentIndex:
    """Sorts filaments into blocks of space; a reading then costs what its neighbourhood holds.

    Building costs about as much as three readings without it, so it pays from four readings of one instant on.
    Filaments outside the box count to its border: the box is a matter of speed, not of the result.
    """

    def __init__(self, *, min_m: Vec3, max_m: Vec3, block_m: float = BLOCK_M) -> None:
        sides_m = np.subtract(max_m, min_m)
        block_m *= max(1.0, float(np.prod(sides_m / block_m + 1.0) / MOST_BLOCKS) ** 0.5)
        n_x, n_y, n_z = (max(1, int(np.ceil(side_m / block_m - 1e-9))) for side_m in sides_m)
        self._blocks = Blocks(
            origin_m=float3(min_m),
            block_m=float(block_m),
            n_blocks=(n_x, n_y, n_z),
            first=np.zeros(n_x * n_y * n_z + 1, np.int32),
            largest_sigma_m=np.zeros(n_x * n_y),
        )
        self._n_gases = 1
        self._rows = _rows_for(1024)

    def build(self, filaments: Filaments, *, air_mol_m3: float | None = None) -> None:
        """Sort the filaments of one instant.

        Args:
            filaments: What readings sum; copied.
            air_mol_m3: Moles of air in a cubic metre; absent: at 298 K and 1 atm.
        """
        if len(filaments.sigma_m) > len(self._rows.key):
            self._rows = _rows_for(2 * len(filaments.sigma_m))
        self._n_gases = filaments.n_gases
        sort_into_blocks_inplace(filament_table(filaments, air_mol_m3), self._blocks, self._rows)

    def mixing_ratio_ppm_at(
        self, points_world_m: NDArray[np.float64], *, walls: Walls | None = None, cutoff_sigma: float = CUTOFF_SIGMA
    ) -> NDArray[np.float64]:
        """Return the (m, n_gases) mixing ratio [ppm by volume] at (m, 3) points; see `mixing_ratio_ppm_at`."""
        points = checked_points(points_world_m)
        mixing_ratio_ppm = np.zeros((len(points), self._n_gases))
        add_indexed_filaments_at_points_inplace(
            points,
            self._blocks,
            self._rows,
            float(self._blocks.largest_sigma_m.max()),
            float(cutoff_sigma),
            wall_cells(walls),
            mixing_ratio_ppm,
        )
        return mixing_ratio_ppm


def _rows_for(capacity: int) -> SortedFilaments:
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
