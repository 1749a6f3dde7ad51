"""Difficulty of cases: a Rasch model, strata of blind coverage, how these tell entries apart, and causes (D1 to D5)."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gslcosim.base.errors import ModelError, ShapeError
from gslcosim_bench.statistics.estimates import Estimate, as_finite_row, check_same_length, two_sided_z

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


STRATA_FROM = (0.0, 1.0, 2.0, 4.0)
"""Least ratio of the time limit to the sweep's median of each stratum of coverage; chosen."""

STRATA = ("below 1", "1 to 2", "2 to 4", "4 and more")
"""Names of these strata."""


def coverage_ratio(sweep_s: np.ndarray, limit_s: float) -> float:
    """Return how often blind coverage fits into the time limit: limit over the sweep's median time to the source.

    Args:
        sweep_s: (n,) time in which each run of the sweep came within the radius [s]; nan or infinite without it.
        limit_s: Time limit [s].

    Returns:
        At least 1; 0 where the sweep came there in less than half of the runs; nan without runs.
    """
    times_s = np.asarray(sweep_s, dtype=np.float64)
    if not times_s.size:
        return math.nan
    median_s = float(np.median(np.where(np.isfinite(times_s), times_s, math.inf)))
    return limit_s / median_s if median_s <= limit_s else 0.0


def coverage_stratum(ratio: float) -> str:
    """Return the stratum of a case by its ratio of coverage, one of `STRATA`; empty where it is nan.

    Below 1 a sweep fails in most runs; at 4 and more approach needs no nose.
    """
    return "" if math.isnan(ratio) else STRATA[int(np.searchsorted(STRATA_FROM, ratio, side="right")) - 1]


@dataclass(frozen=True)
class Discrimination:
    """Discrimination of a stratum of cases between entries: the slope of success over ability.

    Attributes:
        stratum: Its label.
        slope: Change of the logit for one standard deviation of ability, with its interval; 0 tells nothing.
        n_cells: Cases in the stratum.
    """

    stratum: str
    slope: Estimate
    n_cells: int


_SLOPE_SD, _DIFFICULTY_SD = 1.0, 3.0
_STEP = 1e-4


def fit_discrimination(
    successes: np.ndarray, trials: np.ndarray, strata: Sequence[str], level: float = 0.95
) -> tuple[Discrimination, ...]:
    """Fit a two-parameter logistic model whose slope is shared by the cases of a stratum.

    P(success) = 1 / (1 + exp(-a_s (b_j - d_i))), b_j ~ N(0, 1), d_i ~ N(0, 3^2), ln a_s ~ N(0, 1)

    The mode is found by L-BFGS; a slope is a_s times the standard deviation of the b_j, and the intervals of its
    logarithm are normal, from the curvature at the mode. With 24 entries and 72 runs of each in a stratum, 90 to 94 %
    of such intervals hold the truth and the slopes are 2 to 4 % too steep; with 8 entries and 6 runs of each, 78 to
    87 %, and 1.6 to 2 times too steep: then read their order only.

    Args:
        successes: (n_cells, n_entries) counts.
        trials: (n_cells, n_entries) counts; 0 where an entry did not fly.
        strata: Label of each cell.

    Returns:
        One for each stratum, in the order in which they come.

    Source:
        Birnbaum 1968, in Lord and Novick, Statistical Theories of Mental Test Scores, chapter 17; priors: Mislevy 1986,
        doi:10.1007/BF02293979. One slope for a stratum: chosen, since a case alone has too few runs.
    Held by:
        extensions/bench/tests/unit/statistics/test_difficulty.py (simulated strata)
    """
    from scipy import optimize

    successes, trials = np.asarray(successes, dtype=np.float64), np.asarray(trials, dtype=np.float64)
    if successes.ndim != 2 or successes.shape != trials.shape or len(strata) != len(successes):
        raise ShapeError(
            "successes, trials, strata: expected one shape (n_cells, n_entries) and a stratum for each cell, were "
            f"{successes.shape}, {trials.shape} and {len(strata)}."
        )
    names = list(dict.fromkeys(strata))
    group = np.array([names.index(name) for name in strata])
    n_cells, n_groups = len(successes), len(names)

    def loss_and_gradient(place: np.ndarray) -> tuple[float, np.ndarray]:
        log_a, d, b = np.split(place, [n_groups, n_groups + n_cells])
        a = np.exp(log_a)[group][:, None]
        logit = a * (b[None, :] - d[:, None])
        value = np.sum(trials * np.logaddexp(0.0, logit) - successes * logit)
        value += np.sum(log_a**2) / (2 * _SLOPE_SD**2) + np.sum(d**2) / (2 * _DIFFICULTY_SD**2) + np.sum(b**2) / 2
        excess = trials * 0.5 * (1.0 + np.tanh(0.5 * logit)) - successes
        of_slope = np.bincount(group, weights=np.sum(excess * logit, axis=1), minlength=n_groups)
        gradient = np.concatenate([of_slope, -np.sum(excess * a, axis=1), np.sum(excess * a, axis=0)])
        return float(value), gradient + np.concatenate([log_a / _SLOPE_SD**2, d / _DIFFICULTY_SD**2, b])

    start = np.zeros(n_groups + n_cells + successes.shape[1])
    # Abilities that are all 0 are a saddle: the rates of entries and cases give the side.
    shares = successes.sum(axis=0) / np.maximum(trials.sum(axis=0), 1.0)
    start[n_groups + n_cells :] = shares - shares.mean()
    found = optimize.minimize(
        loss_and_gradient, start, jac=True, method="L-BFGS-B", options={"maxiter": 5000, "ftol": 1e-13, "gtol": 1e-7}
    )
    place = np.asarray(found.x)
    if np.abs(loss_and_gradient(place)[1]).max() > 1e-2:
        raise ModelError("Two-parameter logistic model: not converged. Give more runs of each case.")
    steps = np.eye(place.size) * _STEP
    curvature = np.stack(
        [(loss_and_gradient(place + s)[1] - loss_and_gradient(place - s)[1]) / (2 * _STEP) for s in steps]
    )
    covariance = np.linalg.inv(0.5 * (curvature + curvature.T))
    # The mode has all abilities too close together and all slopes too steep; their product is what the runs tell.
    b = place[n_groups + n_cells :]
    of_scale = np.zeros_like(place)
    of_scale[n_groups + n_cells :] = (b - b.mean()) / (b.size * b.var())
    log_slope = place[:n_groups] + np.log(b.std())
    directions = np.eye(n_groups, place.size) + of_scale
    error = np.sqrt(np.einsum("ij,jk,ik->i", directions, covariance, directions))
    z = two_sided_z(level)
    return tuple(
        Discrimination(
            stratum=name,
            slope=Estimate(
                float(np.exp(log_slope[k])), float(np.exp(log_slope[k] - z * error[k])),
                float(np.exp(log_slope[k] + z * error[k])),
                int(trials[group == k].sum()),
            ),
            n_cells=int(np.sum(group == k)),
        )
        for k, name in enumerate(names)
    )  # fmt: skip


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
