import math

import pytest
from briefings import briefing, observation, open_map

from gslcosim.base.bundled import bundled_agents
from gslcosim.runtime.agents.loader import load_python_agent

SENSORS = (("pid", "nose"), ("anemometer", "vane"))
START_M = (7.0, 5.0, 2.0)


# Both forms, with what keeps the simulations of the published one short.
QUICK = {"pmfs": {}, "pmfs_published": {"warm_up_steps": 100, "recorded_steps": 50, "refine_frac": 0.02}}
ALWAYS_SCORED = {"pmfs": {}, "pmfs_published": {"stops_per_update": 1, "explore_first": 0}}
both_forms = pytest.mark.parametrize("name", QUICK)


def searcher(name="pmfs", *, walls=(), sensors=SENSORS, **parameters):
    agent_type = load_python_agent(bundled_agents()[name])
    return agent_type(
        briefing(sensors=sensors, known_map=open_map(walls=walls), parameters={**QUICK[name], **parameters})
    )


def stop_at(agent, tick: int, position_m, *, ppm: float, notice=None, nose="nose", wind=(0.4, math.pi)):
    """Hold at a place for 2 s and be asked."""
    for step in range(20):
        seen = observation(
            tick=tick + step,
            position_m=position_m,
            readings={nose: ppm, "vane": wind},
            asked=step == 19,
            notice=notice if step == 19 else None,
        )
        agent.observe(seen)
    agent.flights.goal_m = None if notice is None else agent.flights.goal_m
    return agent.decide(seen)


def test_a_place_where_the_sensor_was_not_ready_shows_nothing():
    agent = searcher()
    seen = observation(tick=40, readings={"nose": 5.0, "vane": (0.4, math.pi)}, warming=("nose",))
    agent.observe(seen)
    assert agent.decide(seen).kind == "waypoint"
    assert (agent.method.confidence == 0.0).all()


@both_forms
def test_solid_cells_hold_no_source(name):
    agent = searcher(name, walls=[(3.0, 3.0, 5.0, 5.0)], **ALWAYS_SCORED[name])
    stop_at(agent, 40, START_M, ppm=5.0)
    assert agent.method.p[agent.flights.grid.nearest_cell((4.0, 4.0))] == 0.0


@both_forms
def test_it_declares_once_when_the_belief_is_narrow_and_searches_on(name):
    agent = searcher(name, declare_variance_m2=100.0, explore_first=0)
    commands = [stop_at(agent, 40 + 20 * i, START_M, ppm=0.0) for i in range(2)]
    assert [command.kind for command in commands] == ["declare_source", "waypoint"]
