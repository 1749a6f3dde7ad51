# pyright: basic
# ruff: noqa: ANN001, ANN201 - kernels have no types, and symbols of equations
"""Gas metrics: first contact, how gas came and went, and distance of an estimated map to the true one.

Metrics of contact are of true mixing ratios at the noses, not of readings. Gas counts when there is more of it than a
floor, that of the sensor; the referee's is `GAS_CONTACT_PPM`. With several noses the strongest counts.

Metrics of maps tell errors in shape from errors in amount. Gas maps are (nx, ny) mixing ratios in the mean over time at
one height, index order ij, of equal square cells. The truth is the mean over the time of the run at the height of the
map.
"""

import math
from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import ArrayLike, NDArray

from gslcosim.base.errors import ShapeError
from gslcosim_bench.metrics.series import Array, as_series


@dataclass(frozen=True, kw_only=True)
class GasEncounters:
    """Whiffs, during which gas is above the floor, and the blanks between two of them.

    Means are absent where there is none. What is cut off by the beginning or the end of the series counts as it is
    seen, except that blanks there are not between two whiffs and do not count.
    """

    n_whiffs: int
    mean_whiff_s: float | None
    n_blanks: int
    mean_blank_s: float | None


def first_contact_s(t_s: ArrayLike, gas_ppm: ArrayLike, floor_ppm: float) -> float | None:
    """Return the first time with gas above the floor at a nose [s]; None without.

    Args:
        t_s: (n,) times, growing [s].
        gas_ppm: (n,) or (n, n_noses) true mixing ratios at those times [ppm].
        floor_ppm: What the sensor's floor is [ppm].
    """
    times_s, is_in_gas = _in_gas(t_s, gas_ppm, floor_ppm)
    return float(times_s[is_in_gas.argmax()]) if is_in_gas.any() else None


def tracking_ratio(t_s: ArrayLike, gas_ppm: ArrayLike, floor_ppm: float) -> float | None:
    """Return the share of the time from first contact to the end of the series in gas above the floor.

    Each value stands for the time since the one before it, for a sample is valid at the end of its tick. Times need
    not be equally far apart.

    Args:
        t_s: (n,) times, growing [s].
        gas_ppm: (n,) or (n, n_noses) true mixing ratios at those times [ppm].
        floor_ppm: What the sensor's floor is [ppm].

    Returns:
        The share, 0 to 1; None without contact, or with one at the very end.
    """
    times_s, is_in_gas = _in_gas(t_s, gas_ppm, floor_ppm)
    first = int(is_in_gas.argmax())
    if not is_in_gas[first] or first == len(times_s) - 1:
        return None
    spans_s = np.diff(times_s)[first:]
    return float(spans_s[is_in_gas[first + 1 :]].sum() / spans_s.sum())


def find_encounters(t_s: ArrayLike, gas_ppm: ArrayLike, floor_ppm: float) -> GasEncounters:
    """Return number and mean duration of whiffs and blanks.

    Each whiff begins at its first value above the floor and ends at the next one that is not; the last one may end
    with the series. The blank between two whiffs lasts from the end of one to the beginning of the next.

    Args:
        t_s: (n,) times, growing [s].
        gas_ppm: (n,) or (n, n_noses) true mixing ratios at those times [ppm].
        floor_ppm: What the sensor's floor is [ppm].

    Source:
        Whiffs and blanks as Celani, Villermaux and Vergassola 2014, Odor landscapes in turbulent environments,
        doi:10.1103/PhysRevX.4.041015.
    """
    times_s, is_in_gas = _in_gas(t_s, gas_ppm, floor_ppm)
    changes = np.diff(np.concatenate([[0], is_in_gas.astype(np.int8), [0]]))
    begins_s = times_s[changes[:-1] == 1]
    ends_s = times_s[np.minimum(np.flatnonzero(changes == -1), len(times_s) - 1)]
    whiffs_s, blanks_s = ends_s - begins_s, begins_s[1:] - ends_s[:-1]
    return GasEncounters(
        n_whiffs=len(whiffs_s),
        mean_whiff_s=float(whiffs_s.mean()) if len(whiffs_s) else None,
        n_blanks=len(blanks_s),
        mean_blank_s=float(blanks_s.mean()) if len(blanks_s) else None,
    )


def _in_gas(t_s: ArrayLike, gas_ppm: ArrayLike, floor_ppm: float) -> tuple[Array, NDArray[np.bool_]]:
    times_s = as_series("t_s", t_s)
    gas = np.asarray(gas_ppm, dtype=np.float64)
    if gas.ndim not in (1, 2) or len(gas) != len(times_s):
        raise ShapeError(
            f"gas_ppm: expected shape ({len(times_s)},) or ({len(times_s)}, n_noses), was {gas.shape}. "
            "Pass one row for each time."
        )
    strongest_ppm = gas.reshape(len(times_s), -1).max(axis=1)
    return times_s, np.greater(strongest_ppm, floor_ppm)


@numba.njit(cache=True, nogil=True)
def solve_transport(supply, demand, cost):
    """Return the least cost of moving all supplies to the demands, exactly up to rounding.

    min over f >= 0 of sum_ij f_ij c_ij,  sum_j f_ij = a_i,  sum_i f_ij = b_j
    [mass cost] = [mass] [cost]

    Successive shortest augmenting paths with dual prices: from each supply in turn mass goes along the path of least
    reduced cost c_ij - u_i - v_j through arcs and back through those that carry mass. Exact because no path of
    negative reduced cost is ever left. Two maps of 20 x 20 cells take 0.05 to 0.2 s, of 40 x 40 up to 40 s.

    Args:
        supply: (n,) a, >= 0 [mass].
        demand: (m,) b, >= 0, with the same sum up to rounding [mass].
        cost: (n, m) c, >= 0.

    Source:
        Edmonds and Karp 1972, Theoretical improvements in algorithmic efficiency for network flow problems,
        doi:10.1145/321694.321699; the dense search as in Jonker and Volgenant 1987, doi:10.1007/BF02278710.
    Held by:
        extensions/bench/tests/unit/metrics/test_gas_maps.py (linear programs in scipy, closed forms)
    """
    n, m = cost.shape
    left, wanted = supply.copy(), demand.copy()
    flow = np.zeros((n, m))
    u, v = np.zeros(n), np.zeros(m)
    row_distance, column_distance = np.empty(n), np.empty(m)
    row_before, column_before = np.empty(m, np.int64), np.empty(n, np.int64)
    is_row_seen, is_column_done = np.empty(n, np.bool_), np.empty(m, np.bool_)
    waiting = np.empty(n, np.int64)
    smallest = 1e-14 * supply.sum()
    for s in range(n):
        while left[s] > smallest:
            is_row_seen[:] = False
            is_column_done[:] = False
            column_distance[:] = np.inf
            is_row_seen[s], row_distance[s], column_before[s] = True, 0.0, -1
            waiting[0], n_waiting = s, 1
            end = -1
            while True:
                for w in range(n_waiting):
                    i = waiting[w]
                    for j in range(m):
                        if not is_column_done[j]:
                            through = row_distance[i] + max(0.0, cost[i, j] - u[i] - v[j])
                            if through < column_distance[j]:
                                column_distance[j], row_before[j] = through, i
                best, nearest = -1, np.inf
                for j in range(m):
                    if not is_column_done[j] and column_distance[j] < nearest:
                        best, nearest = j, column_distance[j]
                if best < 0:
                    break
                is_column_done[best] = True
                if wanted[best] > 0.0:
                    end = best
                    break
                n_waiting = 0
                for i in range(n):
                    if flow[i, best] > 0.0 and not is_row_seen[i]:
                        is_row_seen[i], row_distance[i], column_before[i] = True, nearest, best
                        waiting[n_waiting] = i
                        n_waiting += 1
            # What is left has nowhere to go: the sums differ by rounding.
            if end < 0:
                break
            for i in range(n):
                if is_row_seen[i]:
                    u[i] += column_distance[end] - row_distance[i]
            for j in range(m):
                if is_column_done[j]:
                    v[j] -= column_distance[end] - column_distance[j]
            amount = min(left[s], wanted[end])
            j = end
            while row_before[j] != s:
                i = row_before[j]
                j = column_before[i]
                amount = min(amount, flow[i, j])
            left[s] -= amount
            wanted[end] -= amount
            j = end
            while True:
                i = row_before[j]
                flow[i, j] += amount
                if i == s:
                    break
                j = column_before[i]
                flow[i, j] -= amount
    return (flow * cost).sum()


# Cells on an axis up to which the transport is worth its time; larger maps are summed to larger cells.
MAX_CELLS = 20


def earth_movers_distance_m(a: ArrayLike, b: ArrayLike, cell_m: float) -> float | None:
    """Return the mean distance over which mass moves to turn one map into the other, both with mass 1 [m].

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
        extensions/bench/tests/unit/metrics/test_gas_maps.py
    """
    first, second = _checked(a, b)
    if not (first.sum() > 0.0 and second.sum() > 0.0):
        return None
    n_block = math.ceil(max(first.shape) / MAX_CELLS)
    p, q = (_sum_blocks(values / values.sum(), n_block) for values in (first, second))
    surplus = (p - q).ravel()
    gives, takes = np.flatnonzero(surplus > 0.0), np.flatnonzero(surplus < 0.0)
    if not len(gives) or not len(takes):
        return 0.0
    centres_m = np.argwhere(np.ones_like(p)) * (cell_m * n_block)
    cost_m = np.linalg.norm(centres_m[gives, np.newaxis] - centres_m[np.newaxis, takes], axis=2)
    return float(solve_transport(surplus[gives], -surplus[takes], cost_m))


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


def _sum_blocks(values: Array, n_block: int) -> Array:
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
