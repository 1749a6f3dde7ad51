"""Racing: the place of one new entry in the table of a suite, from some of its flights.

The other entries have flown the whole suite, so their scores are known. The new entry's place follows from one unknown
number, its score over the whole suite: a place is one more than the number of entries with a higher score. Flights are
drawn without replacement with known probabilities, more often where the entries that it is not yet told apart from
disagree, and what the other entries' rows predict is taken out of each result. So the choice of cases biases nothing,
and an interval holds for all times together: a race may be looked at after each flight and stopped whenever it suits.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gslcosim.base.errors import ShapeError
from gslcosim_bench.statistics.estimates import LEVEL, encode_labels

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

BATCH = 4
"""Flights that are drawn before their results are looked at; chosen, so that workers have something to fly at once."""

BUDGET_FRAC = 0.15
"""Share of the suite's flights of an entry that a race may take by default."""

# Scores that differ by less are equal: sums of the same numbers in another order differ in their last digits.
_EQUAL = 1e-9
# Share of draws that go by the weight of a case alone. It bounds how much one result can count, and with it the width
# of the interval: with less, errors of the score are no smaller and intervals are wider.
_EVEN_FRAC = 0.7
# Weight of entries that are told apart already, when it is asked where entries disagree.
_FAR_WEIGHT = 0.1
# Variances of the prediction before any result: of the new entry's level, of how much it follows the other entries'
# mean in a flight and in a case, of how much it resembles single entries, and of what no row predicts.
_LEVEL_VAR, _MEAN_VAR, _ENTRY_VAR, _NOISE_VAR = 0.09, 0.25, 0.1, 0.09
# Largest share of the capital that a bet may lose.
_MAX_STAKE = 0.9
# The bets are best for an interval after this share of the budget.
_BEST_AT = 0.5
_BISECTIONS = 30


@dataclass(frozen=True, kw_only=True)
class PlaceEstimate:
    """Estimate of an entry's place after some flights of a race.

    `score` is the expected score over the whole suite, `place` the place that it would have; the true score is between
    `low` and `high`, and the true place between `first` and `last`, for all estimates of a race together, in `level`
    of races.
    """

    n_flown: int
    score: float
    low: float
    high: float
    place: int
    first: int
    last: int

    @property
    def n_places(self) -> int:
        """The number of places that are still possible."""
        return self.last - self.first + 1


def weigh_flights(cases: NDArray[np.generic]) -> Floats:
    """Return what each flight counts in a score in which each case counts the same.

    Args:
        cases: (n,) case of each flight.

    Returns:
        (n,) weights whose sum is 1.
    """
    code = encode_labels(cases)
    n_flights = np.bincount(code)
    return 1.0 / (len(n_flights) * n_flights[code])


def find_place(score: float, others: Floats) -> int:
    """Return the place of a score: one more than the number of others that are higher; equal ones share it."""
    return 1 + int(np.sum(others > score + _EQUAL))


class PlaceRace:
    """The race of one entry against the rows of others.

    Each flight i has a weight w_i, and the score is theta = sum w_i x_i. After some flights S, with predictions p of
    the others and probabilities q of which the next one is drawn, one result I gives

        Z = sum_S w_i x_i + sum_not S w_j p_j + w_I (x_I - p_I) / q_I        E[Z | before] = theta

    for any p and q that follow from earlier results. For a number m, the capital of who bets on theta > m grows by
    1 + lambda (Z - m), with 0 <= lambda < 1 / (m - least possible Z): as long as theta <= m it is a nonnegative
    supermartingale from 1, which reaches 2 / (1 - level) at any time with a probability of (1 - level) / 2 at most
    (Ville). So each m at which it ever does is too low; likewise from above. Both capitals are monotone in m. No
    correction for the number of entries is needed: one interval of theta decides all places.

    lambda = sqrt(2 log(2 / (1 - level)) / (n variance)), with the variance of Z so far and n half of the budget. What
    is flown bounds theta too: sum_S w_i x_i <= theta <= that + sum_not S w_j.

    Source:
        Waudby-Smith and Ramdas 2023, doi:10.1093/jrsssb/qkad009 (betting, section 4; the plug-in lambda, section B.1);
        Shekhar, Xu, Lipton, Liang and Ramdas 2023, arXiv:2305.06884 (draws with weights without replacement, and
        predictions as control variates).
    Deviation:
        Predictions are those of a linear Gaussian model with the other entries' rows as features (ours); whatever they
        are, the interval holds.
    Held by:
        extensions/bench/tests/unit/statistics/test_racing.py (coverage over time, no bias) and
        tests/benchmarks/raced_entries.py (recorded rows)
    """

    def __init__(
        self,
        others: Floats,
        cases: NDArray[np.generic],
        *,
        seed: int | Sequence[int],
        budget: int,
        level: float = LEVEL,
    ) -> None:
        """Begin a race.

        Args:
            others: (n, k) score of each flight of the suite, 0 to 1, of the entries whose rows are known.
            cases: (n,) case of each flight.
            seed: Of the draws; the same results with the same seed are drawn alike.
            budget: Flights for which bets are best; more may be flown.
            level: Confidence of all intervals of this race together.
        """
        self._others = np.asarray(others, dtype=np.float64)
        if self._others.ndim != 2 or not self._others.size or not np.all((self._others >= 0) & (self._others <= 1)):
            raise ShapeError(
                "others: expected a score from 0 to 1 for each flight and each of at least one entry, was an array of "
                f"the shape {self._others.shape}{' with other numbers' if self._others.size else ''}."
            )
        n = len(self._others)
        self._weights = weigh_flights(cases)
        if len(self._weights) != n or budget < 1:
            raise ShapeError(
                f"cases, budget: expected {n} cases and at least one flight, was {len(self._weights)} and {budget}."
            )
        self.table: Floats = self._weights @ self._others
        self._rng = np.random.default_rng(seed)
        self._threshold = math.log(2.0 / (1.0 - level))
        self._stake = 2.0 * self._threshold / max(1.0, _BEST_AT * budget)
        self._kernel, self._prior = _build_kernel(self._others, encode_labels(cases)), float(np.median(self.table))
        self._is_left = np.ones(n, dtype=np.bool_)
        self._drawn: list[_Draw] = []
        self._flown: list[int] = []
        self._results: list[float] = []
        # Of each flown result: Z, the variance before it, and the least and largest Z that were possible.
        self._bets: list[tuple[float, float, float, float]] = []
        self._low, self._high = 0.0, 1.0
        self._sum_of_squares = 0.0
        self._predict()

    @property
    def n_left(self) -> int:
        """The number of flights that were not drawn yet."""
        return int(self._is_left.sum())

    def draw(self, n: int = BATCH) -> list[int]:
        """Return the flights that are flown next, in this order; `record` takes their results.

        Args:
            n: How many; fewer where fewer are left.
        """
        if self._drawn:
            raise ShapeError(f"draw: expected results of {len(self._drawn)} flights first, were none.")
        chances = self._weights * self._find_disagreement()
        for _ in range(min(n, self.n_left)):
            q = np.where(self._is_left, chances, 0.0)
            q /= q.sum()
            i = int(self._rng.choice(len(q), p=q))
            left, weight = self._is_left, self._weights
            ratio = weight[left] / q[left]
            self._drawn.append(
                _Draw(
                    flight=i,
                    weight=float(weight[i] / q[i]),
                    expected=float(weight[left] @ self._predicted[left]),
                    least=float((-self._predicted[left] * ratio).min()),
                    most=float(((1.0 - self._predicted[left]) * ratio).max()),
                )
            )
            self._is_left[i] = False
        return [draw.flight for draw in self._drawn]

    def record(self, results: Sequence[float]) -> PlaceEstimate:
        """Take the results of the flights that were drawn, and return what is known then.

        Args:
            results: Score of each, 0 to 1.
        """
        if len(results) != len(self._drawn) or not all(0.0 <= x <= 1.0 for x in results):
            raise ShapeError(f"results: expected {len(self._drawn)} scores from 0 to 1, was {list(results)}.")
        for draw, x in zip(self._drawn, results, strict=True):
            before = sum(self._weights[i] * each for i, each in zip(self._flown, self._results)) + draw.expected
            surprise = draw.weight * (x - float(self._predicted[draw.flight]))
            # The first variance is that of a toss: no result is known then.
            variance = (0.1 + self._sum_of_squares) / (1 + len(self._bets))
            self._bets.append((before + surprise, max(variance, 1e-4), before + draw.least, before + draw.most))
            self._sum_of_squares += surprise * surprise
            self._flown.append(draw.flight)
            self._results.append(float(x))
            self._bound()
        self._drawn = []
        self._predict()
        return self.estimate()

    def estimate(self) -> PlaceEstimate:
        """Return what is known of the place."""
        score = float(np.clip(self._sum_flown() + self._weights[self._is_left] @ self._predicted[self._is_left], 0, 1))
        score = min(max(score, self._low), self._high)
        return PlaceEstimate(
            n_flown=len(self._flown),
            score=score,
            low=self._low,
            high=self._high,
            place=find_place(score, self.table),
            first=find_place(self._high, self.table),
            last=find_place(self._low, self.table),
        )

    def _sum_flown(self) -> float:
        return float(self._weights[self._flown] @ np.array(self._results)) if self._flown else 0.0

    # Posterior mean of what is left, given what was flown.
    def _predict(self) -> None:
        self._predicted = np.full(len(self._weights), self._prior)
        if self._flown:
            known = self._kernel[np.ix_(self._flown, self._flown)] + _NOISE_VAR * np.eye(len(self._flown))
            gain = np.linalg.solve(known, np.array(self._results) - self._prior)
            self._predicted += self._kernel[:, self._flown] @ gain
        self._predicted = np.clip(self._predicted, 0.0, 1.0)

    # Relative chance of each flight: how far the entries that are not told apart yet are from the prediction.
    def _find_disagreement(self) -> Floats:
        is_near = (self.table >= self._low) & (self.table <= self._high)
        weight = np.where(is_near, 1.0, _FAR_WEIGHT)
        spread = np.sqrt((self._others - self._predicted[:, None]) ** 2 @ (weight / weight.sum()))
        mean = float(self._weights[self._is_left] @ spread[self._is_left] / self._weights[self._is_left].sum())
        return _EVEN_FRAC + (1.0 - _EVEN_FRAC) * spread / mean if mean > 0.0 else np.ones(len(spread))

    # New ends of the interval after the last bet; those of earlier ones stay.
    def _bound(self) -> None:
        z, variance, least, most = (np.array(column) for column in zip(*self._bets, strict=True))
        stake = np.sqrt(self._stake / variance)
        flown, left = self._sum_flown(), 1.0 - float(self._weights[self._flown].sum())
        lower = _find_end(self._low, z, stake, least, self._threshold)
        upper = 1.0 - _find_end(1.0 - self._high, 1.0 - z, stake, 1.0 - most, self._threshold)
        # In the few races whose bets ruled out the truth, what is flown decides in the end.
        self._low, self._high = sorted(min(max(end, flown), flown + left) for end in (lower, upper))


@dataclass(frozen=True, kw_only=True)
class _Draw:
    flight: int
    weight: float
    expected: float
    least: float
    most: float


# The largest m from `start` on that the bets on more have ruled out; `start` where they rule out none.
def _find_end(start: float, z: Floats, stake: Floats, least: Floats, threshold: float) -> float:
    def is_ruled_out(m: float) -> bool:
        room = np.maximum(m - least, 1e-12)
        return float(np.log1p(np.minimum(stake, _MAX_STAKE / room) * (z - m)).sum()) >= threshold

    if not is_ruled_out(start):
        return start
    low, high = start, 1.0
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        if is_ruled_out(middle):
            low = middle
        else:
            high = middle
    return low


def _build_kernel(others: Floats, cases: Ints) -> Floats:
    mean = others.mean(axis=1)
    of_case = np.bincount(cases, mean) / np.bincount(cases)
    centred = others - others.mean(axis=0)
    kernel = np.full((len(others), len(others)), _LEVEL_VAR)
    for feature in (mean - mean.mean(), of_case[cases] - mean.mean()):
        kernel += _MEAN_VAR * np.outer(feature, feature)
    return kernel + _ENTRY_VAR / others.shape[1] * (centred @ centred.T)


def replay_race(
    scores: Floats,
    entry: int,
    cases: NDArray[np.generic],
    *,
    seed: int | Sequence[int],
    budget: int,
    batch: int = BATCH,
    level: float = LEVEL,
) -> list[PlaceEstimate]:
    """Return the estimates of a race on recorded rows after each batch, for an entry that is left out of them.

    Args:
        scores: (n, k) score of each flight of the suite, 0 to 1, of all entries.
        entry: Index of the one that races the others.
        cases: (n,) case of each flight.
        seed: Of the draws.
        budget: Flights of the race.
        batch: Flights before results are looked at.
        level: Confidence of all intervals together.
    """
    race = PlaceRace(np.delete(scores, entry, axis=1), cases, seed=seed, budget=budget, level=level)
    estimates: list[PlaceEstimate] = []
    while race.n_left and (n_flown := estimates[-1].n_flown if estimates else 0) < budget:
        estimates.append(race.record([float(scores[i, entry]) for i in race.draw(min(batch, budget - n_flown))]))
    return estimates
