"""Several agents' search as a parallel environment of PettingZoo."""

import numpy as np
import pytest
from pettingzoo.test import parallel_api_test, parallel_seed_test

from gslcosim.base.errors import UsageError
from gslcosim.training.parallel_env import parallel_env

SHORT = ("referee.stop.time_limit_s=5",)


@pytest.mark.slow
def test_pettingzoos_tests_pass(capsys):
    parallel_api_test(parallel_env(overrides=SHORT), num_cycles=30)
    parallel_seed_test(lambda: parallel_env(overrides=SHORT, radio_numbers=2), num_cycles=30)


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
