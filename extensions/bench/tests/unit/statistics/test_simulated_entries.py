"""Simulated entries whose truth is known: intervals hold it as often as they say, tests find as much as they should.

A simulated entry finds the source after an exponential time, if that is before the limit; the harder the case, the
longer the mean. Bounds of coverage are 3 standard errors of the simulation around what the method promises, and where a
method is known to promise a little too much, the test says so.
"""

import math

import numpy as np
import pytest
from scipy import stats

from gslcosim_bench.statistics.estimates import bootstrap_mean
from gslcosim_bench.statistics.pairs import paired_difference, sign_flips
from gslcosim_bench.statistics.times import (
    expected_running_time,
    median_time,
)

LIMIT_S = 300.0


def coverage(estimates, truth):
    return np.mean([estimate.low <= truth <= estimate.high for estimate in estimates])


def within_error(share, promised, n, more=0.0):
    """Whether a simulated share is within 3 standard errors of what was promised, or `more` beyond."""
    return abs(share - promised) <= 3.0 * math.sqrt(promised * (1.0 - promised) / n) + more


def fly(rng, mean_s, n):
    """Times and successes of n trials of an entry that needs an exponential time."""
    time_s = rng.exponential(mean_s, n)
    return np.minimum(time_s, LIMIT_S), time_s < LIMIT_S


def true_rmst(mean_s):
    return mean_s * (1.0 - math.exp(-LIMIT_S / mean_s))


@pytest.mark.parametrize("figure", ["median", "ert"])
def test_bootstrapped_times_cover_the_truth(figure):
    rng = np.random.default_rng(4)
    if figure == "median":
        estimates = [median_time(*fly(rng, 200.0, 60), n_draws=400) for _ in range(400)]
        truth = 200.0 * math.log(2.0)
    else:
        estimates = [expected_running_time(*fly(rng, 200.0, 60), n_draws=400) for _ in range(400)]
        truth = 200.0
    assert within_error(coverage(estimates, truth), 0.95, 400, more=0.015)


@pytest.mark.slow
@pytest.mark.parametrize("repetitions", [2, 10])
def test_stratified_bootstrap_covers_the_mean_of_many_cells(repetitions):
    """54 cells, each with its own difficulty; with two repetitions too."""
    rng = np.random.default_rng([5, repetitions])
    mean_s = rng.lognormal(math.log(250.0), 0.8, 54)
    truth = np.mean([true_rmst(mean) for mean in mean_s])
    cells = np.repeat(np.arange(54), repetitions)
    estimates = [
        bootstrap_mean(
            np.minimum(rng.exponential(mean_s[cells]), LIMIT_S), cells, n_draws=200, seed=np.random.default_rng(i)
        )
        for i in range(200)
    ]
    assert within_error(coverage(estimates, truth), 0.95, 200, more=0.005)


@pytest.mark.slow
def test_a_bootstrap_that_knows_of_shared_gas_covers_and_one_that_does_not_falls_short():
    """Nine starts meet the same 30 gases; a gas is good or bad for all of them."""
    rng = np.random.default_rng(7)
    starts, gases = np.tile(np.arange(9), 30), np.repeat(np.arange(30), 9)
    honest, naive = [], []
    for _ in range(400):
        values = rng.normal(0.0, 1.0, 30)[gases] + rng.normal(0.0, 1.0, 270) + 0.2 * starts
        honest.append(bootstrap_mean(values, starts, clusters=gases, n_draws=500))
        naive.append(bootstrap_mean(values, starts, n_draws=500))
    assert within_error(coverage(honest, 0.8), 0.95, 400, more=0.015)
    assert coverage(naive, 0.8) < 0.7


def test_paired_difference_covers_the_truth_and_is_narrower_than_unpaired():
    rng = np.random.default_rng(11)
    estimates, unpaired_width = [], []
    for _ in range(300):
        case = rng.lognormal(math.log(100.0), 1.0, 90)
        a, b = (np.minimum(case * rng.uniform(0.5, 1.5, 90), LIMIT_S) for _ in range(2))
        estimates.append(paired_difference(a, b, n_draws=400))
        unpaired_width.append(2 * 1.96 * math.sqrt((a.var() + b.var()) / 90))
    assert within_error(coverage(estimates, 0.0), 0.95, 300, more=0.01)
    assert np.mean([e.high - e.low for e in estimates]) < 0.6 * np.mean(unpaired_width)


@pytest.mark.parametrize("shift", [0.0, 0.5])
def test_sign_flip_has_the_level_and_the_power_of_students_test(shift):
    """Normal differences, where Student's paired test is the best there is."""
    n, columns = 30, 3000
    differences = np.random.default_rng([15, int(10 * shift)]).normal(shift, 1.0, (n, columns))
    found = np.mean(sign_flips(differences, n_flips=2000) < 0.05)
    freedom, reach = n - 1, stats.t.ppf(0.975, n - 1)
    far = shift * math.sqrt(n)
    expected = stats.nct.sf(reach, freedom, far) + stats.nct.cdf(-reach, freedom, far) if shift else 0.05
    assert within_error(found, expected, columns, more=0.01)
