import numpy as np
import pytest
from scipy import stats

from gslcosim.base.errors import UsageError
from gslcosim.bench.statistics.rates import n_for_power, n_pairs_for_power


@pytest.mark.parametrize(("p1", "p2", "n"), [(0.15, 0.21, 640), (0.5, 0.6, 390), (0.15, 0.3, 120), (0.2, 0.4, 81)])
def test_sizes_by_which_suites_are_planned(p1, p2, n):
    assert n_for_power(p1, p2) == pytest.approx(n, rel=0.015)
    assert n_for_power(p2, p1) == n_for_power(p1, p2)


def test_the_example_of_power_prop_test():
    """R: power.prop.test(p1 = .50, p2 = .75, power = .90) gives n = 76.7."""
    assert n_for_power(0.5, 0.75, power=0.9) == 77


@pytest.mark.parametrize(("only_a", "only_b"), [(0.2, 0.1), (0.3, 0.05), (0.12, 0.06)])
def test_pairs_have_the_power_that_was_asked_for(only_a, only_b):
    """Power of McNemar's test without continuity correction, summed over all outcomes; it finds more in few pairs."""
    n = n_pairs_for_power(only_a, only_b)
    one = np.arange(n + 1)[:, None]
    a = np.arange(n + 1)[None, :]
    chance = stats.binom.pmf(one, n, only_a + only_b) * stats.binom.pmf(a, one, only_a / (only_a + only_b))
    z = np.abs(2 * a - one) / np.sqrt(np.maximum(one, 1))
    assert chance[(z > 1.96) & (a <= one)].sum() == pytest.approx(0.8, abs=0.04)


def test_pairing_saves_trials_where_entries_fail_in_the_same_cases():
    """50 and 60 %: 388 unpaired, fewer if the outcomes agree in 80 % of the cases."""
    assert n_pairs_for_power(0.15, 0.05) < 0.5 * n_for_power(0.5, 0.6)


def test_rates_that_cannot_be_distinguished_are_refused():
    with pytest.raises(UsageError, match="two different ones"):
        n_for_power(0.3, 0.3)
    with pytest.raises(UsageError, match="sum of at most 1"):
        n_pairs_for_power(0.7, 0.6)
