"""Placement of patches on the grid, and checks of whether they can be there."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gslcosim.base.errors import FlowError
from gslcosim.flow.boundaries.inflow import Inflow, make_inflow
from gslcosim.flow.boundaries.patches import Inlet, MovingWall, Outlet, Patch
from gslcosim.flow.pressure import LOW

AXES = "xyz"

Bool = NDArray[np.bool_]
F64 = NDArray[np.float64]
Slices = tuple[slice | int, ...]


@dataclass(frozen=True, kw_only=True)
class PlacedPatch:
    """A patch on the grid: the side of the box it lies on and the boundary cells it covers.

    `cells` selects, in a padded cell array, the layer of cells inside the box; `rows` is the pair of index ranges
    along the two other axes (unpadded). `inflow` is what an inlet blows.
    """

    patch: Patch
    axis: int
    is_high: bool
    rows: tuple[slice, slice]
    n_cells: int
    inflow: Inflow | None = None

    def layer(self, index: int | slice, *, face_axis: int | None = None) -> Slices:
        """Return a padded-array index: `index` along the patch's axis, the covered range along the others.

        With `face_axis` one of the other axes, the range is that of the faces on it: one more.
        """
        selection: list[slice | int] = []
        others = iter(self.rows)
        for axis in range(3):
            if axis == self.axis:
                selection.append(index)
                continue
            row = next(others)
            extra = 1 if axis == face_axis else 0
            selection.append(slice(row.start + LOW, row.stop + LOW + extra))
        return tuple(selection)


def place_patch(patch: Patch, free: Bool, cell_m: float) -> PlacedPatch:
    """Find a patch's side of the box and its cells, and lay its velocity out on them.

    Raises:
        FlowError: the patch is not on the boundary, covers no cell or no air, or its velocity makes no sense.
    """
    name = str(patch)
    low, high = np.asarray(patch.min_m, float), np.asarray(patch.max_m, float)
    if low.shape != (3,) or high.shape != (3,) or not (np.isfinite(low).all() and np.isfinite(high).all()):
        raise FlowError(f"{name}: expected two corners of three finite coordinates [m].")
    if (high < low).any():
        raise FlowError(f"{name}: expected min_m <= max_m on every axis.")
    box = np.asarray(free.shape) * cell_m
    axis, is_high = _side(name, low, high, box, cell_m)
    a, b = (other for other in range(3) if other != axis)
    rows = (_covered(low[a], high[a], free.shape[a], cell_m), _covered(low[b], high[b], free.shape[b], cell_m))
    covered = np.take(free, free.shape[axis] - 1 if is_high else 0, axis=axis)[rows]
    if covered.size == 0:
        raise FlowError(
            f"{name}: covers no cell; expected it to hold at least one centre of a {cell_m} m boundary cell."
        )
    if isinstance(patch, (Inlet, Outlet)) and not covered.any():
        raise FlowError(f"{name}: lies inside a solid; expected at least one air cell behind it.")
    if isinstance(patch, MovingWall) and patch.velocity_m_s[axis] != 0:
        raise FlowError(f"{name}: moves along {AXES[axis]}, through its own plane; use an Inlet for that.")
    if isinstance(patch, MovingWall) and not np.isfinite(patch.velocity_m_s).all():
        raise FlowError(f"{name}: velocity_m_s: expected finite numbers, was {patch.velocity_m_s}.")
    inflow = None
    if isinstance(patch, Inlet):
        if not 0 <= patch.turbulence_intensity < 1:
            raise FlowError(
                f"{name}: turbulence_intensity: expected a share from 0 to below 1, was {patch.turbulence_intensity}."
            )
        centres_m = _face_centres_m(axis, box[axis] if is_high else 0.0, rows, cell_m)
        inflow = make_inflow(name, patch.velocity_m_s, patch.factor, centres_m)
    return PlacedPatch(
        patch=patch, axis=axis, is_high=is_high, rows=rows, n_cells=int(np.count_nonzero(covered)), inflow=inflow
    )


# (na, nb, 3) centres of a patch's boundary faces, grid's frame [m].
def _face_centres_m(axis: int, at_m: float, rows: tuple[slice, slice], cell_m: float) -> F64:
    a_m, b_m = ((np.arange(row.start, row.stop) + 0.5) * cell_m for row in rows)
    parts = list(np.meshgrid(a_m, b_m, indexing="ij"))
    parts.insert(axis, np.full_like(parts[0], at_m))
    return np.stack(parts, axis=-1)


# The axis a patch is flat on and whether it is at the high end of the box.
def _side(name: str, low: F64, high: F64, box: F64, cell_m: float) -> tuple[int, bool]:
    near = 0.5 * cell_m
    candidates = [
        (axis, is_high)
        for axis in range(3)
        for is_high in (False, True)
        if high[axis] - low[axis] < near and abs(0.5 * (low[axis] + high[axis]) - (box[axis] if is_high else 0)) <= near
    ]
    if not candidates:
        size = " x ".join(f"{length:g}" for length in box)
        raise FlowError(
            f"{name}: expected a flat box on the boundary of the grid (origin to {size} m, equal min and max on one "
            f"axis); it is not on any side."
        )
    return min(candidates, key=lambda side: high[side[0]] - low[side[0]])


# Cells along one axis whose centre lies in [low, high].
def _covered(low_m: float, high_m: float, n: int, cell_m: float) -> slice:
    slack = 1e-6
    first = int(np.ceil(low_m / cell_m - 0.5 - slack))
    last = int(np.floor(high_m / cell_m - 0.5 + slack))
    return slice(max(first, 0), max(min(last, n - 1) + 1, 0))


def check_kinds(placed: Sequence[PlacedPatch], *, needs_openings: bool) -> None:
    """Raise FlowError where air can enter but not leave, or, if openings are needed, where one kind is missing."""
    has_inlet = any(isinstance(p.patch, Inlet) for p in placed)
    has_outlet = any(isinstance(p.patch, Outlet) for p in placed)
    if has_outlet and has_inlet:
        return
    if not needs_openings and not has_inlet:
        return
    missing = [name for name, has in (("Inlet", has_inlet), ("Outlet", has_outlet)) if not has]
    raise FlowError(
        f"patches: expected at least one Inlet and one Outlet, found no {' and no '.join(missing)} "
        f"among {len(placed)} patches. Air that enters must be able to leave."
    )


def check_overlap(placed: Sequence[PlacedPatch], shape: tuple[int, int, int]) -> None:
    """Raise FlowError if two patches cover the same boundary cell."""
    for axis in range(3):
        for is_high in (False, True):
            owner = np.full([n for a, n in enumerate(shape) if a != axis], -1)
            for index, patch in enumerate(placed):
                if (patch.axis, patch.is_high) != (axis, is_high):
                    continue
                taken = owner[patch.rows]
                if (taken >= 0).any():
                    other = placed[int(taken.max())].patch
                    raise FlowError(f"patches: {patch.patch} and {other} cover the same boundary cells.")
                owner[patch.rows] = index
