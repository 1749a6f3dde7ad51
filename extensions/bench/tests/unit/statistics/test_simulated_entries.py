"""Simulated entries whose truth is known: intervals hold it as often as they say, tests find as much as they should.

A simulated entry finds the source after an exponential time, if that is before the limit; the harder the case, the
longer the mean. Bounds of coverage are 3 standard errors of the simulation around what the method promises, and where a
method is known to promise a little too much, the test says so.
"""

import math

import numpy as np
import pytest
from scipy import stats

from gslcosim_bench.statistics.aggregates import bootstrap_cells
from gslcosim_bench.statistics.estimates import bootstrap_mean
from gslcosim_bench.statistics.pairs import paired_difference, sign_flips
from gslcosim_bench.statistics.rates import lift, wilson
from gslcosim_bench.statistics.roc import roc
from gslcosim_bench.statistics.sampling_units import find_sampling_units
from gslcosim_bench.statistics.times import (
    cumulative_success,
    expected_running_time,
    median_time,
    restricted_mean,
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


def single(n):
    """Units of n flights, each for itself."""
    return find_sampling_units(*[np.zeros(n)] * 3)


def true_rmst(mean_s):
    return mean_s * (1.0 - math.exp(-LIMIT_S / mean_s))


def exact_coverage(interval, n, p):
    counts = np.arange(n + 1)
    ends = [interval(int(k), n) for k in counts]
    holds = np.array([[end.low <= rate <= end.high for end in ends] for rate in p])
    return (holds * stats.binom.pmf(counts, n, p[:, None])).sum(axis=1)


@pytest.mark.parametrize("n", [10, 90])
def test_wilson_covers_95_percent_on_average(n):
    """Summed over all outcomes, so without error of simulation."""
    p = np.linspace(0.005, 0.995, 199)
    shown = exact_coverage(wilson, n, p)
    assert shown.mean() == pytest.approx(0.95, abs=0.01)
    assert shown.min() > 0.83


@pytest.mark.parametrize("mean_s", [100.0, 400.0, 1500.0])
@pytest.mark.parametrize("n", [20, 90])
def test_restricted_mean_covers_the_truth(n, mean_s):
    """With few successes among 20 the distribution is skewed: up to 4 points less."""
    rng = np.random.default_rng([n, int(mean_s)])
    estimates = [restricted_mean(*fly(rng, mean_s, n), LIMIT_S) for _ in range(600)]
    assert within_error(coverage(estimates, true_rmst(mean_s)), 0.95, 600, more=0.04 if n == 20 else 0.005)


def test_the_band_of_the_success_curve_covers_the_truth():
    rng = np.random.default_rng(3)
    at_s = np.array([50.0, 150.0, 290.0])
    truth = 1.0 - np.exp(-at_s / 200.0)
    curves = [cumulative_success(*fly(rng, 200.0, 60), at_s, single(60)) for _ in range(1000)]
    holds = np.mean([(curve.low <= truth) & (truth <= curve.high) for curve in curves], axis=0)
    assert all(within_error(share, 0.95, 1000, more=0.01) for share in holds)


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


@pytest.mark.slow
def test_rates_of_cells_cover_their_mean():
    rng = np.random.default_rng(8)
    p = rng.beta(1.0, 2.0, 54)
    cells = np.repeat(np.arange(54), 5)
    estimates = [bootstrap_cells(rng.random(270) < p[cells], cells, strata=cells, n_draws=200) for _ in range(150)]
    assert within_error(coverage(estimates, p.mean()), 0.95, 150, more=0.005)


@pytest.mark.parametrize(("p_success", "p_luck"), [(0.6, 0.2), (0.95, 0.15), (0.2, 0.2)])
@pytest.mark.parametrize("paired", [True, False])
def test_lift_covers_the_truth(p_success, p_luck, paired):
    """Paired: in half of the cases one toss decides both, as a start next to the source does."""
    rng = np.random.default_rng([9, int(100 * p_success), paired])
    n = 60
    estimates = []
    for _ in range(800):
        is_shared, common = (rng.random(n) < 0.5) & paired, rng.random(n)
        success, luck = (np.where(is_shared, common, rng.random(n)) < p for p in (p_success, p_luck))
        estimates.append(lift(success, luck, paired=paired))
    share = coverage(estimates, p_success - p_luck)
    assert within_error(share, 0.95, 800, more=0.015)


def test_area_of_the_roc_covers_the_truth():
    """Normal confidences one standard deviation apart: the area is Phi(1 / sqrt 2)."""
    rng = np.random.default_rng(10)
    is_positive = np.repeat([True, False], [40, 30])
    areas = [roc(rng.normal(size=70) + is_positive, is_positive).area for _ in range(600)]
    assert within_error(coverage(areas, stats.norm.cdf(1 / math.sqrt(2))), 0.95, 600, more=0.01)


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
