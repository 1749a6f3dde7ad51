"""Grids of cells over a room, and beliefs on them: a probability for each cell, and figures of it."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, Self

import numpy as np
from numpy.typing import NDArray

from gslcosim.contract.messages import Belief, Bounds, KnownMap, Observation
from gslcosim.contract.record import NumericArray
from gslcosim_search import elementary

Array = NDArray[np.float64]


@dataclass(frozen=True)
class CellGrid:
    """Equal cells: squares in the plane (2 numbers each) or cubes (3). The first cell touches `origin_m`.

    Arrays over the cells have the grid's shape, index order (x, y) or (x, y, z); flat arrays are in C order.
    """

    origin_m: tuple[float, ...]
    cell_m: float
    shape: tuple[int, ...]

    @classmethod
    def covering(
        cls, bounds: Bounds, cell_m: float, dimensions: Literal[2, 3] = 2, *, max_cells: int | None = None
    ) -> Self:
        """Return a grid over a box, the last cells of each axis cut by nothing: they may reach beyond the box.

        Args:
            dimensions: 2 for the floor plan, 3 for the volume.
            max_cells: With this, cells grow until there are at most so many.
        """
        low, high = bounds.min_m[:dimensions], bounds.max_m[:dimensions]
        spans_m = [b - a for a, b in zip(low, high, strict=True)]
        shape = _counts(spans_m, cell_m)
        while max_cells is not None and math.prod(shape) > max_cells:
            cell_m *= 1.05
            shape = _counts(spans_m, cell_m)
        return cls(tuple(low), cell_m, shape)

    @classmethod
    def of_map(cls, known_map: KnownMap) -> Self:
        """Return the grid of a granted map."""
        shape = known_map.occupied.shape
        return cls(known_map.origin_m[: len(shape)], known_map.cell_m, shape)

    @property
    def dimensions(self) -> int:
        """2 in the plane, 3 in space."""
        return len(self.shape)

    @property
    def n_cells(self) -> int:
        """Number of cells."""
        return math.prod(self.shape)

    def centres_m(self) -> NDArray[np.float64]:
        """Return the (n_cells, dimensions) centres of the cells, world frame [m], in C order."""
        axes_m = [self.axis_m(axis) for axis in range(self.dimensions)]
        return np.stack(np.meshgrid(*axes_m, indexing="ij"), axis=-1).reshape(-1, self.dimensions)

    def axis_m(self, axis: int) -> NDArray[np.float64]:
        """Return the coordinates of the centres along an axis, world frame [m]."""
        return self.origin_m[axis] + (np.arange(self.shape[axis], dtype=np.float64) + 0.5) * self.cell_m

    def index_at(self, point_m: Sequence[float]) -> tuple[int, ...]:
        """Return the index of the cell that holds a point; it may lie outside. Further coordinates are ignored."""
        pairs = zip(point_m[: self.dimensions], self.origin_m, strict=True)
        return tuple(math.floor((value - low) / self.cell_m) for value, low in pairs)

    def cell_at(self, point_m: Sequence[float]) -> tuple[int, ...] | None:
        """Return the index of the cell that holds a point, None outside the grid."""
        index = self.index_at(point_m)
        return index if self.contains(index) else None

    def nearest_cell(self, point_m: Sequence[float]) -> tuple[int, ...]:
        """Return the index of the cell nearest to a point."""
        return tuple(min(max(i, 0), n - 1) for i, n in zip(self.index_at(point_m), self.shape, strict=True))

    def contains(self, index: Sequence[int]) -> bool:
        """Return True if an index is one of the grid's."""
        return all(0 <= i < n for i, n in zip(index, self.shape, strict=True))

    def centre_m(self, index: Sequence[int]) -> tuple[float, ...]:
        """Return the centre of a cell, world frame [m]."""
        return tuple(low + (i + 0.5) * self.cell_m for low, i in zip(self.origin_m, index, strict=True))


def _counts(spans_m: Sequence[float], cell_m: float) -> tuple[int, ...]:
    return tuple(max(1, math.ceil(span_m / cell_m - 1e-9)) for span_m in spans_m)


def normalised(weights: Array) -> Array:
    """Return weights, none negative, scaled so that their sum is 1; where all are 0, evenly spread."""
    total = float(weights.sum())
    return weights / total if total > 0.0 else np.full(weights.shape, 1.0 / weights.size)


def normalised_from_log(log_p: Array) -> Array:
    """Return exp(log_p) scaled so that the sum is 1, without overflow; minus infinity is probability 0."""
    highest = float(log_p.max())
    return (
        normalised(elementary.exp_each(log_p - highest)) if np.isfinite(highest) else normalised(np.zeros(log_p.shape))
    )


def entropy_bits(p: Array) -> float:
    """Return the entropy H = -sum p log2 p [bit]; 0 log 0 is 0.

    Source:
        Shannon 1948, doi:10.1002/j.1538-7305.1948.tb01338.x.
    Held by:
        extensions/search/tests/unit/test_grids_and_beliefs.py
    """
    positive = p[p > 0.0]
    return max(0.0, float(-(positive * elementary.log2_each(positive)).sum()))


def mean_m(p: Array, grid: CellGrid) -> tuple[float, ...]:
    """Return the mean place, world frame [m]."""
    return tuple(float(value) for value in elementary.product(p.reshape(-1), grid.centres_m()))


def variance_m2(p: Array, grid: CellGrid) -> float:
    """Return the sum of the variances of x and y [m^2]."""
    centres_m, weights = grid.centres_m()[:, :2], p.reshape(-1)
    mean = elementary.product(weights, centres_m)
    return float((weights * np.square(centres_m - mean).sum(axis=1)).sum())


def distances_m(grid: CellGrid, point_m: Sequence[float]) -> Array:
    """Return the distance of each cell's centre from a point [m], in the grid's shape and dimensions."""
    offsets_m = grid.centres_m() - np.asarray(point_m[: grid.dimensions])
    return np.linalg.norm(offsets_m, axis=1).reshape(grid.shape)


def mass_within(p: Array, grid: CellGrid, point_m: Sequence[float], radius_m: float) -> float:
    """Return the probability of the cells whose centres are within a radius of a point."""
    return float(p[distances_m(grid, point_m) <= radius_m].sum())


def expected_distance_m(p: Array, grid: CellGrid, point_m: Sequence[float]) -> float:
    """Return the mean distance of the believed places from a point [m]: the earth mover's distance to it."""
    return float((p * distances_m(grid, point_m)).sum())


def best_ball(p: Array, grid: CellGrid, radius_m: float) -> tuple[tuple[float, ...], float]:
    """Return the centre of the cell around which a ball holds the most probability, and how much that is.

    Ties go to the first cell in C order. The ball holds the cells whose centres are within the radius.
    """
    mass = ball_masses(p, grid, radius_m)
    index = np.unravel_index(int(mass.argmax()), grid.shape)
    return grid.centre_m([int(i) for i in index]), min(1.0, float(mass.max()))


def ball_masses(p: Array, grid: CellGrid, radius_m: float) -> Array:
    """Return the probability of the cells whose centres are within a radius of each cell's centre, in the grid's shape.

    Outside of the grid there is none.
    """
    # The sum of shifted copies, for balls are small.
    reach = int(radius_m / grid.cell_m + 1e-9)
    padded = np.pad(p, reach)
    mass = np.zeros(grid.shape)
    steps = np.stack(np.meshgrid(*[np.arange(-reach, reach + 1)] * grid.dimensions, indexing="ij"), axis=-1)
    for step in steps.reshape(-1, grid.dimensions):
        if float(np.square(step).sum()) * grid.cell_m * grid.cell_m <= radius_m * radius_m * (1.0 + 1e-12):
            window = tuple(slice(reach + int(s), reach + int(s) + n) for s, n in zip(step, grid.shape, strict=True))
            mass += padded[window]
    return mass


def mean_of_best_m(p: Array, grid: CellGrid, share: float = 0.05) -> tuple[float, ...]:
    """Return the mean place of the most probable cells, each with its probability as weight, world frame [m].

    Args:
        share: The part of all cells that counts; at least one cell.
    """
    n_best = max(1, round(share * p.size))
    weights = p.reshape(-1)
    best = np.argsort(-weights, kind="stable")[:n_best]
    kept = np.zeros(p.size)
    kept[best] = weights[best]
    return mean_m(normalised(kept), grid)


class BeliefPublisher:
    """Publishes a belief with commands, at most once in so much simulated time, as the contract wants it."""

    def __init__(self, *, every_s: float = 1.0) -> None:
        """Begin without a belief published; `every_s` is at least 1."""
        self._every_s = every_s
        self._last_s = -float("inf")

    def message(self, observation: Observation, p: Array, grid: CellGrid, *, height_m: float = 0.0) -> Belief | None:
        """Return the belief to send with the answer to an observation, or None where the last one is too recent."""
        if observation.time_s - self._last_s < self._every_s - 1e-9:
            return None
        self._last_s = observation.time_s
        return belief_message(p, grid, height_m=height_m)


def belief_message(p: Array, grid: CellGrid, *, height_m: float = 0.0) -> Belief:
    """Return a belief as a command carries it.

    Args:
        p: The belief, in the grid's shape.
        height_m: The height at which a method in the plane searches [m]; ignored for a grid in space.
    """
    x_m, y_m, z_m = (*grid.origin_m, height_m)[:3]
    single = normalised(p.astype(np.float64)).astype(np.float32)
    return Belief(
        origin_m=(x_m, y_m, z_m), cell_m=grid.cell_m, probability=NumericArray.from_array(single.reshape(grid.shape))
    )
