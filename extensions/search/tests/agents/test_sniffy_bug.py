import math

import numpy as np
import pytest
from briefings import briefing, observation
from toy_swarm import ToySwarm, hill

from gslcosim_agents.sniffy_bug.agent import SniffyBug
from gslcosim_search.swarms.sniffy_bug import TABLES

STARTS = [(2.0, 13.0), (13.0, 13.0), (13.0, 2.0)]
SENSORS = (("pid", "nose"), ("four_range_finders", "around"))
MEMBERS = ("first", "searcher")
RACKS = [(4.0, 6.0, 8.0, 6.5), (9.0, 8.0, 9.5, 12.0)]


def made(**parameters) -> SniffyBug:
    return SniffyBug(briefing(sensors=SENSORS, members=MEMBERS, size_m=(15.0, 15.0, 3.0), parameters=parameters))


def answer(agent, *, ppm=0.0, tick=40, heard=(), ranges_m=(4.0, 4.0, 4.0, 4.0), **changes):
    question = observation(tick=tick, readings={"nose": ppm, "around": ranges_m}, heard=heard, **changes)
    agent.observe(question)
    return agent.decide(question)


@pytest.mark.parametrize("table", TABLES)
def test_it_flies_at_its_speed_and_back_to_its_height(table):
    command = answer(made(table=table, speed_m_s=0.4), position_m=(7.0, 5.0, 1.9))
    x_m_s, y_m_s, z_m_s = command.velocity_world_m_s
    assert math.hypot(x_m_s, y_m_s) == pytest.approx(0.4)
    assert z_m_s == pytest.approx(0.1)
    assert command.hold_s == 0.2


def test_a_waypoint_is_kept_until_its_time():
    agent = made(table="manual")
    answer(agent)
    first = agent.waypoint_m
    answer(agent, tick=100)
    assert agent.waypoint_m is first
    answer(agent, tick=40 + 101)
    assert agent.waypoint_m is not first


def test_a_waypoint_that_is_reached_is_replaced():
    agent = made(table="manual")
    answer(agent)
    x_m, y_m = first = agent.waypoint_m
    answer(agent, tick=42, position_m=(x_m + 0.3, y_m, 2.0))
    assert agent.waypoint_m is not first


def test_a_better_best_of_the_swarm_changes_the_waypoint_at_once():
    """x = (7, 5), p = g = (2, 3): by hand's table wp = x + 0.5 (wp_last - x) + 0.8 (p - x) + 2 (g - x), in the room."""
    agent = made(table="manual", fades_s=0)
    answer(agent)
    last = agent.waypoint_m
    answer(agent, tick=42, heard=[("first", "g 41 200 300 200 4")])
    expected = np.array([7.0, 5.0]) + 0.5 * (last - (7.0, 5.0)) + 2.8 * np.array([-5.0, -2.0])
    assert agent.waypoint_m == pytest.approx(np.clip(expected, 0.5, 14.5), abs=2e-3)
    now = agent.waypoint_m
    answer(agent, tick=44, heard=[("first", "g 43 250 300 200 3 b200 300 200 4")])
    assert agent.waypoint_m is now


@pytest.mark.parametrize("beam", range(4))
def test_it_never_flies_into_what_a_beam_sees_right_before_it(beam):
    ranges_m = [4.0] * 4
    ranges_m[beam] = 0.2
    along = np.array([(1, 0), (0, 1), (-1, 0), (0, -1)][beam])
    for seed in range(5):
        agent = SniffyBug(briefing(sensors=SENSORS, members=MEMBERS, seed=seed))
        for i in range(5):
            velocity = answer(agent, tick=40 + 600 * i, ranges_m=tuple(ranges_m)).velocity_world_m_s
            assert np.array(velocity[:2]) @ along <= 1e-9


@pytest.mark.slow
@pytest.mark.parametrize("table", ["evolved_with_doping", "evolved", "manual"])
def test_three_find_the_gas_among_racks_and_touch_nothing(table):
    swarm = ToySwarm(
        SniffyBug, STARTS, hill(6.0, 9.0, width_m=3.0), solid=RACKS, seed=2, speed_m_s=0.5,
        parameters={"table": table, "declares": False},
    )  # fmt: skip
    top = np.array([6.0, 9.0])
    assert swarm.fly(250.0, lambda swarm: min(np.hypot(*(r.place_m - top)) for r in swarm.robots) < 1.0)
    assert sum(robot.n_blocked for robot in swarm.robots) == 0


def test_a_blocked_velocity_draws_another_waypoint():
    agent = made(table="manual")
    answer(agent, ppm=3.0)
    first = agent.waypoint_m
    answer(agent, ppm=3.0, tick=42, notice="stops before the wall")
    assert agent.waypoint_m is not first
