import math

import pytest
import stops_in_wind
from stops_in_wind import at, flown

from gslcosim_agents.surge_cast.agent import SurgeCast


def made(**changes):
    return stops_in_wind.made(SurgeCast, **changes)


def test_gas_sends_it_a_step_upwind():
    assert flown(made(), [1.0, 1.0]) == [(6.0, 5.0, 2.0), (5.0, 5.0, 2.0)]


def test_it_goes_on_upwind_until_the_plume_counts_as_lost_and_then_casts_d_2d_3d_across():
    places = flown(made(parameters={"lost_m": 1.5}), [1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    assert places[:2] == [(6.0, 5.0, 2.0), (5.5, 5.0, 2.0)]
    turns_m = [y_m - 5.0 for _, y_m, _ in places[2:6]]
    side = math.copysign(1.0, turns_m[0])
    assert turns_m == pytest.approx([side * 0.75, -side * 0.75, side * 1.5, -side * 1.5])
    assert all(x_m == 5.5 for x_m, _, _ in places[2:6])


def test_after_the_cast_it_goes_back_to_the_last_gas_and_casts_there():
    places = flown(made(parameters={"lost_m": 1.0, "n_casts": 1}), [1.0, 0.0, 0.0])
    assert places[1][0] == 6.0
    assert places[2][0] == 7.0


def test_a_cast_keeps_the_wind_with_which_it_began():
    agent = made(parameters={"lost_m": 1.0})
    agent.decide(at(40, ppm=1.0))
    first = agent.decide(at(80, (6.0, 5.0, 2.0)))
    second = agent.decide(at(120, first.position_world_m, upwind_rad=0.5))
    assert first.position_world_m[0] == second.position_world_m[0] == 6.0


def test_gas_on_the_way_is_gone_back_to_sideways():
    agent = made(parameters={"lost_m": 1.0})
    agent.decide(at(40, ppm=1.0))
    agent.decide(at(80, (6.0, 5.0, 2.0)))
    agent.observe(at(90, (6.0, 5.4, 2.0), ppm=1.0, status="flying"))
    assert agent.decide(at(120, (6.0, 5.75, 2.0))).position_world_m == (5.0, 5.4, 2.0)


def test_the_last_blank_decides_how_long_it_waits():
    agent = made(parameters={"lost_by": "last_blank", "least_memory_s": 1.0})
    agent.observe(at(10, ppm=1.0))
    agent.observe(at(60, ppm=1.0))  # a blank of 5 s
    agent.decide(at(70))
    assert agent.decide(at(100, (6.0, 5.0, 2.0))).position_world_m == (5.0, 5.0, 2.0)
    x_m, y_m, _ = agent.decide(at(120, (5.0, 5.0, 2.0))).position_world_m
    assert (x_m, abs(y_m - 5.0)) == (5.0, 0.75)


def test_it_may_explore_at_random_nearby():
    (place_m,) = flown(made(parameters={"explore": "random"}), [0.0])
    assert max(abs(place_m[0] - 7.0), abs(place_m[1] - 5.0)) <= 0.5


def test_asked_at_every_tick_it_lets_a_leg_end_but_breaks_off_a_cast_for_gas():
    agent = made(mode="lockstep", parameters={"lost_m": 1.0})
    agent.decide(at(40, ppm=1.0))
    assert agent.decide(at(45, (6.5, 5.0, 2.0), status="flying")).kind == "noop"
    agent.decide(at(46, (6.0, 5.0, 2.0)))
    agent.decide(at(80, (6.0, 5.0, 2.0)))
    assert agent.decide(at(85, (6.0, 5.3, 2.0), status="flying")).kind == "noop"
    assert agent.decide(at(86, (6.0, 5.4, 2.0), ppm=1.0, status="flying")).kind == "waypoint"
