"""Boxes that fill the solid cells of a grid, for rooms that come as cells."""

import numpy as np
from numpy.typing import NDArray

from gslcosim.environment.model import OBSTACLE_RGBA, Box, Grid


def boxes_from_solid(is_solid: NDArray[np.bool_], grid: Grid) -> tuple[Box, ...]:
    """Return boxes named `solid_0`, `solid_1`, … that together fill exactly the solid cells, without overlap.

    Each box starts at the first remaining cell, in index order, and grows as far as possible along x, then y, then z.
    That is not the least number of boxes, but a few per straight wall or shelf.
    """
    left = is_solid.copy()
    boxes: list[Box] = []
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


def _grown(left: NDArray[np.bool_], i: int, j: int, k: int) -> tuple[slice, slice, slice]:
    i1 = i + _run(left[i:, j, k])
    j1 = j + _run(np.asarray(left[i:i1, j:, k].all(axis=0)))
    k1 = k + _run(np.asarray(left[i:i1, j:j1, k:].all(axis=(0, 1))))
    return slice(i, i1), slice(j, j1), slice(k, k1)


def _run(values: NDArray[np.bool_]) -> int:
    return len(values) if values.all() else int(np.argmin(values))
