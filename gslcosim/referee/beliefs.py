"""How good a belief is, judged by the truth: pure functions of probabilities and places."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from gslcosim.contract.messages import Belief, BeliefScore
from gslcosim.quantities import Vec3

Array = NDArray[np.float64]


def score_of(belief: Belief, sources_m: Sequence[Vec3], *, within_m: float) -> BeliefScore:
    """Return the figures of a belief; one with two axes is judged in the plane.

    Args:
        belief: A probability for each cell.
        sources_m: The sources, world frame [m]; of several the nearest to each cell counts.
        within_m: The success radius [m].

    Held by:
        tests/unit/referee/test_beliefs.py
    """
    p = _probabilities(belief)
    distances_m = _distances_to_nearest_m(belief, sources_m)
    return BeliefScore(
        expected_distance_m=expected_distance_m(p, distances_m),
        mass_near_frac=_fraction(p[distances_m <= within_m].sum()),
        cell_frac=_fraction(sum(p[cell] for cell in _cells_of(belief, sources_m))),
        entropy_bits=entropy_bits(p),
    )


def expected_distance_m(p: Array, distances_m: Array) -> float:
    """Return the earth mover's distance of a belief to a point mass at the source [m].

    E = sum_i p_i d_i        [m] = [1] [m]

    To move all of it to one place there is one way only, so no optimiser is needed.

    Args:
        p: Probabilities, sum 1.
        distances_m: Distance of each cell's centre from the source [m], of the same shape.
    """
    return float((p * distances_m).sum())


def entropy_bits(p: Array) -> float:
    """Return the entropy H = -sum p log2 p [bit] (Shannon 1948); cells without probability add nothing."""
    positive = p[p > 0.0]
    return max(0.0, float(-(positive * np.log2(positive)).sum()))


# In double precision their sum is 1 to its last digits.
def _probabilities(belief: Belief) -> Array:
    p = belief.probability.to_array().astype(np.float64)
    return p / p.sum()


def _distances_to_nearest_m(belief: Belief, sources_m: Sequence[Vec3]) -> Array:
    shape = belief.probability.shape
    axes_m = [belief.origin_m[k] + (np.arange(n) + 0.5) * belief.cell_m for k, n in enumerate(shape)]
    centres_m = np.stack(np.meshgrid(*axes_m, indexing="ij"), axis=-1)
    squares_m2 = [((centres_m - np.array(source_m[: len(shape)])) ** 2).sum(axis=-1) for source_m in sources_m]
    return np.sqrt(np.min(squares_m2, axis=0))


# The cells that hold a source; one outside of the belief's grid is in none.
def _cells_of(belief: Belief, sources_m: Sequence[Vec3]) -> set[tuple[int, ...]]:
    shape = belief.probability.shape
    origin_m = np.array(belief.origin_m[: len(shape)])
    found: set[tuple[int, ...]] = set()
    for source_m in sources_m:
        index = np.floor((np.array(source_m[: len(shape)]) - origin_m) / belief.cell_m).astype(int)
        if np.all((index >= 0) & (index < shape)):
            found.add(tuple(int(i) for i in index))
    return found


def _fraction(value: float) -> float:
    return min(1.0, max(0.0, float(value)))
