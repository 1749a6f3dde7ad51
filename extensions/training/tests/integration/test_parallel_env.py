"""Several agents' search as a parallel environment of PettingZoo."""

import numpy as np
import pytest
from pettingzoo.test import parallel_api_test

from gslcosim.base.errors import UsageError
from gslcosim_training.parallel_env import parallel_env

SHORT = ("referee.stop.time_limit_s=5",)


@pytest.mark.slow
def test_pettingzoos_tests_pass(capsys):
    parallel_api_test(parallel_env(overrides=SHORT), num_cycles=30)


@pytest.mark.slow
def test_equal_seeds_and_actions_give_equal_episodes():
    """500 steps of all agents over several episodes; PettingZoo's `parallel_seed_test` compares the first only."""
    pair = [parallel_env(overrides=("referee.stop.time_limit_s=60",), radio_numbers=2) for _ in range(2)]
    for env in pair:
        for i, name in enumerate(env.possible_agents):
            env.action_space(name).seed(i)
    n_steps = n_episodes = 0
    while n_steps < 500:
        first, second = (env.reset(seed=7 if not n_episodes else None) for env in pair)
        assert_equal(first, second)
        n_episodes += 1
        while pair[0].agents and n_steps < 500:
            assert pair[0].agents == pair[1].agents
            actions = [{name: env.action_space(name).sample() for name in env.agents} for env in pair]
            assert_equal(*actions)
            first, second = (env.step(action) for env, action in zip(pair, actions, strict=True))
            assert_equal(first, second)
            n_steps += 1
        assert pair[0].agents == pair[1].agents
    assert n_episodes > 1
    observed = [env.reset(seed=seed)[0] for env, seed in zip(pair, (7, 8), strict=True)]
    assert any(not np.array_equal(observed[0][name], observed[1][name]) for name in observed[0])
    for env in pair:
        env.close()


def assert_equal(one, other):
    """Compare what an environment returns, to the bit, and with its types."""
    assert type(one) is type(other)
    if isinstance(one, dict):
        assert list(one) == list(other)
        for key, value in one.items():
            assert_equal(value, other[key])
    elif isinstance(one, (tuple, list)):
        assert len(one) == len(other)
        for a, b in zip(one, other, strict=True):
            assert_equal(a, b)
    else:
        np.testing.assert_array_equal(one, other)


@pytest.mark.slow
def test_agents_receive_from_each_other_and_end_together():
    env = parallel_env(overrides=(*SHORT, "channels[0].loss_frac=0", "channels[0].range_m=30"), radio_numbers=1)
    env.reset(seed=1)
    messages = dict(zip(env.possible_agents, (0.25, 0.5, 0.75), strict=True))
    n_steps = 0
    while env.agents:
        actions = {name: np.array([0.0, 0.0, messages[name]], np.float32) for name in env.agents}
        seen, _, terminated, truncated, infos = env.step(actions)
        n_steps += 1
    assert n_steps == 11
    assert {name: tuple(vector[-2:].tolist()) for name, vector in seen.items()} == {
        "beetle_1": (0.5, 0.75), "beetle_2": (0.25, 0.75), "beetle_3": (0.25, 0.5),
    }  # fmt: skip
    assert all(truncated.values())
    assert not any(terminated.values())
    assert len({info["digest"] for info in infos.values()}) == 1


def test_wrong_arguments_are_reported():
    with pytest.raises(UsageError, match=r"step_s: expected a whole number of ticks of 0\.1 s, was 0\.25 s\."):
        parallel_env(step_s=0.25)
    with pytest.raises(UsageError, match="action: expected a kind with numbers, was 'heading'"):
        parallel_env(action="heading")
    with pytest.raises(UsageError, match="radio_numbers: expected 0 for beetle, which has no channel, was 2"):
        parallel_env(scenario="tiny_room", radio_numbers=2)
