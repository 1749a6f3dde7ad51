"""Numbers from the bits of observations are normal, apart from each other, and the same for one row and for many."""

import math

import numpy as np
import pytest
from policies import HEADING, NAMES, VELOCITY, gru, seen

from gslcosim_search.learned.policy import PolicyError, normal_numbers
from gslcosim_search.learned.recurrent_networks import GruPolicy


def test_the_numbers_are_normal_and_apart_from_each_other():
    numbers = normal_numbers(seen(50_000, 1)[0], 3).astype(np.float64)
    assert np.abs(numbers.mean(axis=0)).max() < 0.02
    assert np.abs(np.cov(numbers.T) - np.eye(3)).max() < 0.02
    for limit in (-2.0, -1.0, 0.0, 1.0, 2.0):
        expected = 0.5 * (1 + math.erf(limit / math.sqrt(2)))
        assert abs((numbers < limit).mean() - expected) < 0.005


def test_the_last_bit_of_one_number_changes_all_of_them():
    (observation,) = seen(1, 1)[0]
    other = observation.copy()
    other[2] = np.nextafter(other[2], np.float32(1.0))
    first, second = (normal_numbers(one[None, :], 2)[0] for one in (observation, other))
    assert np.abs(first - second).min() > 1e-3
    assert np.array_equal(normal_numbers(np.stack([other, observation]), 2), np.stack([second, first]))


def spread_of(spread, action=VELOCITY):
    return GruPolicy.of_arrays(NAMES, action, gru(action).arrays, {"spread": spread})


def test_a_policy_with_a_spread_scatters_around_its_mean_and_remembers_the_same():
    mean, scattered, (observed,) = spread_of(0.0), spread_of(0.3), seen(20_000, 1)
    outputs, _ = mean.outputs(observed, mean.memory(len(observed)))
    actions, memory = scattered.act(observed, scattered.memory(len(observed)))
    assert np.std(np.arctanh(actions.astype(np.float64)) - outputs) == pytest.approx(0.3, rel=0.02)
    assert np.array_equal(memory, mean.act(observed, mean.memory(len(observed)))[1])


def test_a_wrong_spread_is_reported():
    with pytest.raises(PolicyError, match=r"settings\.spread: expected a number from 0, was -1"):
        spread_of(-1)
    with pytest.raises(PolicyError, match=r"settings\.spread: expected 0 for action heading, which has choices"):
        spread_of(0.5, HEADING)
