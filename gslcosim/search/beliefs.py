"""Figures of a belief: a probability for each cell of a grid."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from gslcosim.contract.messages import Belief, Observation
from gslcosim.contract.record import NumericArray
from gslcosim.search.grids import CellGrid

Array = NDArray[np.float64]


def normalised(weights: Array) -> Array:
    """Return weights, none negative, scaled so that their sum is 1; where all are 0, evenly spread."""
    total = float(weights.sum())
    return weights / total if total > 0.0 else np.full(weights.shape, 1.0 / weights.size)


def normalised_from_log(log_p: Array) -> Array:
    """Return exp(log_p) scaled so that the sum is 1, without overflow; minus infinity is probability 0."""
    highest = float(log_p.max())
    return normalised(np.exp(log_p - highest)) if np.isfinite(highest) else normalised(np.zeros(log_p.shape))


def entropy_bits(p: Array) -> float:
    """Return the entropy H = -sum p log2 p [bit]; 0 log 0 is 0.

    Source:
        Shannon 1948, doi:10.1002/j.1538-7305.1948.tb01338.x.
    Held by:
        tests/unit/search/test_grids_and_beliefs.py
    """
    positive = p[p > 0.0]
    return max(0.0, float(-(positive * np.log2(positive)).sum()))


def mean_m(p: Array, grid: CellGrid) -> tuple[float, ...]:
    """Return the mean place, world frame [m]."""
    return tuple(float(value) for value in p.reshape(-1) @ grid.centres_m())


def variance_m2(p: Array, grid: CellGrid) -> float:
    """Return the sum of the variances of x and y [m^2]."""
    centres_m, weights = grid.centres_m()[:, :2], p.reshape(-1)
    mean = weights @ centres_m
    return float(weights @ ((centres_m - mean) ** 2).sum(axis=1))


def distances_m(grid: CellGrid, point_m: Sequence[float]) -> Array:
    """Return the distance of each cell's centre from a point [m], in the grid's shape and dimensions."""
    offsets_m = grid.centres_m() - np.asarray(point_m[: grid.dimensions])
    return np.sqrt((offsets_m**2).sum(axis=1)).reshape(grid.shape)


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
    mass = _ball_masses(p, grid, radius_m)
    index = np.unravel_index(int(mass.argmax()), grid.shape)
    return grid.centre_m([int(i) for i in index]), min(1.0, float(mass.max()))


# The sum of shifted copies, for balls are small; ends of the room count as empty.
def _ball_masses(p: Array, grid: CellGrid, radius_m: float) -> Array:
    reach = int(radius_m / grid.cell_m + 1e-9)
    padded = np.pad(p, reach)
    mass = np.zeros(grid.shape)
    steps = np.stack(np.meshgrid(*[np.arange(-reach, reach + 1)] * grid.dimensions, indexing="ij"), axis=-1)
    for step in steps.reshape(-1, grid.dimensions):
        if float((step**2).sum()) * grid.cell_m**2 <= radius_m**2 * (1.0 + 1e-12):
            window = tuple(slice(reach + int(s), reach + int(s) + n) for s, n in zip(step, grid.shape, strict=True))
            mass += padded[window]
    return mass


def mean_of_best_m(p: Array, grid: CellGrid, share: float = 0.05) -> tuple[float, ...]:
    """Return the mean place of the most probable cells, each with its probability as weight, world frame [m].

    Args:
        p: The belief.
        grid: Its grid.
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
        grid: Its grid.
        height_m: The height at which a method in the plane searches [m]; ignored for a grid in space.
    """
    x_m, y_m, z_m = (*grid.origin_m, height_m)[:3]
    single = normalised(p.astype(np.float64)).astype(np.float32)
    return Belief(
        origin_m=(x_m, y_m, z_m), cell_m=grid.cell_m, probability=NumericArray.from_array(single.reshape(grid.shape))
    )
