"""Difficulty of cases: a Rasch model, and causes (D1 to D5)."""

import math
from dataclasses import dataclass

import numpy as np

from gslcosim.base.errors import ModelError, ShapeError
from gslcosim_bench.statistics.estimates import as_finite_row, check_same_length

EASY, MEDIUM, HARD = "easy", "medium", "hard"

_MANY_STEPS = 100
_CLOSE = 1e-10


@dataclass(frozen=True)
class Rasch:
    """Difficulties of cells and abilities of entries on one scale [logit].

    P(success) = 1 / (1 + exp(difficulty - ability)). The mean difficulty is 0.

    Attributes:
        difficulty: (n_cells,) of each cell; higher is harder.
        difficulty_error: (n_cells,) standard errors.
        ability: (n_entries,) of each entry; higher is better.
        ability_error: (n_entries,) standard errors.
        is_informative: (n_cells,) False where all entries always or never succeeded, or nobody flew: such a cell tells
            no entries apart, and its difficulty is only held by the prior.
    """

    difficulty: np.ndarray
    difficulty_error: np.ndarray
    ability: np.ndarray
    ability_error: np.ndarray
    is_informative: np.ndarray


def fit_rasch(successes: np.ndarray, trials: np.ndarray, prior_sd: float = 3.0) -> Rasch:
    """Fit difficulties and abilities to counts of successes.

    maximise sum_ij [s_ij ln p_ij + (n_ij - s_ij) ln(1 - p_ij)] - (sum_i d_i^2 + sum_j a_j^2) / (2 sd^2)
    p_ij = 1 / (1 + exp(d_i - a_j))

    The penalty keeps cells and entries with 0 or 100 % finite; it is a normal prior around 0. Difficulties and
    abilities are then moved together so that the mean difficulty is 0.

    Args:
        successes: (n_cells, n_entries) counts, 0 to those of trials.
        trials: (n_cells, n_entries) counts; 0 where an entry did not fly.
        prior_sd: Standard deviation of the prior [logit]; 3 hardly pulls a rate between 5 and 95 %. Chosen.

    Returns:
        The fit, with standard errors from the curvature at the maximum.

    Source:
        Rasch 1960, Probabilistic Models for Some Intelligence and Attainment Tests; penalty: Mislevy 1986,
        doi:10.1007/BF02293979.
    """
    successes, trials = np.asarray(successes, dtype=np.float64), np.asarray(trials, dtype=np.float64)
    if successes.ndim != 2 or successes.shape != trials.shape:
        raise ShapeError(
            f"successes, trials: expected one shape (n_cells, n_entries), were {successes.shape} and {trials.shape}."
        )
    if np.any(successes < 0) or np.any(successes > trials):
        raise ShapeError("successes: expected 0 to the number of trials in each place. Give counts of the same trials.")
    n_cells, n_entries = successes.shape
    place = np.zeros(n_cells + n_entries)
    for _ in range(_MANY_STEPS):
        gradient, curvature = _slopes(place, successes, trials, prior_sd)
        step = np.linalg.solve(curvature, gradient)
        # The likelihood is concave; short steps keep Newton's method from overshooting far from the maximum.
        place = place + step * min(1.0, 2.0 / max(float(np.abs(step).max()), 1e-300))
        if np.abs(step).max() < _CLOSE:
            break
    else:
        raise ModelError(f"Rasch model: not converged after {_MANY_STEPS} steps. Give a smaller prior_sd.")
    shift = np.eye(place.size)
    shift[:, :n_cells] -= 1.0 / n_cells
    errors = np.sqrt(np.diag(shift @ np.linalg.inv(_slopes(place, successes, trials, prior_sd)[1]) @ shift.T))
    place = shift @ place
    total = successes.sum(axis=1)
    informative = (total > 0) & (total < trials.sum(axis=1))
    return Rasch(place[:n_cells], errors[:n_cells], place[n_cells:], errors[n_cells:], informative)


# Gradient of the penalised log-likelihood, and its negative second derivatives; difficulties first, then abilities.
def _slopes(
    place: np.ndarray, successes: np.ndarray, trials: np.ndarray, prior_sd: float
) -> tuple[np.ndarray, np.ndarray]:
    n_cells = successes.shape[0]
    p = 0.5 * (1.0 + np.tanh(0.5 * (place[None, n_cells:] - place[:n_cells, None])))
    excess, weight = successes - trials * p, trials * p * (1.0 - p)
    gradient = np.concatenate([-excess.sum(axis=1), excess.sum(axis=0)]) - place / prior_sd**2
    curvature = np.diag(np.concatenate([weight.sum(axis=1), weight.sum(axis=0)]) + 1.0 / prior_sd**2)
    curvature[:n_cells, n_cells:] = -weight
    curvature[n_cells:, :n_cells] = -weight.T
    return gradient, curvature


def grades(difficulty: np.ndarray) -> list[str]:
    """Return "easy", "medium" or "hard" for each cell: the lowest, the middle and the highest third of ranks.

    Equal difficulties share their mean rank, and so their grade; all are medium if all are equal.

    Args:
        difficulty: (n,) difficulties, any unit; higher is harder.
    """
    from scipy.stats import rankdata

    difficulty = as_finite_row(difficulty, "difficulty")
    # (rank - 1/2) / n against 1/3 and 2/3, in whole numbers: ranks may be halves.
    sixths = 3.0 * (2.0 * rankdata(difficulty) - 1.0)
    n = difficulty.size
    return [EASY if place < 2 * n else HARD if place > 4 * n else MEDIUM for place in sixths]


def geometric_difficulty(blind_success_frac: float) -> float:
    """Return D1: how rarely a persistent blind walk comes to the source, 1 - its rate of success."""
    return 1.0 - blind_success_frac


def contact_difficulty(first_contact_s: np.ndarray, limit_s: float) -> float:
    """Return D2: how rarely a sweep meets gas early, 1 - P(first contact within T / 3).

    Args:
        first_contact_s: (n,) first contact of each trial of the sweep [s]; nan or infinite without contact.
        limit_s: Time limit T [s].

    Returns:
        0 to 1; nan without trials.
    """
    first_contact_s = np.asarray(first_contact_s, dtype=np.float64)
    return 1.0 - float(np.mean(first_contact_s <= limit_s / 3.0)) if first_contact_s.size else math.nan


def distance_difficulty(shortest_path_m: float, room_diagonal_m: float) -> float:
    """Return D3: the oracle's way over the diagonal of the room, both [m]; dimensionless."""
    return shortest_path_m / room_diagonal_m


def plume_legibility(upwind_gradient: np.ndarray, gas_free_frac: np.ndarray) -> float:
    """Return D4: how plainly the plume points to its source; unlike the others, high is easy.

    share of points with upwind gradient > 0, times 1 - mean share of time without gas

    Args:
        upwind_gradient: (n,) derivative of the time-mean concentration against the wind at points on the plume's axis,
            any unit.
        gas_free_frac: (n,) share of time in which each point is without gas, 0 to 1.

    Returns:
        0 to 1; nan without points.

    Source:
        Chosen.
    """
    upwind_gradient = as_finite_row(upwind_gradient, "upwind_gradient")
    gas_free_frac = as_finite_row(gas_free_frac, "gas_free_frac")
    check_same_length(upwind_gradient=upwind_gradient, gas_free_frac=gas_free_frac)
    if upwind_gradient.size == 0:
        return math.nan
    return float(np.mean(upwind_gradient > 0.0) * (1.0 - gas_free_frac.mean()))


def wind_difficulty(toward: np.ndarray) -> float:
    """Return D5: the circular standard deviation of the wind's direction along the oracle's way, over pi.

    sd = sqrt(-2 ln R), R = |mean(toward)|; at most 1 is returned, though sd has no limit as R goes to 0

    Args:
        toward: (n, 2) at each point of the way the unit vector to which the wind blows; where it was averaged over
            time, its length is the share that does not cancel, dimensionless.

    Returns:
        0 to 1; nan without points.

    Source:
        Mardia 1972, Statistics of Directional Data.
    """
    toward = np.asarray(toward, dtype=np.float64)
    if toward.ndim != 2 or toward.shape[1] != 2:
        raise ShapeError(f"toward: expected (n, 2) unit vectors, was {toward.shape}.")
    if len(toward) == 0:
        return math.nan
    length = min(1.0, float(np.hypot(*toward.mean(axis=0))))
    # abs: the logarithm of 1 would give -0.
    return min(1.0, math.sqrt(abs(2.0 * math.log(length))) / math.pi) if length > 0.0 else 1.0
