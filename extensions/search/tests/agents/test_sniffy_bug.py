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


def test_the_port_flies_legs_of_half_a_metre():
    agent = made(table="gsl_bench")
    for i in range(30):
        answer(agent, tick=40 + 2 * i)
        assert math.dist(agent.waypoint_m, (7.0, 5.0)) <= 0.5 + 1e-3


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


def test_beams_are_read_in_the_body_frame():
    """Turned by a right angle, its front beam sees what is to the north."""
    agent = made()
    for i in range(10):
        velocity = answer(agent, tick=40 + 600 * i, ranges_m=(0.2, 4.0, 4.0, 4.0), yaw_rad=math.pi / 2)
        assert velocity.velocity_world_m_s[1] <= 1e-9


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


def random_room(seed: int, side_m: float = 10.0):
    """Boxes, a source, three starts away from it, and a plume that the wind carries one way and widens."""
    rng = np.random.default_rng([7, seed])
    boxes = []
    for _ in range(int(rng.integers(2, 6))):
        sides = rng.uniform(0.3, 2.5, 2)
        corner = rng.uniform(1.0, side_m - 1.0 - sides)
        boxes.append((*map(float, corner), *map(float, corner + sides)))

    def free_place():
        while True:
            x, y = rng.uniform(0.8, side_m - 0.8, 2)
            if not any(a - 0.5 <= x <= c + 0.5 and b - 0.5 <= y <= d + 0.5 for a, b, c, d in boxes):
                return np.array([x, y])

    source, starts = free_place(), []
    while len(starts) < 3:
        place = free_place()
        if math.dist(place, source) > 3.0 and all(math.dist(place, other) > 1.0 for other in starts):
            starts.append(place)
    downwind_rad = rng.uniform(0.0, 2.0 * math.pi)
    downwind = np.array([math.cos(downwind_rad), math.sin(downwind_rad)])

    def plume(x, y):
        dx, dy = x - source[0], y - source[1]
        along, across = dx * downwind[0] + dy * downwind[1], downwind[0] * dy - downwind[1] * dx
        width = 0.5 + 0.3 * max(along, 0.0)
        ppm = 30.0 * math.exp(-max(0.0, -along) / 0.5 - across**2 / (2.0 * width**2)) / (0.5 + width)
        return ppm if ppm > 0.1 else 0.0

    return boxes, source, starts, plume


def mean_time_s(table: str, seed: int) -> float:
    """Mean over the three of when each is first within 1.5 m of the source, 100 s where it never is."""
    boxes, source, starts, plume = random_room(seed)
    swarm = ToySwarm(
        SniffyBug, starts, plume, size_m=(10.0, 10.0), solid=boxes, seed=seed, speed_m_s=0.5,
        parameters={"table": table, "declares": False},
    )  # fmt: skip
    arrived_s = dict.fromkeys((robot.name for robot in swarm.robots), 100.0)

    def note(swarm):
        for robot in swarm.robots:
            if math.dist(robot.place_m, source) < 1.5:
                arrived_s[robot.name] = min(arrived_s[robot.name], swarm.time_s)
        return max(arrived_s.values()) < 100.0

    swarm.fly(100.0, note)
    return float(np.mean(list(arrived_s.values())))


@pytest.mark.soak
def test_the_doped_table_is_quicker_than_the_one_by_hand_in_random_rooms():
    times_s = {t: np.mean([mean_time_s(t, seed) for seed in range(100)]) for t in ("evolved_with_doping", "manual")}
    assert times_s["evolved_with_doping"] < times_s["manual"]
