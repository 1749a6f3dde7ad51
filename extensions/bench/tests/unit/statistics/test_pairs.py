import math

import numpy as np
import pytest
from scipy import stats

from gslcosim.base.errors import ShapeError
from gslcosim_bench.statistics.pairs import (
    holm,
    mcnemar,
    mean_ranks,
    paired_difference,
    sign_flip,
)

# Heights of cross- and self-fertilised maize, Darwin 1876, differences in eighths of an inch.
DARWIN = np.array([49, -67, 8, 16, 6, 23, 28, 41, 14, 29, 56, 24, 75, 60, -48.0])
NOTHING = np.zeros(15)


def pairs_of(both, only_a, only_b, none):
    a = np.repeat([True, True, False, False], [both, only_a, only_b, none])
    b = np.repeat([True, False, True, False], [both, only_a, only_b, none])
    return a, b


@pytest.mark.parametrize("table", [(101, 121, 59, 33), (5, 0, 0, 5), (1, 7, 1, 0), (0, 3, 3, 0), (10, 0, 6, 2)])
@pytest.mark.extras
def test_mcnemar_agrees_with_statsmodels(table):
    from statsmodels.stats.contingency_tables import mcnemar as mcnemar_of_statsmodels

    both, only_a, only_b, none = table
    ours = mcnemar(*pairs_of(*table))
    theirs = mcnemar_of_statsmodels([[both, only_a], [only_b, none]], exact=True).pvalue
    assert ours.p == pytest.approx(min(1.0, theirs), rel=1e-12)
    assert (ours.n, ours.only_a, ours.only_b) == (sum(table), only_a, only_b)


def test_mcnemar_of_thousands_of_pairs():
    ours = mcnemar(*pairs_of(0, 2600, 2400, 0))
    assert ours.p == pytest.approx(stats.binomtest(2400, 5000).pvalue, rel=1e-9)


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


def test_sign_flip_is_the_same_each_time():
    a = np.random.default_rng(2).normal(0.2, 1.0, 80)
    assert sign_flip(a, np.zeros(80)) == sign_flip(a, np.zeros(80))


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


def test_what_cannot_be_paired_is_refused():
    with pytest.raises(ShapeError, match="a 2, b 3"):
        paired_difference(np.zeros(2), np.zeros(3))
    with pytest.raises(ShapeError, match="finite"):
        sign_flip(np.array([math.nan]), np.zeros(1))


@pytest.mark.extras
def test_holm_agrees_with_statsmodels():
    from statsmodels.stats.multitest import multipletests

    p = np.array([0.01, 0.04, 0.03, 0.005, 0.5, 0.5, 0.9])
    assert holm(p) == pytest.approx(multipletests(p, method="holm")[1])


def test_holm_of_a_worked_example():
    """Four p values 0.01, 0.04, 0.03, 0.005: times 4, 3, 2, 1 in ascending order, then made to ascend."""
    assert holm([0.01, 0.04, 0.03, 0.005]) == pytest.approx([0.03, 0.06, 0.06, 0.02])


def test_holm_does_not_count_what_could_not_be_tested():
    corrected = holm([0.02, math.nan, 0.01])
    assert corrected[[0, 2]] == pytest.approx([0.02, 0.02])
    assert math.isnan(corrected[1])
    assert holm([]).size == 0


def test_equal_values_share_their_rank():
    values = np.array([3.0, 1.0, 3.0, 2.0, 3.0])
    assert mean_ranks(values) == pytest.approx(stats.rankdata(values))
