import math
from itertools import pairwise

import pytest
from briefings import briefing, observation, open_map

from gslcosim.base.bundled import bundled_agents
from gslcosim.runtime.agents.loader import load_python_agent
from gslcosim_search.occupancy import OccupancyMap

RandomWalker = load_python_agent(bundled_agents()["random_walker"])
HERE_M = (7.0, 5.0, 2.0)
LevyWalker = load_python_agent(bundled_agents()["levy_walk"])
PersistentWalk = load_python_agent(bundled_agents()["persistent_walk"])


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


def lengths_m(n=300, **parameters):
    walker, here_m, found = LevyWalker(briefing(parameters=parameters)), HERE_M, []
    for _ in range(n):
        end_m = walker.decide(observation(position_m=here_m)).position_world_m
        found.append(math.dist(here_m, end_m))
        here_m = end_m
    return found


def test_a_larger_exponent_means_shorter_legs():
    assert sum(lengths_m(exponent=1.2)) > 1.3 * sum(lengths_m(exponent=3.0))


def headings_rad(n=200, *, notice=None, **parameters):
    """Headings of its first n legs, all from the middle of the room."""
    walker = PersistentWalk(briefing(parameters=parameters))
    ends_m = [walker.decide(observation(position_m=HERE_M, notice=notice)).position_world_m for _ in range(n)]
    return [math.atan2(y_m - HERE_M[1], x_m - HERE_M[0]) for x_m, y_m, _ in ends_m]


def share_kept(headings):
    return sum(a == b for a, b in pairwise(headings)) / (len(headings) - 1)


@pytest.mark.parametrize("persistence", [0.0, 0.5, 0.9])
def test_it_keeps_its_heading_with_the_chance_that_it_is_given(persistence):
    error = 3.0 * math.sqrt(persistence * (1.0 - persistence) / 199)
    assert share_kept(headings_rad(persistence=persistence)) == pytest.approx(persistence, abs=error + 1e-9)
