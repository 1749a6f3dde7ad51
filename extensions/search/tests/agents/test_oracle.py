from briefings import briefing, observation, open_map

from gslcosim_agents.oracle.agent import Oracle
from gslcosim_search.occupancy import OccupancyMap

NEAR_M, FAR_M, START_M = (5.0, 2.0, 1.0), (12.0, 9.0, 3.0), (3.0, 3.0, 2.0)


def oracle(*sources_m, **changes) -> Oracle:
    return Oracle(briefing(sensors=[("pid", "nose")], known_sources=sources_m or (NEAR_M,), **changes))


def bends_of_m(command):
    return [place.position_world_m for place in command.waypoints]


def test_it_flies_straight_to_the_source_and_declares_it_exactly():
    agent = oracle()
    assert bends_of_m(agent.decide(observation(position_m=START_M))) == [NEAR_M]
    declared = agent.decide(observation(position_m=NEAR_M))
    assert declared.declaration.position_world_m == NEAR_M
    assert declared.declaration.confidence == 1.0
    assert agent.decide(observation(position_m=NEAR_M)).kind == "hold"


def test_the_nearer_of_two_sources_is_first_and_both_are_declared():
    agent = oracle(FAR_M, NEAR_M)
    seen = [agent.decide(observation(position_m=place_m)) for place_m in (START_M, NEAR_M, NEAR_M, FAR_M)]
    assert [command.kind for command in seen] == ["mission", "declare_source", "mission", "declare_source"]
    assert bends_of_m(seen[2]) == [FAR_M]


def test_with_a_map_it_goes_around_what_is_in_the_way():
    known = open_map(walls=[(7.0, 0.0, 7.5, 7.0)])
    agent, here_m = oracle((11.0, 2.0, 2.0), known_map=known), START_M
    for place_m in bends_of_m(agent.decide(observation(position_m=START_M))):
        assert OccupancyMap.of(known, clearance_m=0.25).is_free_line(here_m[:2], place_m[:2])
        here_m = place_m
    assert here_m == (11.0, 2.0, 2.0)


def test_a_refused_way_ends_farther_from_the_floor_then_at_its_height_then_it_declares_from_here():
    agent = oracle((5.0, 2.0, 0.1))
    refused = observation(position_m=START_M, notice="waypoints[0]: expected z within 0.38 to 7.62 m, was 0.1 m")
    assert bends_of_m(agent.decide(observation(position_m=START_M))) == [(5.0, 2.0, 0.1)]
    assert bends_of_m(agent.decide(refused)) == [(5.0, 2.0, 0.4)]
    assert bends_of_m(agent.decide(refused)) == [(5.0, 2.0, 2.0)]
    assert agent.decide(refused).declaration.position_world_m == (5.0, 2.0, 0.1)


def test_a_notice_where_it_wanted_to_go_is_no_reason_to_go_on():
    agent = oracle()
    agent.decide(observation(position_m=START_M))
    assert (
        agent.decide(observation(position_m=(5.0, 2.0, 1.3), notice="moved to a free place")).kind == "declare_source"
    )
