"""Grid of equal cubic cells: which cell holds a point, and where a cell's centre is."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gslcosim.base.quantities import Vec3


@dataclass(frozen=True, kw_only=True)
class Grid:
    """A box of equal cubic cells; index order is (x, y, z), cell (0, 0, 0) touches `origin_m`."""

    origin_m: Vec3
    cell_m: float
    shape: tuple[int, int, int]

    @property
    def max_m(self) -> Vec3:
        """The corner opposite to `origin_m`, world frame [m]."""
        o, n = self.origin_m, self.shape
        return (o[0] + n[0] * self.cell_m, o[1] + n[1] * self.cell_m, o[2] + n[2] * self.cell_m)

    def cell_of(self, position_world_m: NDArray[np.float64]) -> NDArray[np.int64]:
        """Return the (…, 3) indices of the cells that hold (…, 3) points; they may lie outside the grid."""
        return np.floor((np.asarray(position_world_m) - self.origin_m) / self.cell_m).astype(np.int64)

    def contains_cell(self, cell: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Return which of (…, 3) cell indices lie in the grid."""
        return np.all((cell >= 0) & (cell < self.shape), axis=-1)

    def centres_m(self) -> NDArray[np.float64]:
        """Return the (nx, ny, nz, 3) cell centres, world frame [m]."""
        return np.stack(np.meshgrid(*(self.axis_centres_m(axis) for axis in range(3)), indexing="ij"), axis=-1)

    def axis_centres_m(self, axis: int) -> NDArray[np.float64]:
        """Return the (n,) coordinates of the cell centres on one axis (0, 1, 2 is x, y, z), world frame [m]."""
        return self.origin_m[axis] + (np.arange(self.shape[axis], dtype=np.float64) + 0.5) * self.cell_m


def point_text(point_m: Sequence[float]) -> str:
    """Return a point as a scenario file would have it, such as `[5, 1, 2]`."""
    return "[" + ", ".join(f"{coordinate_m:.6g}" for coordinate_m in point_m) + "]"
