import math

import pytest
from briefings import briefing, observation, open_map

from gslcosim.base.bundled import bundled_agents
from gslcosim.runtime.agents.loader import load_python_agent

GrGslAgent = load_python_agent(bundled_agents()["gr_gsl"])

SENSORS = (("pid", "nose"), ("anemometer", "vane"))
START_M = (7.0, 5.0, 2.0)


def searcher(*, seed: int = 1, walls=(), **parameters):
    known = open_map(walls=walls)
    return GrGslAgent(briefing(sensors=SENSORS, seed=seed, known_map=known, parameters=parameters))


def flown(agent, n: int, *, ppm_at=lambda _: 0.0, wind=(0.4, math.pi), refused=()):
    """Commands of a vehicle that goes where it is sent and holds there for 2 s, but for the refused questions."""
    position_m, tick, commands, notice = START_M, 40, [], None
    for i in range(n):
        for step in range(20):
            seen = observation(
                tick=tick + step,
                position_m=position_m,
                readings={"nose": ppm_at(position_m), "vane": wind},
                asked=step == 19,
                notice=notice if step == 19 else None,
            )
            agent.observe(seen)
        commands.append(agent.decide(seen))
        tick += 20
        notice = "expected a free place" if i in refused else None
        if commands[-1].kind == "waypoint" and notice is None:
            position_m = commands[-1].position_world_m
    return commands


@pytest.mark.parametrize("motion", ["informed", "likely"])
@pytest.mark.parametrize("wind", [(0.4, 0.0), (0.4, math.pi / 2), (0.0, 0.0)])
def test_in_clean_air_it_explores_most_of_the_room_whatever_the_wind(wind, motion):
    """A room of 10 x 8 m, of which it would see a third when ties were broken by the order of cells."""
    known = open_map(size_m=(10.0, 8.0))
    agent = GrGslAgent(
        briefing(sensors=SENSORS, seed=1, size_m=(10.0, 8.0, 3.0), known_map=known, parameters={"motion": motion})
    )
    places_m = {START_M[:2], *(c.position_world_m[:2] for c in flown(agent, 60, wind=wind) if c.position_world_m)}
    centres_m = [(x + 0.5, y + 0.5) for x in range(10) for y in range(8)]
    seen = [any(math.dist(centre_m, place_m) < 1.0 for place_m in places_m) for centre_m in centres_m]
    assert sum(seen) > 0.8 * len(seen)


def test_the_most_likely_goal_after_gas_lies_upwind():
    command = flown(searcher(motion="likely"), 1, ppm_at=lambda _: 5.0)[0]
    assert command.position_world_m[0] < START_M[0] - 0.5
    assert command.position_world_m[2] == 2.0


def test_it_goes_round_a_wall_and_keeps_its_clearance():
    agent = searcher(walls=[(5.0, 0.0, 5.5, 7.0)], clearance_m=0.5)
    for command in flown(agent, 12, ppm_at=lambda _: 5.0):
        if command.kind == "waypoint":
            x_m, y_m, _ = command.position_world_m
            outside_m = math.hypot(max(5.0 - x_m, x_m - 5.5, 0.0), max(y_m - 7.0, 0.0))
            assert outside_m >= 0.5


def test_it_declares_once_when_the_belief_is_narrow_and_searches_on():
    agent = searcher(declare_variance_m2=100.0)
    commands = flown(agent, 3, wind=(0.0, 0.0))
    assert commands[0].kind == "declare_source"
    assert commands[0].declaration.position_world_m[2] == 2.0
    assert [command.kind for command in commands[1:]] == ["waypoint", "waypoint"]
