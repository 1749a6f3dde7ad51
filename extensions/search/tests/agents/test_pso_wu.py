import math

import numpy as np
import pytest
from briefings import briefing, observation

from gslcosim.base.bundled import bundled_agents
from gslcosim.runtime.agents.loader import load_python_agent
from gslcosim_agents.pso_wu.agent import PsoWu

SPso = load_python_agent(bundled_agents()["s_pso"])

MEMBERS = ("first", "searcher")
SENSORS = (("pid", "nose"), ("anemometer", "vane"))
FROM_WEST = (0.5, math.pi)


def made(agent_type=PsoWu, seed=1, **parameters):
    return agent_type(
        briefing(sensors=SENSORS, members=MEMBERS, seed=seed, parameters={"declares": False, **parameters})
    )


def steps(agent, *, wind=FROM_WEST, best="b1200 500 200 9", n=40, start=0) -> np.ndarray:
    """Steps from (7, 5), drawn to a best of the swarm 5 m to the east, downwind."""
    found = []
    for i in range(start, start + n):
        heard = [("first", f"g {39 + 30 * i} 1200 500 200 0 {best}")]
        question = observation(tick=40 + 30 * i, readings={"nose": 0.5, "vane": wind}, heard=heard)
        agent.observe(question.model_copy(update={"tick": 39 + 30 * i, "status": "flying", "incoming": ()}))
        agent.observe(question)
        command = agent.decide(question)
        found.append(np.array(command.position_world_m[:2]) - (7.0, 5.0))
    return np.array(found)


def angles_to_downwind_deg(found: np.ndarray) -> np.ndarray:
    moving = found[np.hypot(*found.T) > 0.05]
    return np.degrees(np.abs(np.arctan2(moving[:, 1], moving[:, 0])))


@pytest.mark.parametrize("forbidden_deg", [60.0, 75.0, 90.0])
def test_variant_one_never_flies_into_the_cone_about_downwind(forbidden_deg):
    assert angles_to_downwind_deg(steps(made(SPso))).min() < 30.0
    angles = angles_to_downwind_deg(steps(made(variant="I", forbidden_deg=forbidden_deg)))
    assert angles.min() >= forbidden_deg - 0.2


def test_variant_two_flies_shorter_downwind_than_upwind():
    downwind = np.hypot(*steps(made(variant="II")).T)
    upwind = np.hypot(*steps(made(variant="II"), wind=(0.5, 0.0)).T)
    assert downwind.mean() < 0.1 * upwind.mean()


def test_calm_air_keeps_the_last_wind_that_had_a_direction():
    agent = made(variant="I")
    steps(agent, n=1)
    assert angles_to_downwind_deg(steps(agent, wind=(0.01, 1.0), start=1)).min() >= 74.8


@pytest.mark.parametrize("variant", ["I", "II"])
def test_without_any_wind_it_is_s_pso(variant):
    assert steps(made(variant=variant), wind=(0.0, 0.0)) == pytest.approx(steps(made(SPso), wind=(0.0, 0.0)))
