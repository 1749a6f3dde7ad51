"""A figure with its interval and its number of trials, and the draws behind bootstrap intervals."""

import math
from dataclasses import dataclass

import numpy as np

from gslcosim.benchmark.statistics.special import normal_tail, student_quantile
from gslcosim.errors import ShapeError

LEVEL = 0.95
"""Confidence level of every interval unless another is asked for."""

SEED = 20_231
"""Seed of all draws unless another is given: a report made twice from the same rows is the same to the bit."""

N_DRAWS = 2000
"""Bootstrap samples unless another number is asked for: the ends of a 95 % interval then stand on 50 draws each."""

Seed = int | np.random.Generator
"""A seed, or a generator to go on drawing from."""


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

    @property
    def holds_zero(self) -> bool:
        """Whether zero is within the interval, its ends included: there may be no difference. True if undefined."""
        return not (self.low > 0.0 or self.high < 0.0)


UNDEFINED = Estimate(math.nan, math.nan, math.nan, 0)
"""What nothing can be said about."""


def generator_of(seed: Seed) -> np.random.Generator:
    """Return the generator itself, or a new one from a seed."""
    return seed if isinstance(seed, np.random.Generator) else np.random.default_rng(seed)


def percentile_interval(draws: np.ndarray, level: float = LEVEL, freedom: int | None = None) -> tuple[float, float]:
    """Return the ends of the expanded percentile bootstrap interval.

    They leave Phi(-t) of the draws on each side, t Student's quantile: what 0.025 of Student's distribution is in the
    normal one. So few trials get the wider interval that they deserve; with many it is the plain percentile interval.
    The ends are values that were drawn, never something between two of them, so infinite draws are allowed.

    Args:
        draws: (n_draws,) the statistic of each bootstrap sample; nan (undefined in that sample) is left out.
        level: Confidence level, 0 to 1.
        freedom: Degrees of freedom of the spread; 0: nothing is known of it, so no interval. None: endless.

    Source:
        Hesterberg 2015, What teachers should know about the bootstrap, doi:10.1080/00031305.2015.1089789;
        its factor sqrt(n / (n - 1)) is not needed with draws of one less than there are.
    """
    known = np.sort(draws[~np.isnan(draws)])
    if known.size == 0 or freedom == 0:
        return math.nan, math.nan
    share = (1.0 - level) / 2.0 if freedom is None else normal_tail(student_quantile(0.5 + level / 2.0, freedom))
    tail = math.floor(share * known.size)
    return float(known[tail]), float(known[known.size - 1 - tail])


def numbers(values: np.ndarray, name: str) -> np.ndarray:
    """Return one row of finite numbers as floats.

    Raises:
        ShapeError: more than one dimension, or a value that is not finite.
    """
    array = np.asarray(values, dtype=np.float64)
    if array.ndim != 1:
        raise ShapeError(f"{name}: expected one dimension, had {array.ndim}. Give one value per trial.")
    n_bad = int(np.count_nonzero(~np.isfinite(array)))
    if n_bad:
        raise ShapeError(f"{name}: expected finite numbers, {n_bad} of {array.size} are not. Leave these trials out.")
    return array


def check_same_length(**arrays: np.ndarray) -> None:
    """Raise unless all arrays have one entry per trial.

    Raises:
        ShapeError: the first dimensions differ.
    """
    lengths = {name: len(array) for name, array in arrays.items()}
    if len(set(lengths.values())) > 1:
        listed = ", ".join(f"{name} {length}" for name, length in lengths.items())
        raise ShapeError(f"expected arrays of one length, had {listed}. Give one value per trial in each.")
