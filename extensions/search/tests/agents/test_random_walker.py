import math
from itertools import pairwise

import pytest
from briefings import briefing, observation, open_map

from gslcosim.base.bundled import bundled_agents
from gslcosim.runtime.agents.loader import load_python_agent
from gslcosim_search.occupancy import OccupancyMap

RandomWalker = load_python_agent(bundled_agents()["random_walker"])

HERE_M = (7.0, 5.0, 2.0)


def places_m(walker, n=60, here_m=HERE_M):
    found = []
    for tick in range(n):
        found.append(walker.decide(observation(tick=tick, position_m=here_m)).position_world_m)
        here_m = found[-1]
    return found


def test_legs_have_one_length_and_end_inside_the_margin_at_the_height_of_the_search():
    path_m = [HERE_M, *places_m(RandomWalker(briefing()))]
    assert [math.dist(a, b) for a, b in pairwise(path_m)] == pytest.approx([1.0] * 60, abs=0.002)
    assert all(0.5 <= x <= 14.5 and 0.5 <= y <= 9.5 and z == 2.0 for x, y, z in path_m)


def test_a_known_wall_is_not_flown_through():
    known = open_map(walls=[(7.5, 0.0, 8.0, 10.0)])
    solid, here_m = OccupancyMap.of(known), HERE_M
    for place_m in places_m(RandomWalker(briefing(known_map=known))):
        assert solid.is_free_line(here_m[:2], place_m[:2])
        here_m = place_m


def test_its_legs_and_holds_are_parameters():
    walker = RandomWalker(briefing(parameters={"step_m": 0.5, "hold_s": 0.1, "wall_margin_m": 1.5}))
    command = walker.decide(observation(position_m=HERE_M))
    assert command.hold_s == 0.1
    assert math.dist(command.position_world_m, HERE_M) == pytest.approx(0.5, abs=0.002)
    timed = RandomWalker(briefing(parameters={"leg_s": 3})).decide(observation(position_m=HERE_M))
    assert timed.waypoints[0].after_s == 3.0
