import math

import pytest
from briefings import briefing, observation, open_map

from gslcosim.base.bundled import bundled_agents
from gslcosim.runtime.agents.loader import load_python_agent

START_M = (7.0, 5.0, 2.0)
# All forms, scored from the first stop; with what keeps the simulations of the published one short.
FORMS = {
    "gr_gsl": {},
    "pmfs": {"explore_first": 0},
    "pmfs_published": {"explore_first": 0, "warm_up_steps": 100, "recorded_steps": 50, "refine_frac": 0.02},
}


def searcher(name, *, walls=(), size_m=(15.0, 10.0), **parameters):
    agent_type = load_python_agent(bundled_agents()[name])
    return agent_type(
        briefing(
            sensors=(("pid", "nose"), ("anemometer", "vane")), size_m=(*size_m, 8.0),
            known_map=open_map(size_m, walls=walls), parameters={**FORMS[name], **parameters},
        )
    )  # fmt: skip


def flown(agent, n: int, *, ppm: float = 0.0, wind=(0.4, math.pi)):
    """Commands of a vehicle that goes where it is sent and holds there for 2 s."""
    position_m, commands = START_M, []
    for tick in range(40, 40 + 20 * n):
        asked = tick % 20 == 19
        seen = observation(tick=tick, position_m=position_m, readings={"nose": ppm, "vane": wind}, asked=asked)
        agent.observe(seen)
        if asked:
            commands.append(agent.decide(seen))
            position_m = commands[-1].position_world_m or position_m
    return commands


@pytest.mark.parametrize("motion", ["informed", "likely"])
@pytest.mark.parametrize("wind", [(0.4, 0.0), (0.4, math.pi / 2), (0.0, 0.0)])
def test_in_clean_air_it_explores_most_of_the_room_whatever_the_wind(wind, motion):
    """A room of 10 x 8 m, of which it would see a third when ties were broken by the order of cells."""
    agent = searcher("gr_gsl", size_m=(10.0, 8.0), motion=motion)
    places_m = {START_M[:2], *(c.position_world_m[:2] for c in flown(agent, 60, wind=wind) if c.position_world_m)}
    centres_m = [(x + 0.5, y + 0.5) for x in range(10) for y in range(8)]
    seen = [any(math.dist(centre_m, place_m) < 1.0 for place_m in places_m) for centre_m in centres_m]
    assert sum(seen) > 0.8 * len(seen)


def test_the_most_likely_goal_after_gas_lies_upwind():
    (command,) = flown(searcher("gr_gsl", motion="likely"), 1, ppm=5.0)
    assert command.position_world_m[0] < START_M[0] - 0.5
    assert command.position_world_m[2] == 2.0


def test_it_goes_round_a_wall_and_keeps_its_clearance():
    agent = searcher("gr_gsl", walls=[(5.0, 0.0, 5.5, 7.0)], clearance_m=0.5)
    for command in flown(agent, 12, ppm=5.0):
        if command.kind == "waypoint":
            x_m, y_m, _ = command.position_world_m
            assert math.hypot(max(5.0 - x_m, x_m - 5.5, 0.0), max(y_m - 7.0, 0.0)) >= 0.5


def test_a_place_where_the_sensor_was_not_ready_shows_nothing():
    agent = searcher("pmfs")
    seen = observation(tick=40, readings={"nose": 5.0, "vane": (0.4, math.pi)}, warming=("nose",))
    agent.observe(seen)
    assert agent.decide(seen).kind == "waypoint"
    assert (agent.method.confidence == 0.0).all()


@pytest.mark.parametrize(("name", "more"), [("gr_gsl", {}), ("pmfs", {}), ("pmfs_published", {"stops_per_update": 1})])
def test_solid_cells_hold_no_source(name, more):
    agent = searcher(name, walls=[(3.0, 3.0, 5.0, 5.0)], **more)
    flown(agent, 1, ppm=5.0)
    assert agent.method.p[agent.flights.grid.nearest_cell((4.0, 4.0))] == 0.0


@pytest.mark.parametrize("name", FORMS)
def test_it_declares_once_when_the_belief_is_narrow_and_searches_on(name):
    first, then = flown(searcher(name, declare_variance_m2=100.0), 2)
    assert first.kind == "declare_source"
    assert first.declaration.position_world_m[2] == 2.0
    assert then.kind == "waypoint"
