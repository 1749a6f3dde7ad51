"""Searches of batches beside single ones, in a family of cases.

The only module of the freeze that imports parts of the framework, by the names that docs/train.md has.
"""

import json
import warnings
from typing import Any

import gymnasium
import numpy as np
from commands import hash_of, hash_of_fields

import gslcosim_training  # noqa: F401 - registers the environments
from gslcosim_training.batch import BatchSearchEnv
from gslcosim_training.family import load_family
from gslcosim_training.stepped_run import LearningTask

FIGURES = ("distance_to_source_m", "path_length_m", "n_commands", "time_s")
N_STEPS = 60
SETTINGS = {"action": "velocity", "hold_s": 1.0}


def batch_and_single(family_name: str, n_cases: int, overrides: tuple[str, ...]) -> dict[str, str]:
    """Run cases of a family with drawn actions in a batch and one by one.

    Returns:
        Hashes of what the batch saw, and whether single searches are equal to it, to the bit.
    """
    warnings.simplefilter("ignore")
    family = load_family(family_name)
    tasks = [_task(family, i, overrides) for i in range(n_cases)]
    seeds = [family.spec.seeds.training.first + i for i in range(n_cases)]
    batch = BatchSearchEnv([task.loaded(seed) for task, seed in zip(tasks, seeds, strict=True)], n_cases, **SETTINGS)
    actions = np.random.default_rng(5).uniform(-1, 1, (N_STEPS, *batch.action_space.shape)).astype(np.float32)
    observations, infos = batch.reset(seed=1, options={"cases": np.arange(n_cases), "seeds": np.array(seeds)})
    seen = [[(observations[i].tobytes(), _figures(infos, i))] for i in range(n_cases)]
    is_over = [False] * n_cases
    for action in actions:
        observations, rewards, terminated, truncated, infos = batch.step(action)
        for i in range(n_cases):
            if not is_over[i]:
                ends = bool(terminated[i]), bool(truncated[i])
                seen[i].append((observations[i].tobytes(), _figures(infos, i), float(rewards[i]), *ends))
                is_over[i] = any(ends)
    batch.close()
    alone = [_single(task, seed, actions[:, i]) for i, (task, seed) in enumerate(zip(tasks, seeds, strict=True))]
    return {
        "batch": hash_of_fields([[hash_of(step[0]), *step[1:]] for search in seen for step in search]),
        "steps": " ".join(str(len(search) - 1) for search in seen),
        "single searches are equal": " ".join(str(a == b) for a, b in zip(alone, seen, strict=True)),
    }


def _task(family: Any, i: int, overrides: tuple[str, ...]) -> LearningTask:
    drawn = tuple(f"{path}={json.dumps(value)}" for path, value in family.values_of("training", i).items())
    return LearningTask(scenario=family.scenario, overrides=(*drawn, *overrides))


def _single(task: LearningTask, seed: int, actions: Any) -> list[Any]:
    env = gymnasium.make("gslcosim/Search-v0", scenario=task.scenario, overrides=task.overrides, **SETTINGS).unwrapped
    observation, info = env.reset(seed=seed)
    seen: list[Any] = [(observation.tobytes(), _figures(info, None))]
    for action in actions:
        observation, reward, terminated, truncated, info = env.step(action)
        seen.append((observation.tobytes(), _figures(info, None), float(reward), bool(terminated), bool(truncated)))
        if terminated or truncated:
            break
    env.close()
    return seen


def _figures(infos: dict[str, Any], i: int | None) -> list[float]:
    return [float(infos[name] if i is None else infos[name][i]) for name in FIGURES]
