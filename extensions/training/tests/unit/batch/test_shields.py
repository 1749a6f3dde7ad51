"""The shield keeps searches off obstacles, in a batch as in single searches, to the bit."""

import numpy as np
import pytest

from gslcosim.base.errors import UsageError
from gslcosim_training.batch import BatchSearchEnv
from gslcosim_training.search_env import SearchEnv
from gslcosim_training.stepped_run import LearningTask

BOXES = "[{name: rack, min_m: [2, 1.5, 0], max_m: [2.5, 3.5, 2]}, {name: shelf, min_m: [3.5, 0, 0], max_m: [4, 2, 2]}]"
SENSORS = (
    "[{model: tgs2600, name: nose}, {model: anemometer, name: wind}, {model: four_range_finders, name: ranges}, "
    "{model: four_range_finders, name: between, mount_rpy_rad: [0, 0, 0.785398]}]"
)
OVERRIDES = (
    f"environment.layout.obstacles={BOXES}",
    f"agents[0].sensors={SENSORS}",
    "agents[0].vehicle={model: holonomic, start_m: [4.9, 3.9, 0.2], search_height_m: 1, hold_s: 0.5}",
    "gas.model=gaussian_plume",
    "gas.sources[0].position_m=[0.7, 0.7, 1]",
    "referee.success.within_m=0.1",
    "referee.stop.time_limit_s=40",
)
SETTINGS = {"action": "velocity", "hold_s": 1.0, "speed_m_s": 0.6}
N_SEARCHES, N_STEPS = 48, 45


def collisions(shield_m):
    """Return how many searches with drawn velocities end by a collision."""
    task = LearningTask(scenario="tiny_room", overrides=OVERRIDES)
    envs = BatchSearchEnv([task.loaded(1)], N_SEARCHES, n_threads=1, shield_m=shield_m, **SETTINGS)
    envs.reset(seed=1)
    rng, drawn, outcomes = np.random.default_rng(3), np.zeros((N_SEARCHES, 2)), [None] * N_SEARCHES
    for step in range(N_STEPS):
        if step % 4 == 0:
            drawn = rng.uniform(-1, 1, (N_SEARCHES, 2)).astype(np.float32)
        *_, infos = envs.step(drawn)
        for i, outcome in enumerate(infos.get("outcome", ())):
            outcomes[i] = outcomes[i] or outcome
    envs.close()
    return outcomes.count("collision")


@pytest.mark.slow
def test_collisions_are_no_longer_the_main_end():
    assert collisions(None) > N_SEARCHES / 2
    assert collisions(0.4) < N_SEARCHES / 10


@pytest.mark.slow
def test_batch_and_single_searches_are_shielded_alike():
    task = LearningTask(scenario="tiny_room", overrides=OVERRIDES)
    batch = BatchSearchEnv([task.loaded(1)], 1, n_threads=1, shield_m=0.4, frame="wind", **SETTINGS)
    env = SearchEnv("tiny_room", overrides=OVERRIDES, shield_m=0.4, frame="wind", **SETTINGS)
    observed, _ = batch.reset(seed=1, options={"cases": np.zeros(1), "seeds": np.array([5])})
    np.testing.assert_array_equal(env.reset(seed=5)[0], observed[0])
    rng = np.random.default_rng(4)
    for step in range(N_STEPS):
        if step % 5 == 0:
            action = rng.uniform(-1, 1, (1, 2)).astype(np.float32)
        observed, rewards, terminated, truncated, _ = batch.step(action)
        seen, reward, *ends, _ = env.step(action[0])
        np.testing.assert_array_equal(seen, observed[0])
        assert (reward, *ends) == (rewards[0], terminated[0], truncated[0])
        if any(ends):
            break
    assert step > 5
    batch.close()
    env.close()


def test_a_shield_without_ranges_is_refused():
    with pytest.raises(UsageError, match="shield_m: expected range finders that look to the sides"):
        SearchEnv("tiny_room", action="velocity", shield_m=0.4)
    with pytest.raises(UsageError, match=r"shield_m: expected none for heading, was 0\.4"):
        BatchSearchEnv([], 1, action="heading", shield_m=0.4)
