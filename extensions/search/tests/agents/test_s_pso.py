import math

import numpy as np
import pytest
from toy_swarm import ToySwarm, hill

from gslcosim.base.bundled import bundled_agents
from gslcosim.runtime.agents.loader import load_python_agent

SPso = load_python_agent(bundled_agents()["s_pso"])


CORNERS = [(2.0, 13.0), (13.0, 13.0), (13.0, 2.0), (12.0, 8.0), (2.0, 9.0)]
TOP_M = (5.0, 4.0)


def best_of(swarm: ToySwarm):
    bests = [robot.agent.own_best for robot in swarm.robots]
    return max((best for best in bests if best is not None), key=lambda best: best.amount)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
def test_five_find_the_top_of_a_static_hill(seed):
    swarm = ToySwarm(SPso, CORNERS, hill(*TOP_M), seed=seed, parameters={"fades_s": 0, "declares": False})
    assert swarm.fly(150.0, lambda swarm: swarm.tick % 50 == 0 and math.dist(best_of(swarm).place_m, TOP_M) < 0.3)


@pytest.mark.slow
def test_texts_that_get_lost_do_not_keep_the_swarm_from_the_top():
    parameters = {"fades_s": 0, "declares": False}
    swarm = ToySwarm(SPso, CORNERS, hill(*TOP_M), seed=1, parameters=parameters, loss_frac=0.5)
    assert swarm.fly(200.0, lambda swarm: swarm.tick % 50 == 0 and math.dist(best_of(swarm).place_m, TOP_M) < 0.5)


def test_robots_keep_apart_in_a_crowd():
    """Five at one place drive each other apart: nobody stays within the distance of repulsion of all others."""
    around = [(7.0 + 0.3 * math.cos(k), 7.0 + 0.3 * math.sin(k)) for k in range(5)]
    swarm = ToySwarm(SPso, around, hill(7.0, 7.0), parameters={"declares": False})
    swarm.fly(12.0)
    places = np.array([robot.place_m for robot in swarm.robots])
    gaps = [min(np.hypot(*(a - b)) for j, b in enumerate(places) if j != i) for i, a in enumerate(places)]
    assert max(gaps) > 0.9
