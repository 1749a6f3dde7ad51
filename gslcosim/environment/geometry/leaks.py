"""Leaks of a geometry: the holes through which its air escapes, their size and what is near."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gslcosim.environment.geometry.air_kernels import clearances, split_at_narrows
from gslcosim.environment.geometry.surfaces import Cells, Surfaces, SurfaceVoxels
from gslcosim.environment.geometry.triangle_kernels import BORDER
from gslcosim.environment.grid import Grid, point_text
from gslcosim.scenario.problems import Problem

MAX_SHOWN = 3
_MOST_STEPS = 200


@dataclass(frozen=True, kw_only=True)
class Leak:
    """A hole: its middle, how long its two longer sides are, and the part of the geometry next to it."""

    middle_m: tuple[float, float, float]
    size_m: tuple[float, float]
    part: str


def has_leak(is_air: Cells) -> bool:
    """Return whether air reaches the border of a grid that is larger than the geometry."""
    return any(bool(np.take(is_air, [0, -1], axis=axis).any()) for axis in range(3))


def find_leaks(voxels: SurfaceVoxels, is_air: Cells, seed: NDArray[np.int64]) -> list[Leak]:
    """Return the holes between a cell and the outside, the largest first.

    Args:
        voxels: The surfaces.
        is_air: (nx, ny, nz) what the air of the cell reaches.
        seed: (3,) the cell.
    """
    width = clearances(voxels.marks, is_air, _MOST_STEPS)
    sides = split_at_narrows(voxels.marks, width, int(np.ravel_multi_index(tuple(seed.tolist()), is_air.shape)))
    mouths = [_leak_of(cells, voxels) for cells in _clusters(_meeting_cells(voxels, sides))]
    return sorted(mouths, key=lambda leak: -leak.size_m[0] * leak.size_m[1])


def describe_leaks(leaks: list[Leak], surfaces: Surfaces) -> Problem:
    """Return the holes as one problem that says where they are and what to do."""
    texts = [
        f"a hole of about {leak.size_m[0]:.3g} x {leak.size_m[1]:.3g} m near {point_text(leak.middle_m)} m beside "
        f"{leak.part}"
        for leak in leaks[:MAX_SHOWN]
    ]
    more = f", and {len(leaks) - MAX_SHOWN} more" if len(leaks) > MAX_SHOWN else ""
    low_m, high_m = surfaces.corners_m.min(axis=(0, 1)), surfaces.corners_m.max(axis=(0, 1))
    return Problem(
        path="environment.geometry",
        expected="surfaces and openings that close the air in",
        found=", ".join(texts) + more,
        remedy="Close the mesh there, declare an opening there, take larger cells than the hole with wind.cell_m, or "
        "cut the air off with bounds_m: the geometry's box is "
        f"{{min_m: {point_text(low_m.tolist())}, max_m: {point_text(high_m.tolist())}}}.",
    )


# Cells of the seed's side next to one of the outside's.
def _meeting_cells(voxels: SurfaceVoxels, sides: NDArray[np.uint8]) -> NDArray[np.int64]:
    meets = np.zeros(sides.shape, dtype=np.bool_)
    for axis in range(3):
        low, high = (
            tuple(s if a == axis else slice(None) for a in range(3)) for s in (slice(None, -1), slice(1, None))
        )
        is_open = (voxels.marks[low] & (BORDER << axis)) == 0
        meets[low] |= is_open & (sides[low] == 1) & (sides[high] == 2)
        meets[high] |= is_open & (sides[high] == 1) & (sides[low] == 2)
    return np.argwhere(meets)


def _clusters(cells: NDArray[np.int64]) -> Iterable[NDArray[np.int64]]:
    left = {tuple(cell) for cell in cells.tolist()}
    around = [(i, j, k) for i in (-1, 0, 1) for j in (-1, 0, 1) for k in (-1, 0, 1)]
    while left:
        cluster = waiting = [left.pop()]
        for i, j, k in waiting:
            near = {(i + a, j + b, k + c) for a, b, c in around} & left
            left -= near
            cluster.extend(sorted(near))
        yield np.array(cluster)


def _leak_of(cells: NDArray[np.int64], voxels: SurfaceVoxels) -> Leak:
    grid: Grid = voxels.grid
    low, high = cells.min(axis=0), cells.max(axis=0) + 1
    middle_m = np.asarray(grid.origin_m) + (low + high) / 2 * grid.cell_m
    _, shorter, longer = sorted(((high - low) * grid.cell_m).tolist())
    corners_m = voxels.surfaces.corners_m
    outside_m = np.maximum(corners_m.min(axis=1) - middle_m, middle_m - corners_m.max(axis=1)).clip(min=0)
    nearest = int(np.argmin(np.linalg.norm(outside_m, axis=1)))
    part = voxels.surfaces.part[nearest]
    x, y, z = middle_m.round(6).tolist()
    return Leak(
        middle_m=(x, y, z),
        size_m=(longer, shorter),
        part=voxels.surfaces.names[part] if part >= 0 else "a declared opening",
    )
