"""Boxes and cells: boxes as cells, cells as boxes, and the solid boxes that physics and rays meet."""

from collections import Counter
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from gslcosim.base.errors import EnvironmentDataError
from gslcosim.environment.grid import Grid
from gslcosim.environment.model import Box, Environment
from gslcosim.environment.openings import snap_range
from gslcosim.environment.plan import OBSTACLE_RGBA


def voxelize(boxes: Iterable[Box], grid: Grid) -> NDArray[np.bool_]:
    """Return which of the (nx, ny, nz) cells are solid.

    A cell is solid when its centre lies in a box (its lower faces included). A box that is thinner than a cell and
    holds no centre along an axis takes the cell that holds its middle there, so that gas and sight never pass
    through a thin plate. Boxes outside the grid take no cell.
    """
    is_solid = np.zeros(grid.shape, dtype=np.bool_)
    for box in boxes:
        (i0, i1), (j0, j1), (k0, k1) = (
            snap_range(box.min_m[axis], box.max_m[axis], grid, axis, is_outward=False) for axis in range(3)
        )
        is_solid[i0:i1, j0:j1, k0:k1] = True
    return is_solid


Cells = tuple[slice, slice, slice]


def boxes_from_solid(is_solid: NDArray[np.bool_], grid: Grid) -> tuple[Box, ...]:
    """Return boxes named `solid_0`, `solid_1`, … that together hold exactly the solid cells, without overlap.

    Each box starts at the first cell not yet held, in index order, and grows as far as it can along x, then y, then z.
    That is not the least number of boxes, but a few per straight wall or shelf.
    """
    left = is_solid.copy()
    boxes: list[Box] = []
    # Cells are taken off `left` as boxes grow; those already taken are passed over.
    for i, j, k in np.argwhere(is_solid).tolist():
        if not left[i, j, k]:
            continue
        cells = _grown(left, i, j, k)
        left[cells] = False
        low = (grid.origin_m[axis] + cells[axis].start * grid.cell_m for axis in range(3))
        high = (grid.origin_m[axis] + cells[axis].stop * grid.cell_m for axis in range(3))
        x0, y0, z0, x1, y1, z1 = (round(corner_m, 9) for corner_m in (*low, *high))
        boxes.append(
            Box(
                name=f"solid_{len(boxes)}",
                kind="obstacle",
                min_m=(x0, y0, z0),
                max_m=(x1, y1, z1),
                rgba=OBSTACLE_RGBA,
            )
        )
    return tuple(boxes)


def _grown(left: NDArray[np.bool_], i: int, j: int, k: int) -> Cells:
    i1 = i + _run(left[i:, j, k])
    j1 = j + _run(np.asarray(left[i:i1, j:, k].all(axis=0)))
    k1 = k + _run(np.asarray(left[i:i1, j:j1, k:].all(axis=(0, 1))))
    return slice(i, i1), slice(j, j1), slice(k, k1)


# How many values are true before the first that is not.
def _run(values: NDArray[np.bool_]) -> int:
    return len(values) if values.all() else int(np.argmin(values))


def solid_boxes(environment: Environment) -> list[Box]:
    """Return the boxes of a room; one without a floor of its own (an imported one, say) gets one to stand on.

    Raises:
        EnvironmentDataError: two boxes have one name.
    """
    boxes = list(environment.boxes)
    doubles = sorted(name for name, n in Counter(box.name for box in boxes).items() if n > 1)
    if doubles:
        raise EnvironmentDataError(f"environment {environment.name}: expected boxes of different names, was {doubles}.")
    if not any(box.kind == "floor" for box in boxes):
        (x0, y0, z0), (x1, y1, _) = environment.grid.origin_m, environment.grid.max_m
        boxes.append(Box(name="floor", kind="floor", min_m=(x0, y0, z0 - 0.2), max_m=(x1, y1, z0)))
    return boxes
