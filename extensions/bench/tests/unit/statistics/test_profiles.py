import math

import numpy as np
import pytest

from gslcosim.base.errors import ShapeError
from gslcosim_bench.statistics.rates import wilson
from gslcosim_bench.statistics.sampling_units import find_sampling_units
from gslcosim_bench.statistics.times import performance_profile, runtime_distribution

TAU = np.array([1.0, 2.0, 5.0, 10.0])


def single(n):
    """Units of n flights, each for itself."""
    return find_sampling_units(*[np.zeros(n)] * 3)


def test_profile_of_a_hand_computed_example():
    """Four scenarios, once as fast as the oracle, once twice as slow, once eight times, once never."""
    ours = performance_profile(
        np.array([10.0, 40.0, 80.0, math.inf]), np.array([10.0, 20.0, 10.0, 5.0]), TAU, single(4)
    )
    assert list(ours.at) == [1, 2, 5, 10]
    assert ours.value == pytest.approx([0.25, 0.5, 0.5, 0.75])
    assert (ours.low[1], ours.high[1]) == pytest.approx((wilson(2, 4).low, wilson(2, 4).high))
    assert ours.n == 4


def test_a_profile_of_no_scenario_is_undefined():
    assert np.all(np.isnan(performance_profile(np.array([]), np.array([]), TAU, find_sampling_units([], [], [])).value))


def test_runtime_distribution_of_a_hand_computed_example():
    """Two trials, targets of 5 m and 1 m: three of four were met, at 10, 20 and 30 s."""
    times_s = np.array([[10.0, 30.0], [20.0, math.inf]])
    ours = runtime_distribution(times_s, np.array([5.0, 10.0, 25.0, 300.0]))
    assert ours.value == pytest.approx([0.0, 0.25, 0.5, 0.75])
    assert (ours.low[-1], ours.high[-1]) == (0.5, 1.0)
    assert ours.n == 2


def test_runtime_distribution_does_not_take_targets_of_a_trial_for_trials():
    """The same column four times gives the same band."""
    times_s = np.random.default_rng(1).exponential(100.0, (40, 1))
    at_s = np.array([50.0, 100.0])
    one, four = runtime_distribution(times_s, at_s), runtime_distribution(np.repeat(times_s, 4, axis=1), at_s)
    assert four.low == pytest.approx(one.low)
    assert four.high == pytest.approx(one.high)


def test_runtime_distribution_of_nothing():
    assert np.isnan(runtime_distribution(np.empty((0, 3)), np.array([1.0])).value[0])
    with pytest.raises(ShapeError, match="trials in rows"):
        runtime_distribution(np.zeros(3), np.array([1.0]))
