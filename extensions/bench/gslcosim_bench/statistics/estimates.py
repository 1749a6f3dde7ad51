"""Estimates with intervals, the bootstrap samples behind them, and quantiles for them."""

import hashlib
import math
from collections import OrderedDict
from collections.abc import Callable, Iterator, Sized
from dataclasses import asdict, dataclass, replace

import numpy as np
from scipy import special

from gslcosim.base.errors import ShapeError

LEVEL = 0.95
"""Confidence level of every interval unless another is asked for."""

SEED = 20_231
"""Seed of all draws unless another is given: a report made twice from the same rows is the same to the bit."""

N_DRAWS = 2000
"""Bootstrap samples unless another number is asked for: the ends of a 95 % interval then stand on 50 draws each."""

Seed = int | np.random.Generator
"""A seed, or a generator to go on drawing from."""
# Rows times draws held at once: 32 MB of indices.
_CHUNK_ENTRIES = 4_000_000
# A report asks for the same draws hundreds of times: of each method, by each figure that has a value in each trial.
_MAX_CACHE_BYTES = 80_000_000
_draw_cache: OrderedDict[bytes, list[np.ndarray]] = OrderedDict()


@dataclass(frozen=True)
class Estimate:
    """A figure, the ends of its confidence interval, and how many trials (or pairs of trials) it stands on.

    What is undefined is nan: everything without trials, the ends where no interval can be given.
    A time that is not reached is infinite.
    """

    value: float
    low: float
    high: float
    n: int

    def to_fields(self) -> dict[str, float | int | None]:
        """Return the estimate as JSON has it: what is undefined or infinite is None."""
        return {key: value if math.isfinite(value) else None for key, value in asdict(self).items()}

    @property
    def holds_zero(self) -> bool:
        """True where zero lies within the interval, its ends included, so there may be no difference; or undefined."""
        return not (self.low > 0.0 or self.high < 0.0)

    def is_within(self, margin: float) -> bool:
        """Return whether the whole interval is nearer to zero than a margin; False where there is no interval."""
        return -margin < self.low and self.high < margin


UNDEFINED = Estimate(math.nan, math.nan, math.nan, 0)
"""The estimate without a value or an interval."""


def two_sided_z(level: float) -> float:
    """Return z such that a standard normal number lies within ±z with the probability `level`; 1.96 for 0.95."""
    return float(special.ndtri(0.5 + level / 2.0))


def student_quantile(probability: float, freedom: float) -> float:
    """Return the point below which Student's t has this probability, 0 < probability < 1."""
    return float(special.stdtrit(freedom, probability))


def make_generator(seed: Seed) -> np.random.Generator:
    """Return the generator itself, or a new one from a seed."""
    return seed if isinstance(seed, np.random.Generator) else np.random.default_rng(seed)


def percentile_interval(draws: np.ndarray, freedom: int | None = None) -> tuple[float, float]:
    """Return the ends of the expanded percentile bootstrap interval.

    They leave Phi(-t) of the draws on each side, t Student's quantile: what 0.025 of Student's distribution is in the
    normal one. So few trials get the wider interval that they deserve; with many it is the plain percentile interval.
    The ends are values that were drawn, never something between two of them, so infinite draws are allowed.

    Args:
        draws: (n_draws,) the statistic of each bootstrap sample; nan (undefined in that sample) is left out.
        freedom: Degrees of freedom of the spread; 0: nothing is known of it, so no interval. None: endless.

    Source:
        Hesterberg 2015, What teachers should know about the bootstrap, doi:10.1080/00031305.2015.1089789;
        its factor sqrt(n / (n - 1)) is not needed with draws of one less than there are.
    """
    known = np.sort(draws[~np.isnan(draws)])
    if known.size == 0 or freedom == 0:
        return math.nan, math.nan
    share = (1.0 - LEVEL) / 2.0
    if freedom is not None:
        share = float(special.ndtr(-student_quantile(0.5 + LEVEL / 2.0, freedom)))
    tail = math.floor(share * known.size)
    return float(known[tail]), float(known[known.size - 1 - tail])


def as_finite_row(values: np.ndarray, name: str) -> np.ndarray:
    """Return one row of finite numbers as floats."""
    array = np.asarray(values, dtype=np.float64)
    if array.ndim != 1:
        raise ShapeError(f"{name}: expected one dimension, had {array.ndim}. Give one value per trial.")
    n_bad = int(np.count_nonzero(~np.isfinite(array)))
    if n_bad:
        raise ShapeError(f"{name}: expected finite numbers, {n_bad} of {array.size} are not. Leave these trials out.")
    return array


def check_same_length(**arrays: np.ndarray) -> None:
    """Raise unless all arrays have one entry per trial."""
    lengths = {name: len(array) for name, array in arrays.items()}
    if len(set(lengths.values())) > 1:
        listed = ", ".join(f"{name} {length}" for name, length in lengths.items())
        raise ShapeError(f"expected arrays of one length, had {listed}. Give one value per trial in each.")


def bootstrap(
    n: int,
    statistic: Callable[[np.ndarray], np.ndarray],
    *,
    strata: np.ndarray | None = None,
    clusters: np.ndarray | None = None,
    seed: Seed = SEED,
    n_draws: int = N_DRAWS,
) -> Estimate:
    """Return a statistic of rows with its percentile bootstrap interval.

    Args:
        statistic: From (d, m) indices of rows to the (d,) statistic of each of the d samples.
        strata: (n,) labels; each stratum is drawn from apart. None: one stratum.
        clusters: (n,) labels; rows of a cluster are drawn together. None: each row for itself.
        seed: Of the draws. Calls with the same seed, strata and clusters draw the same rows.

    Returns:
        The estimate; without interval where no stratum has two clusters (or rows).
    """
    if n == 0:
        return UNDEFINED
    value = float(statistic(np.arange(n)[None, :])[0])
    chunks = iterate_row_draws(n, strata=strata, clusters=clusters, seed=seed, n_draws=n_draws)
    draws = np.concatenate([np.asarray(statistic(rows), dtype=np.float64) for rows in chunks])
    return Estimate(value, *percentile_interval(draws, degrees_of_freedom(n, strata=strata, clusters=clusters)), n)


def bootstrap_mean(
    values: np.ndarray,
    strata: np.ndarray | None = None,
    *,
    clusters: np.ndarray | None = None,
    seed: Seed = SEED,
    n_draws: int = N_DRAWS,
) -> Estimate:
    """Return the mean of (n,) finite values with its bootstrap interval, in which each stratum keeps its weight.

    Entries whose rows have the same strata and clusters in the same order get the same draws, and so stay paired.

    Source:
        Agarwal et al. 2021, arXiv:2108.13264, with the ends of `percentile_interval`.
    Held by:
        extensions/bench/tests/unit/statistics/test_aggregates.py, test_simulated_entries.py (coverage)
    """
    values = as_finite_row(values, "values")
    if not values.size:
        return UNDEFINED
    weight = draw_weights(values.size, strata=strata, clusters=clusters)
    if np.ptp(weight) == 0.0:
        statistic = lambda rows: values[rows].mean(axis=1)  # noqa: E731
    else:
        weighted = weight * values
        statistic = lambda rows: weighted[rows].sum(axis=1) / weight[rows].sum(axis=1)  # noqa: E731
    drawn = bootstrap(values.size, statistic, strata=strata, clusters=clusters, seed=seed, n_draws=n_draws)
    return replace(drawn, value=float(values.mean()))


def draw_weights(n: int, *, strata: np.ndarray | None = None, clusters: np.ndarray | None = None) -> np.ndarray:
    """Return the weight of each row in samples of `iterate_row_draws`: k / (k - 1) in a stratum of k clusters.

    Since k - 1 of k are drawn, a small stratum would count for less than its share; so weighed, all count for theirs.
    """
    weight = np.ones(n)
    for group in _groups(n, strata, clusters) if n else []:
        weight[np.concatenate([np.ravel(rows) for rows in group])] = len(group) / _n_drawn(group)
    return weight


def iterate_row_draws(
    n: int,
    *,
    strata: np.ndarray | None = None,
    clusters: np.ndarray | None = None,
    seed: Seed = SEED,
    n_draws: int = N_DRAWS,
) -> Iterator[np.ndarray]:
    """Yield bootstrap samples of rows, many at a time.

    From a stratum of k clusters (or rows) k - 1 are drawn with replacement, so that the variance of a mean over draws
    is s^2 / k without bias. Drawing k would shrink it by (k - 1) / k: by half for two repetitions of each case.
    A stratum of one shows no spread and adds none. Strata that share a cluster (starts that met the same gas) are drawn
    from together, so that the cluster stays whole.

    Args:
        strata: (n,) labels, or None.
        clusters: (n,) labels, or None.

    Yields:
        (d, m) indices of rows; the d sum up to `n_draws`.

    Source:
        McCarthy and Snowden 1985, The Bootstrap and Finite Population Sampling (k - 1 of k in each stratum).
    """
    groups = _groups(n, strata, clusters)
    if not all(len({len(rows) for rows in group}) == 1 for group in groups):
        yield from _unequal_clusters(groups, make_generator(seed), n_draws)
        return
    tables = [np.asarray(group) for group in groups]
    if isinstance(seed, np.random.Generator):
        yield from _equal_clusters(tables, seed, n_draws)
    else:
        yield from _draw_cached(tables, seed, n_draws)


def degrees_of_freedom(n: int, *, strata: np.ndarray | None = None, clusters: np.ndarray | None = None) -> int:
    """Return the degrees of freedom of the spread: clusters (or rows) less strata; 0 where no spread can be seen."""
    return sum(max(len(group) - 1, 0) for group in _groups(n, strata, clusters))


def draw_counts(n: int, *, clusters: np.ndarray | None = None, n_draws: int = N_DRAWS) -> Iterator[np.ndarray]:
    """Yield how often each row was drawn, (d, n), for the samples of `iterate_row_draws`."""
    for rows in iterate_row_draws(n, clusters=clusters, n_draws=n_draws):
        slot = rows + n * np.arange(len(rows))[:, None]
        yield np.bincount(slot.ravel(), minlength=n * len(rows)).reshape(len(rows), n).astype(np.float64)


def encode_labels(labels: np.ndarray) -> np.ndarray:
    """Return labels as 0, 1, 2 … in the order of first appearance, so that draws do not depend on how they sort."""
    _, first, codes = np.unique(np.asarray(labels), return_index=True, return_inverse=True)
    return np.argsort(np.argsort(first))[codes.reshape(-1)]


# For each stratum its clusters, for each cluster its rows.
def _groups(
    n: int, strata: np.ndarray | None, clusters: np.ndarray | None
) -> list[np.ndarray] | list[list[np.ndarray]]:
    stratum = np.zeros(n, dtype=np.intp) if strata is None else _codes(strata, n)
    if clusters is None:
        return [rows[:, None] for rows in _members(stratum)]
    cluster = _codes(clusters, n)
    stratum = _joined(stratum, cluster)
    rows_of = _members(cluster)
    return [[rows_of[c] for c in np.unique(cluster[rows])] for rows in _members(stratum)]


def _draw_cached(tables: list[np.ndarray], seed: int, n_draws: int) -> Iterator[np.ndarray]:
    n_rows = sum(table.size for table in tables)
    dtype = np.min_scalar_type(max(n_rows - 1, 0))
    n_bytes = sum(_n_drawn(table) * table.shape[1] for table in tables) * n_draws * dtype.itemsize
    if n_bytes > _MAX_CACHE_BYTES:
        yield from _equal_clusters(tables, make_generator(seed), n_draws)
        return
    asked = hashlib.blake2b(repr((seed, n_draws, [table.shape for table in tables])).encode(), digest_size=16)
    for table in tables:
        asked.update(table.astype(np.int64).tobytes())
    key = asked.digest()
    if key in _draw_cache:
        _draw_cache.move_to_end(key)
    else:
        while n_bytes + sum(rows.nbytes for chunks in _draw_cache.values() for rows in chunks) > _MAX_CACHE_BYTES:
            _draw_cache.popitem(last=False)
        _draw_cache[key] = [rows.astype(dtype) for rows in _equal_clusters(tables, make_generator(seed), n_draws)]
    for rows in list(_draw_cache[key]):
        yield rows.astype(np.intp)


def _equal_clusters(tables: list[np.ndarray], rng: np.random.Generator, n_draws: int) -> Iterator[np.ndarray]:
    for d in _chunks(sum(table.size for table in tables), n_draws):
        picked = [table[rng.integers(0, len(table), (d, _n_drawn(table)))].reshape(d, -1) for table in tables]
        yield np.concatenate(picked, axis=1)


def _unequal_clusters(
    groups: list[np.ndarray] | list[list[np.ndarray]], rng: np.random.Generator, n_draws: int
) -> Iterator[np.ndarray]:
    for _ in range(n_draws):
        drawn = [group[i] for group in groups for i in rng.integers(0, len(group), _n_drawn(group))]
        yield np.concatenate(drawn)[None, :]


def _n_drawn(group: Sized) -> int:
    return max(1, len(group) - 1)


def _chunks(n: int, n_draws: int) -> Iterator[int]:
    at_once = max(1, _CHUNK_ENTRIES // n)
    for _ in range(math.ceil(n_draws / at_once)):
        yield min(at_once, n_draws)
        n_draws -= at_once


def _codes(labels: np.ndarray, n: int) -> np.ndarray:
    check_same_length(rows=np.empty(n), labels=labels)
    return encode_labels(labels)


def _members(codes: np.ndarray) -> list[np.ndarray]:
    order = np.argsort(codes, kind="stable")
    return np.split(order, np.cumsum(np.bincount(codes))[:-1])


# Gives strata that share a cluster the same code.
def _joined(stratum: np.ndarray, cluster: np.ndarray) -> np.ndarray:
    while True:
        of_cluster = np.full(cluster.max() + 1, stratum.max() + 1)
        np.minimum.at(of_cluster, cluster, stratum)
        of_stratum = np.arange(stratum.max() + 1)
        np.minimum.at(of_stratum, stratum, of_cluster[cluster])
        if np.array_equal(of_stratum[stratum], stratum):
            return encode_labels(stratum)
        stratum = of_stratum[stratum]
