"""Wind frames of a batch are those of single searches, to the bit."""

import numpy as np
import pytest

from gslcosim_search.learned.wind_frame import WIND_FRAME_NAMES
from gslcosim_training.batch import BatchSearchEnv
from gslcosim_training.search_env import SearchEnv
from gslcosim_training.stepped_run import LearningTask

OVERRIDES = ("agents[0].vehicle.model=holonomic", "gas.model=gaussian_plume", "referee.stop.time_limit_s=6")
SETTINGS = {"action": "velocity", "hold_s": 0.5, "speed_m_s": 0.6, "frame": "wind"}


@pytest.mark.slow
def test_batch_and_single_searches_see_and_fly_the_same_in_the_wind_frame():
    seeds = (3, 4)
    task = LearningTask(scenario="tiny_room", overrides=OVERRIDES)
    batch = BatchSearchEnv([task.loaded(seed) for seed in seeds], 2, n_threads=1, **SETTINGS)
    observed, _ = batch.reset(seed=1, options={"cases": np.arange(2), "seeds": np.array(seeds)})
    assert batch.observation_names[-len(WIND_FRAME_NAMES) :] == WIND_FRAME_NAMES
    singles = [SearchEnv("tiny_room", overrides=OVERRIDES, **SETTINGS) for _ in seeds]
    assert singles[0].observation_names == batch.observation_names
    for env, seed, row in zip(singles, seeds, observed, strict=True):
        np.testing.assert_array_equal(env.reset(seed=seed)[0], row)
    rng, is_over = np.random.default_rng(2), [False, False]
    while not all(is_over):
        actions = rng.uniform(-1, 1, (2, 2)).astype(np.float32)
        observed, rewards, terminated, truncated, _ = batch.step(actions)
        for i, env in enumerate(singles):
            if not is_over[i]:
                seen, reward, *ends, _ = env.step(actions[i])
                np.testing.assert_array_equal(seen, observed[i])
                assert (reward, *ends) == (rewards[i], terminated[i], truncated[i])
                is_over[i] = any(ends)
    # A search that begins again has forgotten its winds and bouts.
    observed, *_ = batch.step(np.zeros((2, 2), np.float32))
    assert (observed[:, -5:-2] <= 1.0).all()
    assert batch.bytes_per_env > BatchSearchEnv([task.loaded(3)], 1, action="velocity", n_threads=1).bytes_per_env
    batch.close()
    for env in singles:
        env.close()


def test_a_frame_that_fits_no_action_is_refused():
    with pytest.raises(Exception, match="frame: expected world for heading, was wind"):
        BatchSearchEnv([], 1, action="heading", frame="wind")
