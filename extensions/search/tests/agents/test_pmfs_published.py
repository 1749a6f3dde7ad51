import math

import pytest
from briefings import briefing, observation, open_map

from gslcosim.base.errors import MethodError
from gslcosim_agents.pmfs_published.agent import PublishedPmfsAgent
from gslcosim_search.beliefs import mass_within

SENSORS = (("pid", "nose"), ("anemometer", "vane"))
START_M = (7.0, 5.0, 2.0)


def searcher(*, seed: int = 1, walls=(), **parameters) -> PublishedPmfsAgent:
    given = {"warm_up_steps": 100, "recorded_steps": 50, "refine_frac": 0.02, **parameters}
    return PublishedPmfsAgent(briefing(sensors=SENSORS, seed=seed, known_map=open_map(walls=walls), parameters=given))


def stop_at(agent: PublishedPmfsAgent, tick: int, position_m, *, ppm: float, notice=None, wind=(0.4, math.pi)):
    """Hold at a place for 2 s and be asked."""
    for step in range(20):
        seen = observation(
            tick=tick + step,
            position_m=position_m,
            readings={"nose": ppm, "vane": wind},
            asked=step == 19,
            notice=notice if step == 19 else None,
        )
        agent.observe(seen)
    agent.flights.goal_m = None if notice is None else agent.flights.goal_m
    return agent.decide(seen)


def test_sources_are_scored_every_few_stops_only():
    agent = searcher(stops_per_update=2, explore_first=2)
    beliefs = []
    for i in range(4):
        stop_at(agent, 40 + 20 * i, (7.0 + 0.5 * i, 5.0, 2.0), ppm=5.0)
        beliefs.append(agent.method.p.copy())
    is_even = [belief[belief > 0].max() == pytest.approx(belief[belief > 0].min()) for belief in beliefs]
    assert is_even == [True, False, False, False]
    assert (beliefs[1] == beliefs[2]).all()
    assert (beliefs[2] != beliefs[3]).any()


def test_gas_downwind_and_clean_air_around_move_the_belief_upwind_of_the_gas():
    agent = searcher(stops_per_update=8, warm_up_steps=300, recorded_steps=150)
    tick = 40
    for x_m, y_m, ppm in ((9, 5, 5), (7, 5, 5), (5, 5, 5), (2, 5, 0), (7, 7, 0), (7, 3, 0), (4, 7, 0), (4, 3, 0)):
        stop_at(agent, tick, (float(x_m), float(y_m), 2.0), ppm=float(ppm))
        tick += 20
    assert mass_within(agent.method.p, agent.flights.grid, (3.5, 5.0), 1.75) > 0.6


def test_a_refused_goal_is_given_up():
    agent = searcher()
    first = stop_at(agent, 40, START_M, ppm=0.0)
    second = stop_at(agent, 60, START_M, ppm=0.0, notice="expected a free place")
    assert first.position_world_m != second.position_world_m


def test_equal_seeds_give_equal_decisions():
    first, second = (stop_at(searcher(seed=4, stops_per_update=1, explore_first=0), 40, START_M, ppm=1.0) for _ in "ab")
    assert first == second


def test_solid_cells_hold_no_source():
    agent = searcher(walls=[(3.0, 3.0, 5.0, 5.0)], stops_per_update=1, explore_first=0)
    stop_at(agent, 40, START_M, ppm=5.0)
    assert agent.method.p[agent.flights.grid.nearest_cell((4.0, 4.0))] == 0.0


def test_it_declares_once_when_the_belief_is_narrow_and_searches_on():
    agent = searcher(declare_variance_m2=100.0)
    commands = [stop_at(agent, 40 + 20 * i, START_M, ppm=0.0) for i in range(2)]
    assert [command.kind for command in commands] == ["declare_source", "waypoint"]


def test_without_a_map_it_says_what_to_do():
    with pytest.raises(MethodError, match="map: true"):
        PublishedPmfsAgent(briefing(sensors=SENSORS))
