# pyright: basic
"""Objectives of information-driven searches: the expected cost of each next stop, and a monitor for a wrong model.

Held by:
    extensions/search/tests/unit/information/test_objectives.py
"""

# ruff: noqa: ANN001, ANN201 - kernels have no types, and symbols of equations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

from gslcosim_search import elementary

# Columns of `predict_stops_into`.
PROBABILITY, ENTROPY_BITS, GAIN_BITS, MANHATTAN_M, SQUARE_M2, VARIANCE_M2, RENYI_BITS = range(7)
N_FIGURES = 7
_PER_LN_2 = 1.4426950408889634
Array = NDArray[np.float64]
# Costs closer together than this are equal; the first one is taken, on any machine.
SAME_COST = 1e-10


@numba.njit(cache=True, nogil=True)
def log_or_zero_into(p, log_p):
    """Write the natural logarithm of each probability, 0 where the probability is 0 (nothing is weighted by it)."""
    for j in range(p.shape[0]):
        log_p[j] = elementary.log(p[j]) if p[j] > 0.0 else 0.0


@numba.njit(cache=True, nogil=True)
def predict_stops_into(p, log_p, likelihood, weight, log_weight, cells_m, places_m, alpha, figures):
    """Write, for each place and each outcome of a stop there, how likely it is and what belief it would leave.

    Z = sum_s p(s) L(s)                                      probability of the outcome, without finding the source
    p'(s) = p(s) W(s) / z,  z = sum_s p(s) W(s)              belief that it leaves
    H = -sum p' log2 p'                                      its entropy [bit]
    G = sum p' log2(p' / p)                                  its divergence from the belief of now [bit]
    M = sum p' |s - x|_1,  S = sum p' |s - x|^2              expected distance along the axes [m], squared distance [m2]
    V = S - |sum p' (s - x)|^2                               its variance, summed over the axes [m2]
    A = log2(sum p'^alpha p^(1 - alpha)) / (alpha - 1)       Renyi divergence [bit]
    [1] = [1] [1]

    Cells that the searcher would find to be the source, or not, have likelihood and weight 0: a found source leaves
    no entropy, and so adds nothing to a sum over outcomes weighted by Z.

    Args:
        p: (c,) belief, sums to 1.
        log_p: (c,) its natural logarithm, 0 where p is 0.
        likelihood: (m, n, c) L, for m places of the searcher and n outcomes.
        weight: (m, n, c) W, equal to L where nothing is tempered.
        log_weight: (m, n, c) natural logarithm of W, 0 where W is 0.
        cells_m: (c, d) centres of the cells s, world frame [m].
        places_m: (m, d) places x of the searcher [m].
        alpha: Order of the Renyi divergence, > 0 and not 1; 0 leaves that figure 0.
        figures: (m, n, N_FIGURES) in the order of the constants above; overwritten. An impossible outcome has zeros.

    Source:
        Vergassola, Villermaux, Shraiman 2007, doi:10.1038/nature05464 (Z, H); Renyi 1961 (A).
    Held by:
        extensions/search/tests/unit/information/test_objectives.py (numpy, outcome by outcome)
    """
    n_dimensions = cells_m.shape[1]
    offset = np.empty(n_dimensions)
    mean = np.empty(n_dimensions)
    for i in range(likelihood.shape[0]):
        for h in range(likelihood.shape[1]):
            chance, z, z_log_p, z_log_w, manhattan, square, overlap = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
            mean[:] = 0.0
            for j in range(p.shape[0]):
                chance += p[j] * likelihood[i, h, j]
                w = p[j] * weight[i, h, j]
                if w == 0.0:
                    continue
                z += w
                z_log_p += w * log_p[j]
                z_log_w += w * log_weight[i, h, j]
                along, across = 0.0, 0.0
                for k in range(n_dimensions):
                    offset[k] = cells_m[j, k] - places_m[i, k]
                    along += abs(offset[k])
                    across += offset[k] * offset[k]
                    mean[k] += w * offset[k]
                manhattan += w * along
                square += w * across
                if alpha == 0.5:
                    overlap += p[j] * math.sqrt(weight[i, h, j])
                elif alpha > 0.0:
                    overlap += p[j] * elementary.exp(alpha * log_weight[i, h, j])
            figures[i, h, :] = 0.0
            figures[i, h, PROBABILITY] = chance
            if z <= 0.0:
                continue
            log_z = elementary.log(z)
            centre = 0.0
            for k in range(n_dimensions):
                centre += (mean[k] / z) ** 2
            figures[i, h, ENTROPY_BITS] = max(0.0, (log_z - (z_log_p + z_log_w) / z) * _PER_LN_2)
            figures[i, h, GAIN_BITS] = (z_log_w / z - log_z) * _PER_LN_2
            figures[i, h, MANHATTAN_M] = manhattan / z
            figures[i, h, SQUARE_M2] = square / z
            figures[i, h, VARIANCE_M2] = max(0.0, square / z - centre)
            if alpha > 0.0:
                figures[i, h, RENYI_BITS] = (elementary.log(overlap) - alpha * log_z) / (alpha - 1.0) * _PER_LN_2


@numba.njit(cache=True, nogil=True)
def remaining_entropy_bits(p, log_p, likelihood, weight, log_weight):
    """Return the entropy that is expected to remain after a stop at one place; a found source leaves none.

    E = sum_h Z_h H_h, as in `predict_stops_into`
    [bit] = [1] [bit]

    Args:
        p: (c,) belief.
        log_p: (c,) its natural logarithm, 0 where p is 0.
        likelihood: (n, c) probability of each outcome.
        weight: (n, c) what it weighs.
        log_weight: (n, c) natural logarithm of the weight.
    """
    total = 0.0
    for h in range(likelihood.shape[0]):
        chance, z, z_log = 0.0, 0.0, 0.0
        for j in range(p.shape[0]):
            chance += p[j] * likelihood[h, j]
            w = p[j] * weight[h, j]
            z += w
            z_log += w * (log_p[j] + log_weight[h, j])
        if z > 0.0:
            total += chance * max(0.0, elementary.log(z) - z_log / z)
    return total * _PER_LN_2


@numba.njit(cache=True, nogil=True)
def posterior_into(p, log_p, weight, log_weight, posterior, log_posterior):
    """Write the belief that an outcome leaves, and its logarithm; return z, the sum before scaling.

    p'(s) = p(s) W(s) / z
    [1] = [1] [1]

    Args:
        p: (c,) belief.
        log_p: (c,) its natural logarithm, 0 where p is 0.
        weight: (c,) W.
        log_weight: (c,) natural logarithm of W, 0 where W is 0.
        posterior: (c,) p'; overwritten. All 0 where z is 0.
        log_posterior: (c,) its logarithm, 0 where p' is 0; overwritten.
    """
    z = 0.0
    for j in range(p.shape[0]):
        posterior[j] = p[j] * weight[j]
        z += posterior[j]
    if z <= 0.0:
        posterior[:] = 0.0
        log_posterior[:] = 0.0
        return 0.0
    log_z = elementary.log(z)
    for j in range(p.shape[0]):
        posterior[j] /= z
        log_posterior[j] = log_p[j] + log_weight[j] - log_z if posterior[j] > 0.0 else 0.0
    return z


@dataclass(frozen=True, kw_only=True, eq=False)
class Candidates:
    """Stops that may come next: what each outcome would say about each place of the source.

    Args:
        places_m: (m, d) where the searcher would stop, world frame [m].
        cells_m: (c, d) where the source may be [m].
        likelihood: (m, n, c) probability of each of n outcomes; 0 for cells that the stop would search through, so
            that the source is found if it is there.
        weight: (m, n, c) what the outcome weighs in a belief: the likelihood, tempered.
        log_weight: (m, n, c) natural logarithm of the weight, 0 where that is 0.
    """

    places_m: Array
    cells_m: Array
    likelihood: Array
    weight: Array
    log_weight: Array

    @classmethod
    def within_reach(
        cls, places_m: Array, cells_m: Array, tables: tuple[Array, Array, Array], *, reach_m: float
    ) -> "Candidates":
        """Return stops that search through the cells nearer than `reach_m`; `tables` are those of `likelihoods`."""
        for i, place_m in enumerate(places_m):
            is_found = np.linalg.norm(cells_m - place_m, axis=1) < reach_m
            for table in tables:
                table[i][:, is_found] = 0.0
        likelihood, weight, log_weight = tables
        return cls(places_m=places_m, cells_m=cells_m, likelihood=likelihood, weight=weight, log_weight=log_weight)


@dataclass(frozen=True, kw_only=True, eq=False)
class Predictions:
    """Predictions for stops: figures of m places and n outcomes, arrays (m, n).

    Args:
        probability: Of the outcome, with the source not found; a row sums to 1 less the chance to find it.
        entropy_bits: Of the belief that the outcome leaves.
        gain_bits: Divergence of that belief from the one of now (Kullback and Leibler).
        manhattan_m: Expected distance of the source from the stop, along the axes.
        square_m2: Expected square of its distance.
        variance_m2: Variance of the belief, summed over the axes.
        renyi_bits: Divergence of an order (Renyi), 0 where none was asked for.
    """

    probability: Array
    entropy_bits: Array
    gain_bits: Array
    manhattan_m: Array
    square_m2: Array
    variance_m2: Array
    renyi_bits: Array

    @property
    def found_frac(self) -> Array:
        """Chance (m,) to find the source with the stop."""
        return 1.0 - self.probability.sum(axis=1)

    @property
    def predictive(self) -> Array:
        """Probability (m, n) of each outcome given that the source is not found; rows sum to 1."""
        total = self.probability.sum(axis=1, keepdims=True)
        even = np.full(self.probability.shape, 1.0 / self.probability.shape[1])
        return np.divide(self.probability, total, out=even, where=total > 0.0)


def log_or_zero(p: Array) -> Array:
    """Return natural logarithms of probabilities, 0 for those that are 0."""
    log_p = np.empty(p.shape)
    log_or_zero_into(p, log_p)
    return log_p


def predict_stops(p: Array, candidates: Candidates, *, alpha: float = 0.0) -> Predictions:
    """Return the predictions of a flat belief for candidate stops; `alpha` is the order of the Renyi divergence."""
    figures = np.empty((*candidates.likelihood.shape[:2], N_FIGURES))
    predict_stops_into(
        p,
        log_or_zero(p),
        candidates.likelihood,
        candidates.weight,
        candidates.log_weight,
        candidates.cells_m,
        candidates.places_m,
        alpha,
        figures,
    )
    return Predictions(
        probability=figures[..., PROBABILITY],
        entropy_bits=figures[..., ENTROPY_BITS],
        gain_bits=figures[..., GAIN_BITS],
        manhattan_m=figures[..., MANHATTAN_M],
        square_m2=figures[..., SQUARE_M2],
        variance_m2=figures[..., VARIANCE_M2],
        renyi_bits=figures[..., RENYI_BITS],
    )


def update_belief(p: Array, log_weight: Array) -> Array:
    """Return a belief after an outcome: p' = p W / sum(p W), by logarithms; unchanged where nothing is left.

    Args:
        p: Belief, any shape.
        log_weight: Natural logarithm of what the outcome weighs, of the same shape; minus infinity rules out.
    """
    log_p = elementary.log_each(p) + log_weight
    highest = float(log_p.max())
    if not math.isfinite(highest):
        return p
    raised = elementary.exp_each(log_p - highest)
    return raised / raised.sum()


def find_min_cost_index(costs: Array) -> int:
    """Return the index of the least cost, the first of equal ones."""
    return int(np.flatnonzero(costs <= costs.min() + SAME_COST)[0])


# ---------------------------------------------------------------- criteria: costs of stops, the least is best


def infotaxis_cost(predictions: Predictions) -> Array:
    """Return the expected entropy after each stop [bit]; a found source leaves none.

    J = (1 - P_found) sum_h rho_h H_h        rho predictive probability of the outcome h, H entropy it leaves

    A sure find comes first, also where no entropy is left to lose.

    Source:
        Vergassola, Villermaux, Shraiman 2007, doi:10.1038/nature05464.
    """
    return _with_sure_finds_first((predictions.probability * predictions.entropy_bits).sum(axis=1), predictions)


def space_aware_cost(predictions: Predictions, *, step_m: float, cells_per_step: float = 1.0) -> Array:
    """Return the expected logarithm of the steps that remain after each stop.

    J = (1 - P_found) sum_h rho_h log2(D_h + 2^(H_h - 1) - 1/2)        0 where the bracket is not positive
    D expected distance along the axes in steps [1], H entropy counted in cells of a step's size [bit]

    Args:
        predict: Of the stops.
        cells_per_step: How many cells of the belief a square or cube of a step's size has: entropy is less by the
            logarithm of that, and at least 0.

    Source:
        Loisy and Eloy 2022, doi:10.1098/rspa.2022.0118.
    Deviation:
        Their cells are one step large; ours may be smaller.
    """
    entropy = np.maximum(0.0, predictions.entropy_bits - elementary.log2(cells_per_step))
    steps = predictions.manhattan_m / step_m + elementary.pow_each(2.0, entropy - 1.0) - 0.5
    value = np.where(steps > 0.0, elementary.log2_each(np.maximum(steps, 1e-300)), 0.0)
    return _with_sure_finds_first((predictions.probability * value).sum(axis=1), predictions)


def entrotaxis_cost(predictions: Predictions) -> Array:
    """Return minus the entropy of the next reading [bit]: the stop with the least certain outcome is best.

    J = sum_h rho_h log2 rho_h

    Source:
        Hutchinson, Oh, Chen 2018, Entrotaxis, doi:10.1016/j.inffus.2017.10.009 (doi remembered, unverified).
    """
    rho = predictions.predictive
    return (rho * elementary.log2_each(np.where(rho > 0.0, rho, 1.0))).sum(axis=1)


def information_gain_cost(predictions: Predictions) -> Array:
    """Return minus the expected divergence of the next belief from this one [bit].

    J = -sum_h rho_h sum_s p'_h log2(p'_h / p)

    Without tempering and without the chance to find the source it is infotaxis: the expected divergence is the
    expected drop of entropy.

    Source:
        Hutchinson, Liu, Chen 2018, doi:10.1109/TCST.2018.2860548, as in AutoSTE: there over particles and one draw.
    """
    return -(predictions.predictive * predictions.gain_bits).sum(axis=1)


def renyi_cost(predictions: Predictions) -> Array:
    """Return minus the expected Renyi divergence of the next belief from this one [bit].

    J = -sum_h rho_h log2(sum_s p'_h^alpha p^(1 - alpha)) / (alpha - 1)

    Source:
        Ristic, Skvortsov, Gunatilaka 2016, Information Fusion 28 (cognitive search; remembered, unverified).
    """
    return -(predictions.predictive * predictions.renyi_bits).sum(axis=1)


def free_energy_cost(predictions: Predictions, *, step_m: float, temperature: float) -> Array:
    """Return the expected free energy after each stop: distance in steps and entropy, weighed by a temperature.

    J = (1 - P_found) sum_h rho_h (D_h + T H_h)        D expected distance along the axes [steps], T [steps/bit]

    Source:
        Masson, Bailly-Bechet, Vergassola 2009, J. Phys. A 42, 434009 (remembered, unverified).
    """
    energy = predictions.manhattan_m / step_m + temperature * predictions.entropy_bits
    return (predictions.probability * energy).sum(axis=1)


def dual_control_cost(
    predictions: Predictions, places_m: Array, mean_m: Sequence[float], *, exploration: float
) -> Array:
    """Return the squared distance to the estimate of now and the variance expected after each stop [m2].

    J = |x - E[s]|^2 + b sum_h rho_h tr cov(p'_h)        b weight of exploration

    Args:
        predict: Of the stops.
        places_m: (m, d) the stops x [m].
        exploration: b; 0 goes straight to the estimate.

    Source:
        Chen, Rhodes, Liu 2021, doi:10.1016/j.automatica.2021.109851.
    Deviation:
        With the mean *after* the reading in place of that of now, as it is usually written, the two terms add up to
        E|s - x|^2 whatever the reading may tell (law of total expectation), and nothing is explored.
    Held by:
        extensions/search/tests/unit/information/test_objectives.py (that law, too)
    """
    exploitation = np.square(places_m - np.asarray(mean_m)).sum(axis=1)
    return exploitation + exploration * (predictions.predictive * predictions.variance_m2).sum(axis=1)


# Costs are 0 for a sure find, and may be 0 elsewhere too.
def _with_sure_finds_first(costs: Array, predictions: Predictions) -> Array:
    return np.where(predictions.found_frac > 1.0 - SAME_COST, costs - 1.0, costs)


# ---------------------------------------------------------------- several steps ahead


@dataclass(frozen=True, kw_only=True, eq=False)
class MoveTree:
    """Places within reach of several steps, and which leads where.

    Args:
        candidates: Of all places that may be reached.
        moves: Sequence for each place of the places that are one step from it, by number.
        start: For the first step: the places that are one step from here.
    """

    candidates: Candidates
    moves: Sequence[Sequence[int]]
    start: Sequence[int]


def n_step_costs(p: Array, tree: MoveTree, *, depth: int, discount: float = 0.999) -> Array:
    """Return minus the entropy that each first step is expected to gain, with the best steps after it [bit].

    G_n(p) = max_a [ H(p) - sum_h Z_h H(p'_h) + g sum_h Z_h G_(n-1)(p'_h) ],  G_0 = 0        g discount
    [bit] = [bit]

    One step is infotaxis, less a constant. The sums of gains telescope: without a discount, the last entropy counts.

    Args:
        p: Belief, flat.
        depth: Number of steps n, at least 1.
        discount: What a gain one step later counts.

    Source:
        Infotaxis with several steps of anticipation: Loisy and Eloy 2022, doi:10.1098/rspa.2022.0118.
    Deviation:
        Their discount grows with the level twice over; ours is geometric.
    Held by:
        extensions/search/tests/unit/information/test_objectives.py (numpy over all paths)
    """
    log_p = log_or_zero(p)
    return -np.array([_gain_of(p, log_p, place, tree, depth, discount) for place in tree.start])


def _gain_of(p: Array, log_p: Array, place: int, tree: MoveTree, depth: int, discount: float) -> float:
    candidates = tree.candidates
    likelihood, weight, log_weight = (
        table[place] for table in (candidates.likelihood, candidates.weight, candidates.log_weight)
    )
    before_bits = -float((p * log_p).sum()) * _PER_LN_2
    gain = before_bits - remaining_entropy_bits(p, log_p, likelihood, weight, log_weight)
    if depth == 1:
        return gain
    posterior, log_posterior = np.empty(p.shape), np.empty(p.shape)
    for h in range(likelihood.shape[0]):
        chance = float((p * likelihood[h]).sum())
        if chance > 0.0 and posterior_into(p, log_p, weight[h], log_weight[h], posterior, log_posterior) > 0.0:
            later = (
                _gain_of(posterior, log_posterior, following, tree, depth - 1, discount)
                for following in tree.moves[place]
            )
            gain += discount * chance * max(later)
    return gain


# ---------------------------------------------------------------- a model that is wrong


class SurpriseMonitor:
    """Notices that outcomes surprise more than a searcher's model of the plume allows, and asks to trust it less.

    wrong: mean over the last n stops of (-ln rho(h)) exceeds its expectation by k standard deviations
    expectation e = -sum rho ln rho, variance v = sum rho (ln rho)^2 - e^2; of the mean: sum v / n^2

    State: the last n stops; cleared when the model was found wrong.

    Source:
        Ours; a confident belief by a wrong model never recovers by itself.
    """

    def __init__(self, *, n_stops: int = 20, k: float = 3.0) -> None:
        """Begin without stops.

        Args:
            n_stops: Over how many stops surprise is averaged, n.
            k: How many standard deviations are too many.
        """
        self._stops: deque[tuple[float, float]] = deque(maxlen=n_stops)
        self._k = k

    def add(self, predictive: Array, outcome: int) -> bool:
        """Take note of an outcome and of how likely each was held to be; return whether the model is wrong."""
        rho = np.maximum(predictive, 1e-12)
        rho = rho / rho.sum()
        log_rho = elementary.log_each(rho)
        expected = -float((rho * log_rho).sum())
        variance = float((rho * np.square(log_rho)).sum()) - expected * expected
        self._stops.append((-float(log_rho[outcome]) - expected, max(0.0, variance)))
        if len(self._stops) < (self._stops.maxlen or 0):
            return False
        excess, total = (math.fsum(column) for column in zip(*self._stops, strict=True))
        is_wrong = excess > self._k * math.sqrt(total)
        if is_wrong:
            self._stops.clear()
        return is_wrong


def flatten_belief(p: Array, power: float = 0.5) -> Array:
    """Return a belief that is less sure: p^k, scaled to sum 1; cells ruled out stay so."""
    raised = elementary.pow_each(p, power)
    return raised / raised.sum()
