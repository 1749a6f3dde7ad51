import math

import numpy as np
import pytest
from scipy import stats

from gslcosim_bench.statistics.pairs import paired_difference, sign_flip

# Heights of cross- and self-fertilised maize, Darwin 1876, differences in eighths of an inch.
DARWIN = np.array([49, -67, 8, 16, 6, 23, 28, 41, 14, 29, 56, 24, 75, 60, -48.0])
NOTHING = np.zeros(15)


def test_sign_flip_of_darwins_maize():
    """Fisher 1935, section 21: 1726 of the 32768 patterns are as far from zero, p 0.0527."""
    assert sign_flip(DARWIN, NOTHING) == pytest.approx(1726 / 32768, abs=0.007)


def test_sign_flip_of_few_pairs_is_exact():
    for n in (2, 5, 12):
        expected = stats.permutation_test(
            (DARWIN[:n],), np.sum, permutation_type="samples", vectorized=False, n_resamples=np.inf
        ).pvalue
        assert sign_flip(DARWIN[:n], NOTHING[:n]) == pytest.approx(expected)


def test_sign_flip_tosses_clusters_as_one():
    """Ten copies of three pairs are three pairs: the least p is 2 / 8."""
    a, b = np.repeat([3.0, 2.0, 1.0], 10), np.zeros(30)
    assert sign_flip(a, b, clusters=np.repeat([0, 1, 2], 10)) == pytest.approx(0.25)
    assert sign_flip(a, b) < 0.001


def test_sign_flip_of_equal_entries():
    assert sign_flip(DARWIN, DARWIN) == 1.0
    assert math.isnan(sign_flip(np.array([]), np.array([])))


def test_paired_difference_is_narrow_where_cases_are_hard_for_both():
    rng = np.random.default_rng(3)
    case = rng.normal(0.0, 100.0, 200)
    a, b = case + rng.normal(5.0, 1.0, 200), case + rng.normal(0.0, 1.0, 200)
    ours = paired_difference(a, b)
    expected = stats.t.interval(0.95, 199, np.mean(a - b), stats.sem(a - b))
    assert (ours.low, ours.high) == pytest.approx(expected, abs=0.03)
    assert ours.value == pytest.approx(np.mean(a - b))
    assert not ours.holds_zero


def test_paired_difference_over_clusters_is_wider():
    a = np.repeat(np.random.default_rng(4).normal(size=25), 8)
    alone, together = (paired_difference(a, 0 * a, clusters=c) for c in (None, np.repeat(np.arange(25), 8)))
    assert together.high - together.low > 2.0 * (alone.high - alone.low)
