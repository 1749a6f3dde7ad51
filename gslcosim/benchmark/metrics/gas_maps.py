"""How far a gas map, as a robot has drawn it, is from the true one: its shape and its amount apart.

Gas maps are (nx, ny) mixing ratios in the mean over time at one height, index order ij, of equal square cells. The
truth is the mean over the time of the flight at the height of the map.
"""

import math

import numpy as np
from numpy.typing import ArrayLike

from gslcosim.benchmark.metrics.shapes import Array
from gslcosim.benchmark.metrics.transport_kernels import cheapest_transport
from gslcosim.errors import ShapeError

# Cells on an axis up to which the transport is worth its time; larger maps are summed to larger cells.
MAX_CELLS = 20


def earth_movers_distance_m(a: ArrayLike, b: ArrayLike, cell_m: float) -> float | None:
    """Return how far mass has to be moved on average to turn one map into the other, both with mass 1 [m].

    W1(p, q) = min over f >= 0 of sum_ij f_ij |x_i - x_j|,  sum_j f_ij = p_i,  sum_i f_ij = q_j,  p = a / sum a
    [m] = [1] [m]; 0 for maps of the same shape whatever their amounts, at most the diagonal

    Exact by optimal transport on up to 20 x 20 cells. Larger maps are first summed to the smallest cells of whole
    blocks that are so few; their distance is then off by less than the diagonal of such a cell less that of an old
    one (each mass moves by at most half of that, in both maps). Mass that both maps have in a cell stays there,
    which the triangle inequality allows, so only the differences are transported.

    Args:
        a: (nx, ny) map, >= 0, in any unit.
        b: (nx, ny) map, >= 0, in any unit.
        cell_m: Edge of the cells [m].

    Returns:
        The distance; None where one of the maps has no mass.

    Raises:
        ShapeError: the maps differ in shape, are not (nx, ny), or hold a negative number or none.

    Source:
        Rubner, Tomasi and Guibas 2000, The earth mover's distance as a metric for image retrieval,
        doi:10.1023/A:1026543900054.
    Held by:
        tests/unit/benchmark/metrics/test_gas_maps.py
    """
    first, second = _checked(a, b)
    if not (first.sum() > 0.0 and second.sum() > 0.0):
        return None
    n_block = math.ceil(max(first.shape) / MAX_CELLS)
    p, q = (summed(values / values.sum(), n_block) for values in (first, second))
    surplus = (p - q).ravel()
    gives, takes = np.flatnonzero(surplus > 0.0), np.flatnonzero(surplus < 0.0)
    if not len(gives) or not len(takes):
        return 0.0
    centres_m = np.argwhere(np.ones_like(p)) * (cell_m * n_block)
    cost_m = np.linalg.norm(centres_m[gives, np.newaxis] - centres_m[np.newaxis, takes], axis=2)
    return float(cheapest_transport(surplus[gives], -surplus[takes], cost_m))


def log_ratio_of_mass(estimate: ArrayLike, truth: ArrayLike) -> float | None:
    """Return ln(sum of the estimate / sum of the truth): 0 for the right amount, below 0 for too little.

    Args:
        estimate: (nx, ny) map, >= 0.
        truth: (nx, ny) map in the same unit on the same cells, >= 0.

    Returns:
        The logarithm; None where one of the maps has no mass.

    Raises:
        ShapeError: as `earth_movers_distance_m`.
    """
    first, second = _checked(estimate, truth)
    if not (first.sum() > 0.0 and second.sum() > 0.0):
        return None
    return math.log(float(first.sum()) / float(second.sum()))


def summed(values: Array, n_block: int) -> Array:
    """Return the sums over blocks of n x n cells; blocks at the far ends may reach beyond the map."""
    padded = np.pad(values, [(0, -n % n_block) for n in values.shape])
    nx, ny = (n // n_block for n in padded.shape)
    return padded.reshape(nx, n_block, ny, n_block).sum(axis=(1, 3))


def _checked(a: ArrayLike, b: ArrayLike) -> tuple[Array, Array]:
    first, second = np.asarray(a, dtype=np.float64), np.asarray(b, dtype=np.float64)
    if first.ndim != 2 or first.shape != second.shape:
        raise ShapeError(
            f"gas maps: expected two of one shape (nx, ny), was {first.shape} and {second.shape}. "
            "Bring them to the same cells first."
        )
    if not (np.all(first >= 0.0) and np.all(second >= 0.0)) or not np.isfinite(first.sum() + second.sum()):
        raise ShapeError("gas maps: expected numbers from 0 on, was a negative one or none. Set unknown cells to 0.")
    return first, second
