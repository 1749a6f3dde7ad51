"""Ranking of entries: all pairs over the same cases, and ranks that are tested for all entries together."""

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from gslcosim.base.errors import ShapeError
from gslcosim.bench.statistics.estimates import (
    LEVEL,
    N_DRAWS,
    SEED,
    UNDEFINED,
    Estimate,
    Seed,
    check_same_length,
    degrees_of_freedom,
    draw_counts,
    percentile_interval,
)
from gslcosim.bench.statistics.pairs import N_FLIPS, holm, joint_sign_flips, sign_flips


@dataclass(frozen=True)
class Pair:
    """One entry against another over the cases that both flew.

    Attributes:
        a: Name of the one.
        b: Name of the other.
        difference: Mean of a minus b with its paired bootstrap interval; n counts pairs.
        p: Of the sign-flip test that there is no difference.
        p_holm: The same, corrected for all pairs of the matrix.
        a_better: Share of pairs in which a is better, ties half, with its interval.
    """

    a: str
    b: str
    difference: Estimate
    p: float
    p_holm: float
    a_better: Estimate

    def turned(self) -> "Pair":
        """Return the same comparison seen from the other entry."""
        difference, better = self.difference, self.a_better
        return Pair(
            self.b,
            self.a,
            Estimate(-difference.value, -difference.high, -difference.low, difference.n),
            self.p,
            self.p_holm,
            Estimate(1.0 - better.value, 1.0 - better.high, 1.0 - better.low, better.n),
        )


@dataclass(frozen=True)
class PairsMatrix:
    """All pairs of entries.

    Attributes:
        names: The entries, in the order given.
        pairs: One `Pair` for each two of them, the earlier one as a.
    """

    names: tuple[str, ...]
    pairs: tuple[Pair, ...]

    def of(self, a: str, b: str) -> Pair:
        """Return the comparison of a with b.

        Raises:
            KeyError: there is no such pair.
        """
        for pair in self.pairs:
            if (pair.a, pair.b) == (a, b):
                return pair
            if (pair.a, pair.b) == (b, a):
                return pair.turned()
        raise KeyError((a, b))


def pairs_matrix(
    values: np.ndarray,
    names: list[str],
    *,
    lower_is_better: bool,
    clusters: np.ndarray | None = None,
    strata: np.ndarray | None = None,
    level: float = LEVEL,
    seed: int = SEED,
    n_draws: int = N_DRAWS,
    n_flips: int = N_FLIPS,
) -> PairsMatrix:
    """Compare all entries with each other on the cases that both of two flew.

    All pairs share the draws, so that the intervals of a matrix fit together.

    Args:
        values: (n_cases, n_entries) successes as 0 and 1, counted times or scores; nan where an entry has no result.
        names: Of the entries.
        lower_is_better: True for times, False for successes and scores.
        clusters: (n_cases,) labels of cases that share their gas and are drawn, and tossed, as one.
        strata: (n_cases,) labels of cells that are drawn from apart.
        level: Confidence level, 0 to 1.
        seed: Of draws and tosses.
        n_draws: Bootstrap samples.
        n_flips: Drawn patterns of signs.

    Raises:
        ShapeError: not one column for each name, or an infinite value.

    Source:
        Paired bootstrap, sign-flip test and Holm's correction: see `gslcosim.bench.statistics.pairs`.
    """
    values = np.asarray(values, dtype=np.float64)
    if values.ndim != 2 or values.shape[1] != len(names) or np.isinf(values).any():
        raise ShapeError(
            f"values: expected a finite number or nan for each case and {len(names)} entries, was {values.shape}. "
            "Count failures with the limit."
        )
    index = list(combinations(range(len(names)), 2))
    if not index:
        return PairsMatrix(tuple(names), ())
    differences = np.stack([values[:, a] - values[:, b] for a, b in index], axis=1)
    sign = -1.0 if lower_is_better else 1.0
    won = np.where(np.isnan(differences), np.nan, 0.5 + 0.5 * np.sign(sign * differences))
    both = np.concatenate([differences, won], axis=1)
    means = _means(both, clusters, strata, level, seed, n_draws)
    p = sign_flips(differences, clusters=clusters, seed=seed, n_flips=n_flips)
    corrected = holm(p)
    m = len(index)
    pairs = [
        Pair(names[a], names[b], means[i], float(p[i]), float(corrected[i]), means[m + i])
        for i, (a, b) in enumerate(index)
    ]
    return PairsMatrix(tuple(names), tuple(pairs))


def ranks(
    values: np.ndarray,
    *,
    lower_is_better: bool,
    clusters: np.ndarray | None = None,
    level: float = LEVEL,
    seed: int = SEED,
    n_flips: int = N_FLIPS,
) -> list[int]:
    """Return the rank of each entry: one more than the number of entries that are shown to be better.

    All pairs are tested together (`joint_sign_flips`): where no two entries differ, the chance that any of them gets
    another rank than 1 is at most 1 - level, however many there are. A rank is the best place that an entry may have;
    one that flew few cases may share a rank with entries of a better mean.

    Args:
        values: (n_cases, n_entries) as for `pairs_matrix`; nan where an entry has no result.
        lower_is_better: True for times, False for successes and scores.
        clusters: (n_cases,) labels of cases whose signs are tossed as one.
        level: Confidence level of all ranks together, 0 to 1.
        seed: Of the tosses.
        n_flips: Drawn patterns of signs.

    Returns:
        (n_entries,) ranks. Entries without results come last, all of one rank.

    Source:
        The best plausible place of Mogstad et al. 2024, Review of Economic Studies 91, with a permutation test.
    """
    values = np.asarray(values, dtype=np.float64)
    has_any = ~np.isnan(values).all(axis=0)
    rank = np.where(has_any, 1, int(has_any.sum()) + 1)
    index = list(combinations(np.flatnonzero(has_any).tolist(), 2))
    if not index:
        return [int(place) for place in rank]
    differences = np.stack([values[:, a] - values[:, b] for a, b in index], axis=1)
    p = joint_sign_flips(differences, clusters=clusters, seed=seed, n_flips=n_flips)
    total = np.nan_to_num(differences).sum(axis=0)
    for k in np.flatnonzero(p <= 1.0 - level + 1e-12):
        a, b = index[k]
        is_first_worse = total[k] > 0.0 if lower_is_better else total[k] < 0.0
        rank[a if is_first_worse else b] += 1
    return [int(place) for place in rank]


# Mean of each column, nan left out, with its interval; all columns share the draws.
def _means(
    columns: np.ndarray,
    clusters: np.ndarray | None,
    strata: np.ndarray | None,
    level: float,
    seed: Seed,
    n_draws: int,
) -> list[Estimate]:
    n = len(columns)
    known = ~np.isnan(columns)
    n_known = known.sum(axis=0)
    if n == 0 or not n_known.any():
        return [UNDEFINED] * columns.shape[1]
    if clusters is not None:
        check_same_length(values=columns, clusters=clusters)
    filled = np.where(known, columns, 0.0)
    draws = []
    with np.errstate(invalid="ignore"):
        for counts in draw_counts(n, strata=strata, clusters=clusters, seed=seed, n_draws=n_draws):
            weight = counts.sum(axis=1, keepdims=True) if known.all() else counts @ known
            draws.append(counts @ filled / weight)
        values = filled.sum(axis=0) / n_known
    drawn = np.concatenate(draws)
    freedom_of_all = degrees_of_freedom(n, strata=strata, clusters=clusters)
    estimates = []
    for i, value in enumerate(values):
        freedom = freedom_of_all if n_known[i] == n else _freedom_of_known(known[:, i], strata, clusters)
        estimates.append(Estimate(float(value), *percentile_interval(drawn[:, i], level, freedom), int(n_known[i])))
    return estimates


def _freedom_of_known(known: np.ndarray, strata: np.ndarray | None, clusters: np.ndarray | None) -> int:
    return degrees_of_freedom(
        int(known.sum()),
        strata=None if strata is None else np.asarray(strata)[known],
        clusters=None if clusters is None else np.asarray(clusters)[known],
    )
