from itertools import pairwise

import pytest

from gslcosim.base.errors import UsageError
from gslcosim_training.rewards import AgentState, TaskScale, potential, reward_function, sparse

SCALE = TaskScale(diagonal_m=20.0, time_limit_s=100.0, discount=0.9)


def track(*distances_m, outcome):
    last = len(distances_m) - 1
    return [
        AgentState(distance_m=d, time_s=10.0 * i, n_commands=i, outcome=outcome if i == last else None)
        for i, d in enumerate(distances_m)
    ]


def discounted(reward, moments, scale=SCALE):
    steps = pairwise(moments)
    return sum(scale.discount**i * reward(before, after, scale) for i, (before, after) in enumerate(steps))


def test_shaping_adds_the_same_to_every_way_from_the_same_start():
    """What it adds over an episode is the potential of the start alone: no detour pays."""
    without_time = TaskScale(diagonal_m=20.0, time_limit_s=1e30, discount=0.9)
    for moments in (track(8.0, 3.0, 0.5, outcome="success"), track(8.0, 12.0, 9.0, 0.4, outcome="success")):
        added = discounted(potential, moments, without_time) - discounted(sparse, moments, without_time)
        assert added == pytest.approx(8.0 / 20.0)


def test_time_costs_its_share_of_the_limit():
    standing = track(5.0, 5.0, outcome=None)
    assert potential(*standing, SCALE) == pytest.approx(-0.1 - 0.9 * 0.25 + 0.25)


def test_a_time_limit_leaves_the_potential_as_it_is():
    """It cuts a search off: who is far then is not paid for it, as one who ends is."""
    cut_off = track(5.0, 5.0, outcome="time_limit")
    assert potential(*cut_off, SCALE) == potential(*track(5.0, 5.0, outcome=None), SCALE)
    assert potential(*track(5.0, 5.0, outcome="collision"), SCALE) > potential(*cut_off, SCALE)


def test_only_success_is_rewarded_sparsely():
    assert sparse(*track(5.0, 0.5, outcome="success"), SCALE) == 1.0
    assert sparse(*track(5.0, 0.5, outcome="collision"), SCALE) == 0.0


def test_a_reward_is_named_or_is_a_function():
    assert reward_function("sparse") is sparse
    assert reward_function(max) is max
    with pytest.raises(UsageError, match="reward: expected one of sparse, potential, or a function, was 'dense'"):
        reward_function("dense")
