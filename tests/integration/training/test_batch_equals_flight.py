"""Searches of a batch are single flights with the same case, seed and actions, to the bit."""

import numpy as np
import pytest

pytest.importorskip("gymnasium", reason="extra gym")

from gslcosim.errors import UsageError
from gslcosim.training.batch import BatchSearchEnv
from gslcosim.training.learning_task import LearningTask
from gslcosim.training.search_env import SearchEnv

FIGURES = ("distance_to_source_m", "path_length_m", "n_commands", "time_s")
BALL = ("agents[0].vehicle.model=holonomic", "agents[0].vehicle.avoidance=none", "gas.model=gaussian_plume")
# A search is flown thrice in a batch: at the beginning, in the middle and at the end.
COPIES = 3


def drawn_actions(space, rng, n, drift):
    """Return n actions."""
    numbers = rng.uniform(-1, 1, (n, *space.shape)) + np.resize(drift, space.shape)
    return np.clip(numbers, -1, 1).astype(np.float32)


def assert_equal_flights(scenario, overrides, seeds, *, drift=(0.0, 0.0), n_threads=2, most_steps=400, **settings):
    """Fly each seed alone and in a batch; return the outcomes."""
    settings = {"action": "velocity", **settings}
    task = LearningTask(scenario=scenario, overrides=overrides)
    n = len(seeds)
    batch = BatchSearchEnv([task.loaded(s) for s in seeds], n * COPIES, n_threads=n_threads, **settings)
    alone = [SearchEnv(scenario, overrides=overrides, **settings) for _ in seeds]
    chosen = {"cases": np.tile(np.arange(n), COPIES), "seeds": np.tile(seeds, COPIES)}
    observations, infos = batch.reset(seed=1, options=chosen)
    for i, (env, seed) in enumerate(zip(alone, seeds, strict=True)):
        observation, info = env.reset(seed=seed)
        for j in range(i, n * COPIES, n):
            assert np.array_equal(observations[j], observation), batch.observation_names
            assert {key: infos[key][j] for key in FIGURES} == {key: info[key] for key in FIGURES}
    rng = np.random.default_rng(5)
    outcomes = [None] * n
    for _ in range(most_steps):
        actions = drawn_actions(batch.single_action_space, rng, n, drift)
        observations, rewards, terminated, truncated, infos = batch.step(np.concatenate([actions] * COPIES))
        for i, env in enumerate(alone):
            if outcomes[i] is not None:
                continue
            observation, reward, is_terminated, is_truncated, info = env.step(actions[i])
            for j in range(i, n * COPIES, n):
                assert np.array_equal(observations[j], observation), (j, info)
                assert (rewards[j], terminated[j], truncated[j]) == (reward, is_terminated, is_truncated)
                assert {key: infos[key][j] for key in FIGURES} == {key: info[key] for key in FIGURES}
                if is_terminated or is_truncated:
                    assert (infos["outcome"][j], infos["success"][j]) == (info["outcome"], info["success"])
                    outcomes[i] = info["outcome"]
        if all(outcomes):
            break
    batch.close()
    for env in alone:
        env.close()
    return outcomes


@pytest.mark.slow
@pytest.mark.tour
def test_velocities_on_request_are_those_of_single_flights():
    overrides = (*BALL, "referee.stop.time_limit_s=15")
    outcomes = assert_equal_flights("tiny_room", overrides, [1, 2, 3], hold_s=0.5)
    assert outcomes == ["time_limit"] * 3
    found = assert_equal_flights("tiny_room", BALL, [1, 2], hold_s=0.5, speed_m_s=0.5, drift=(-0.5, -0.05), n_threads=1)
    assert found == ["success"] * 2


@pytest.mark.slow
def test_velocities_at_every_tick_are_those_of_single_flights():
    overrides = (*BALL, "referee.stop.time_limit_s=8", "agents[0].mode=lockstep")
    assert assert_equal_flights("tiny_room", overrides, [4, 5]) == ["time_limit"] * 2


@pytest.mark.parametrize(
    ("override", "sentence"),
    [
        ("agents[0].vehicle.model=iris", "agents[0].vehicle.model: expected holonomic in a batch, was iris."),
        ("agents[0].vehicle.avoidance=2d", "agents[0].vehicle.avoidance: expected none in a batch, was 2d."),
        ("referee.stop.on_collision=false", "referee.stop.on_collision: expected true in a batch, was false."),
    ],
)
def test_what_cannot_be_batched_is_told_in_one_sentence(override, sentence):
    task = LearningTask(scenario="tiny_room", overrides=(*BALL, override))
    with pytest.raises(UsageError) as caught:
        BatchSearchEnv([task.loaded(1)], 2)
    assert sentence in str(caught.value)
    assert "Change it, or fly single environments of gslcosim/Search-v0." in str(caught.value)
