import math
from itertools import pairwise

import pytest
from briefings import briefing, observation, open_map

from gslcosim_agents.sweep.agent import Sweep
from gslcosim_search.occupancy import OccupancyMap

START_M = (3.0, 3.0, 2.0)


def bends_m(command):
    """Where a mission rests."""
    return [place.position_world_m for place in command.waypoints if not any(place.velocity_world_m_s)]


def sweep(**parameters) -> Sweep:
    return Sweep(briefing(parameters=parameters))


def test_it_flies_all_lanes_in_one_mission_from_the_nearest_corner_without_holds():
    command = sweep().decide(observation(position_m=START_M))
    assert command.kind == "mission"
    assert bends_m(command)[0] == (0.5, 0.5, 2.0)
    assert len(bends_m(command)) == 12  # lanes of 14 m, 9 m of them 1.8 m apart
    assert {place.hold_s for place in command.waypoints} == {0.0}


def test_places_between_the_bends_are_passed_along_the_lane_at_speed():
    command = sweep(speed_m_s=0.8).decide(observation(position_m=START_M))
    here_m, n_passed = START_M, 0
    for place, after in pairwise(command.waypoints):
        if any(place.velocity_world_m_s):
            n_passed += 1
            assert math.hypot(*place.velocity_world_m_s) == pytest.approx(0.8)
            step_m = [b - a for a, b in zip(here_m, after.position_world_m)]
            cosine = sum(v * d for v, d in zip(place.velocity_world_m_s, step_m)) / 0.8 / math.hypot(*step_m)
            assert cosine == pytest.approx(1.0)
        here_m = place.position_world_m
    assert n_passed > 10


def test_what_it_has_been_to_is_not_flown_again_and_then_it_starts_again():
    agent = sweep()
    places_m = bends_m(agent.decide(observation(position_m=START_M)))
    for place_m in places_m[:5]:
        agent.observe(observation(position_m=place_m, asked=False))
    assert bends_m(agent.decide(observation(position_m=places_m[4]))) == places_m[5:]
    for place_m in places_m[5:]:
        agent.observe(observation(position_m=place_m, asked=False))
    assert bends_m(agent.decide(observation(position_m=places_m[-1])))[0] == places_m[-1]


def test_after_refusals_it_rests_at_bends_then_flies_them_one_by_one_and_leaves_out_the_refused():
    agent, seen = sweep(), observation(position_m=START_M)
    refused = observation(position_m=START_M, notice="waypoints[3]: expected a free place")
    places_m = bends_m(agent.decide(seen))
    second = agent.decide(refused)
    assert [place.position_world_m for place in second.waypoints] == places_m
    third = agent.decide(refused)
    assert (third.kind, third.position_world_m) == ("waypoint", places_m[0])
    assert agent.decide(refused).position_world_m == places_m[1]
    assert agent.decide(seen).position_world_m == places_m[1]


def test_known_solids_are_left_out():
    known = open_map(walls=[(0.0, 0.0, 2.0, 2.0)])
    command = Sweep(briefing(known_map=known)).decide(observation(position_m=START_M))
    assert not any(OccupancyMap.of(known).is_solid(place_m) for place_m in bends_m(command))
    assert len(bends_m(command)) == 11
