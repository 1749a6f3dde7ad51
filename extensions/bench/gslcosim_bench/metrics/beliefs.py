"""Belief metrics beyond those the referee computes at every tick.

A belief is a probability for each cell of a grid, (nx, ny) in the plane or (nx, ny, nz) in space, sum 1, index order
ij; cell 0 touches the origin. In the plane heights do not count. Functions that take a belief's array normalise it.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gslcosim.base.errors import ShapeError
from gslcosim.base.quantities import Vec3
from gslcosim.contract.messages import Belief
from gslcosim_bench.metrics.series import Array
from gslcosim_services.referee.metrics import compute_belief_score

# Cells of the common grid [m], on which beliefs of methods with cells of other sizes can be compared.
COMMON_CELL_M = 0.5


@dataclass(frozen=True, kw_only=True)
class BeliefFigures:
    """The figures of a belief.

    The referee's: `expected_distance_m` [m] = earth mover's distance to a point mass at the source, `mass_near` within
    the success radius, 0 to 1, `entropy_bits` on its own cells [bit]. Beside them: `error_m`, distance of its mean to
    the nearest source [m]; `minus_log_p`, -ln of the probability of the source's cell on the common grid, absent where
    that is 0; `level`, the probability of the smallest region that holds the source, 0 to 1, see
    `source_credible_level`.
    """

    expected_distance_m: float
    error_m: float
    mass_near: float
    entropy_bits: float
    minus_log_p: float | None
    level: float


def score_belief(belief: Belief, sources_m: Sequence[Vec3], *, within_m: float) -> BeliefFigures:
    """Return all figures of a belief.

    Args:
        sources_m: The sources, world frame [m]; of several the nearest counts, and the one believed most.
        within_m: The success radius [m].

    Held by:
        extensions/bench/tests/unit/metrics/test_beliefs.py
    """
    score = compute_belief_score(belief, sources_m, within_m=within_m)
    p, origin_m = belief.probability.to_array(), belief.origin_m
    return BeliefFigures(
        expected_distance_m=score.expected_distance_m,
        error_m=error_of_mean_m(p, origin_m, belief.cell_m, sources_m),
        mass_near=score.mass_near_frac,
        entropy_bits=score.entropy_bits,
        minus_log_p=minus_log_p(resample_belief(p, belief.cell_m, COMMON_CELL_M), origin_m, COMMON_CELL_M, sources_m),
        level=source_credible_level(p, origin_m, belief.cell_m, sources_m),
    )


def mean_m(p: ArrayLike, origin_m: Sequence[float], cell_m: float) -> Array:
    """Return the mean place of a belief, world frame [m]: 2 or 3 coordinates, as many as it has axes."""
    weights = _normalised(p)
    indices = [
        np.moveaxis(weights, axis, 0).reshape(n, -1).sum(axis=1) @ np.arange(n) for axis, n in enumerate(weights.shape)
    ]
    return np.asarray(origin_m, dtype=np.float64)[: weights.ndim] + (np.array(indices) + 0.5) * cell_m


def error_of_mean_m(p: ArrayLike, origin_m: Sequence[float], cell_m: float, sources_m: Sequence[Vec3]) -> float:
    """Return the distance of a belief's mean to the nearest source [m].

    At most `expected_distance_m` where there is one source (Jensen's inequality); between two places that are both
    believed in the mean is near neither.
    """
    mean = mean_m(p, origin_m, cell_m)
    return min(math.dist(mean, source_m[: len(mean)]) for source_m in sources_m)


def minus_log_p(p: ArrayLike, origin_m: Sequence[float], cell_m: float, sources_m: Sequence[Vec3]) -> float | None:
    """Return -ln of the probability of the source's cell; of several sources the one believed most.

    The logarithmic score of Good 1952, Rational decisions, doi:10.1111/j.2517-6161.1952.tb00104.x; 0 for certainty.
    Cells half as large have about ln 4 more in the plane and ln 8 in space, so bring beliefs to common cells first
    (`resample_belief`), and do not compare those in the plane with those in space.

    Returns:
        The score, >= 0; None where the probability is 0 or the source lies outside of the grid.
    """
    weights = _normalised(p)
    most = max((float(weights[cell]) for cell in _cells_of(weights.shape, origin_m, cell_m, sources_m)), default=0.0)
    return max(0.0, -math.log(most)) if most > 0.0 else None


def source_credible_level(p: ArrayLike, origin_m: Sequence[float], cell_m: float, sources_m: Sequence[Vec3]) -> float:
    """Return the probability of all cells that are believed more than the source's: the level of its region.

    The region of level b holds the most probable cells, as few as have b together, and all that are as probable as the
    last of them. The source is in it exactly when this figure is below b. Of a calibrated method the 50 % regions hold
    half of the sources or a little more, and the figure is about evenly spread from 0 to 1.

    Returns:
        The level, 0 to 1; 1 where the source's cell has no probability or the source lies outside of the grid.

    Source:
        Highest-density regions of Hyndman 1996, doi:10.1080/00031305.1996.10474359, on cells.
    """
    weights = _normalised(p)
    most = max((float(weights[cell]) for cell in _cells_of(weights.shape, origin_m, cell_m, sources_m)), default=0.0)
    return min(1.0, float(weights[weights > most].sum())) if most > 0.0 else 1.0


def resample_belief(p: ArrayLike, cell_m: float, new_cell_m: float) -> Array:
    """Return a belief on cells of another size with the same origin; within a cell its probability is spread evenly.

    Args:
        cell_m: Edge of its cells [m].
        new_cell_m: Edge of the cells to bring it to [m].

    Returns:
        As many axes; the cells cover the old ones, the last of an axis may reach beyond. The sum is 1.
    """
    weights = _normalised(p)
    for axis, n in enumerate(weights.shape):
        shares = _shares(n, cell_m, new_cell_m)
        weights = np.moveaxis(np.tensordot(shares, weights, axes=(1, axis)), 0, axis)
    return weights


# (n_new, n) which part of each old cell of an axis lies in each new one.
def _shares(n: int, cell_m: float, new_cell_m: float) -> Array:
    n_new = max(1, math.ceil(n * cell_m / new_cell_m - 1e-9))
    low_m, new_low_m = np.arange(n) * cell_m, np.arange(n_new)[:, np.newaxis] * new_cell_m
    overlap_m = np.minimum(low_m + cell_m, new_low_m + new_cell_m) - np.maximum(low_m, new_low_m)
    shares = np.clip(overlap_m / cell_m, 0.0, 1.0)
    return shares / shares.sum(axis=0)


def _cells_of(
    shape: tuple[int, ...], origin_m: Sequence[float], cell_m: float, sources_m: Sequence[Vec3]
) -> list[tuple[int, ...]]:
    n_axes = len(shape)
    places_m = np.array([source_m[:n_axes] for source_m in sources_m], dtype=np.float64)
    cells = np.floor((places_m - np.array(origin_m[:n_axes])) / cell_m).astype(np.int64)
    return [tuple(int(i) for i in cell) for cell in cells if np.all((cell >= 0) & (cell < shape))]


def _normalised(p: ArrayLike) -> NDArray[np.float64]:
    weights = np.asarray(p, dtype=np.float64)
    if weights.ndim not in (2, 3) or not weights.sum() > 0.0:
        raise ShapeError(
            f"p: expected (nx, ny) or (nx, ny, nz) probabilities with a sum above 0, was {weights.shape} with a sum of "
            f"{weights.sum():g}. Leave out flights without a belief."
        )
    return weights / weights.sum()
