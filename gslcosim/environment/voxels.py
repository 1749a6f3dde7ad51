"""Boxes as cells; apart from occupancy, which needs a compiler."""

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from gslcosim.environment.grid import Grid
from gslcosim.environment.model import Box
from gslcosim.environment.openings import snapped_range


def voxelize(boxes: Iterable[Box], grid: Grid) -> NDArray[np.bool_]:
    """Return which of the (nx, ny, nz) cells are solid.

    A cell is solid when its centre lies in a box (its lower faces included). A box that is thinner than a cell and
    holds no centre along an axis takes the cell that holds its middle there, so that gas and sight never pass
    through a thin plate. Boxes outside the grid take no cell.
    """
    is_solid = np.zeros(grid.shape, dtype=np.bool_)
    for box in boxes:
        (i0, i1), (j0, j1), (k0, k1) = (
            snapped_range(box.min_m[axis], box.max_m[axis], grid, axis, is_outward=False) for axis in range(3)
        )
        is_solid[i0:i1, j0:j1, k0:k1] = True
    return is_solid
