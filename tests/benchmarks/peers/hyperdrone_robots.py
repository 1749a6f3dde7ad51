"""Quadrotors of hyperdrone, with the same motor commands at each step; see robots.py.

python hyperdrone_robots.py --robots 10000
"""

import argparse
from importlib.metadata import version

import numpy as np
from hyperdrone import dynamics
from robots import answer

N_MOTORS, N_STEPS = 4, 10


def main() -> None:
    """Build the robots and answer."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--robots", type=int, required=True)
    options = parser.parse_args()
    sim = dynamics.Sim(options.robots, seed=0, device="cpu")
    sim.reset()
    commands = np.random.default_rng(1).uniform(-0.2, 0.2, (options.robots, N_MOTORS)).astype(np.float32)

    def step() -> float:
        for _ in range(N_STEPS):
            sim.step(commands)
        return options.robots * N_STEPS * sim.dt

    answer(step, f"hyperdrone {version('hyperdrone')}")


if __name__ == "__main__":
    main()
