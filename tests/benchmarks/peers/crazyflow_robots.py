"""Crazyflies of crazyflow, each alone in a world of its own, with a new place to go to each 0.1 s; see robots.py.

python crazyflow_robots.py --dynamics first_principles --robots 1000
"""

import argparse
from importlib.metadata import version

import jax.numpy as jnp
import numpy as np
from crazyflow.sim import Sim
from robots import answer

FREQUENCY_HZ, COMMANDS_HZ = 500, 10
N_NUMBERS = 16
WAIT_FOR = "pos"


def main() -> None:
    """Build the robots and answer."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--dynamics", required=True)
    parser.add_argument("--robots", type=int, required=True)
    options = parser.parse_args()
    sim = Sim(n_worlds=options.robots, n_drones=1, dynamics=options.dynamics, control="state", freq=FREQUENCY_HZ)
    sim.reset()
    commands = np.zeros((options.robots, 1, N_NUMBERS), np.float32)
    commands[..., :3] = np.random.default_rng(1).uniform(-1, 1, (options.robots, 1, 3)) + np.array([0, 0, 1.5])
    commands[..., 12] = 1.0
    given = jnp.asarray(commands)

    def step() -> float:
        sim.state_control(given)
        sim.step(FREQUENCY_HZ // COMMANDS_HZ)
        getattr(sim.data.states, WAIT_FOR).block_until_ready()
        return options.robots / COMMANDS_HZ

    answer(step, f"crazyflow {version('crazyflow')}")


if __name__ == "__main__":
    main()
