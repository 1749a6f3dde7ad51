import math

import numpy as np
import pytest
from scipy import stats

from gslcosim_bench.statistics.sampling_units import find_sampling_units
from gslcosim_bench.statistics.times import (
    cumulative_success,
    expected_running_time,
    mean_of_successes,
    median_time,
    restricted_mean,
)

LIMIT_S = 300.0


def flights(n=60, seed=0, mean_s=250.0):
    time_s = np.round(np.random.default_rng(seed).exponential(mean_s, n), 0) + 1.0
    return np.minimum(time_s, LIMIT_S), time_s < LIMIT_S


def test_cumulative_success_is_the_share_that_has_reached():
    """Also with a collision after 5 s, which is no trial that might still succeed."""
    time_s, reached = np.array([5.0, 10.0, 20.0, 300.0]), np.array([False, True, True, False])
    curve = cumulative_success(
        time_s, reached, np.array([9.0, 10.0, 25.0, 300.0]), find_sampling_units(*[np.zeros(4)] * 3)
    )
    assert curve.value == pytest.approx([0.0, 0.25, 0.5, 0.5])
    assert np.all(curve.low <= curve.value)
    assert np.all(curve.value <= curve.high)
    assert curve.n == 4


def test_interval_of_the_restricted_mean_has_greenwoods_variance():
    """var = sum_i A_i^2 d_i / (Y_i (Y_i - d_i)), A_i the area right of t_i, for times without ties."""
    time_s = np.array([20.0, 50.0, 70.0, 120.0, 260.0, 300.0, 300.0])
    reached = time_s < LIMIT_S
    searching = 1.0 - np.arange(1, 6) / 7
    areas = np.cumsum((searching * np.diff([*time_s[reached], LIMIT_S]))[::-1])[::-1]
    at_risk = np.arange(7, 2, -1)
    greenwood = np.sum(areas**2 / (at_risk * (at_risk - 1)))
    ours = restricted_mean(time_s, reached, LIMIT_S)
    half_s = stats.t.ppf(0.975, 6) * math.sqrt(greenwood * 7 / 6)
    assert ours.value - ours.low == pytest.approx(half_s)


def test_failures_count_the_limit_whenever_they_ended():
    early = restricted_mean(np.array([5.0, 100.0]), np.array([False, True]), LIMIT_S)
    assert early.value == pytest.approx((300.0 + 100.0) / 2)
    assert restricted_mean(np.array([math.nan, 100.0]), np.array([False, True]), LIMIT_S).value == early.value


def test_a_restricted_mean_without_success_is_not_certain():
    ours = restricted_mean(np.full(90, 300.0), np.zeros(90, dtype=bool), LIMIT_S)
    assert (ours.value, ours.high) == (300.0, 300.0)
    assert ours.low == pytest.approx(300.0 * 0.025 ** (1 / 90))


def test_restricted_mean_over_clusters_is_wider_where_trials_of_a_gas_are_alike():
    time_s, reached = flights(30)
    alone = restricted_mean(time_s, reached, LIMIT_S)
    copies = [np.repeat(array, 4) for array in (time_s, reached)]
    falsely = restricted_mean(*copies, LIMIT_S)
    honestly = restricted_mean(*copies, LIMIT_S, clusters=np.repeat(np.arange(30), 4))
    assert honestly.high - honestly.low == pytest.approx(alone.high - alone.low, rel=0.12)
    assert falsely.high - falsely.low < 0.6 * (alone.high - alone.low)


@pytest.mark.extras
def test_median_agrees_with_lifelines_and_is_infinite_below_half():
    from lifelines import KaplanMeierFitter

    time_s, reached = flights(61, mean_s=150.0)
    ours = median_time(time_s, reached)
    assert ours.value == KaplanMeierFitter().fit(time_s, reached).median_survival_time_
    assert ours.low < ours.value < ours.high
    few = median_time(np.array([1.0, 2, 3, 4, 5]), np.array([True, True, False, False, False]))
    assert few.value == math.inf
    half = median_time(np.array([1.0, 2, 3, 4]), np.array([True, True, False, False]))
    assert half.value == 2.0


def test_expected_running_time_of_a_hand_computed_example():
    """Two successes in 10 + 30 s and a failure of 300 s: 340 / 2."""
    ours = expected_running_time(np.array([10.0, 30.0, 300.0]), np.array([True, True, False]))
    assert ours.value == pytest.approx(170.0)
    assert ours.high == math.inf
    none = expected_running_time(np.array([300.0, 300.0]), np.array([False, False]))
    assert (none.value, none.low, none.high) == (math.inf, math.inf, math.inf)


def test_mean_of_successes_leaves_failures_out():
    ours = mean_of_successes(np.array([10.0, 30.0, 300.0]), np.array([True, True, False]))
    expected = stats.t.interval(0.95, 1, 20.0, stats.sem([10.0, 30.0]))
    assert (ours.value, ours.n) == (20.0, 2)
    assert (ours.low, ours.high) == pytest.approx(expected)
    assert math.isnan(mean_of_successes(np.array([300.0]), np.array([False])).value)


def test_without_trials_all_is_undefined():
    nothing = np.array([]), np.array([], dtype=bool)
    for ours in (restricted_mean(*nothing, LIMIT_S), median_time(*nothing), expected_running_time(*nothing)):
        assert math.isnan(ours.value)
        assert ours.n == 0
