"""A batch of gslcosim's searches, with random velocities each second; see robots.py.

python gslcosim_robots.py --vehicle iris --flying rigid_body --gas filament --robots 10000
"""

import argparse
from importlib.metadata import version

import numpy as np
from robots import answer

from gslcosim_training.batch import BatchSearchEnv
from gslcosim_training.stepped_run import LearningTask

SCENARIO, N_CASES, HOLD_S = "warehouse_racks", 4, 1.0
N_ACTIONS = 64


def main() -> None:
    """Build the batch and answer."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--vehicle", required=True)
    parser.add_argument("--flying", required=True)
    parser.add_argument("--gas", required=True)
    parser.add_argument("--robots", type=int, required=True)
    options = parser.parse_args()
    overrides = (
        f"agents[0].vehicle.model={options.vehicle}",
        "agents[0].vehicle.avoidance=none",
        "referee.stop.time_limit_s=100",
        f"gas.model={options.gas}",
    )
    task = LearningTask(scenario=SCENARIO, overrides=overrides)
    cases = [task.loaded(seed) for seed in range(N_CASES)]
    tick_s = cases[0].scenario.tick_ns / 1e9
    batch = BatchSearchEnv(cases, options.robots, hold_s=HOLD_S, flying=options.flying, n_threads=1)
    batch.reset(seed=1)
    actions = np.random.default_rng(1).uniform(-1, 1, (N_ACTIONS, *batch.action_space.shape)).astype(np.float32)
    n_steps = 0

    def step() -> float:
        nonlocal n_steps
        before = batch.n_ticks
        batch.step(actions[n_steps % N_ACTIONS])
        n_steps += 1
        return (batch.n_ticks - before) * tick_s

    answer(step, f"gslcosim {version('gslcosim')}")


if __name__ == "__main__":
    main()
