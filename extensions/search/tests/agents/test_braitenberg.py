import math

import pytest
from briefings import briefing, observation

from gslcosim_agents.braitenberg.agent import Braitenberg

SENSORS = [("pid", "left", (0.0, 0.2, 0.0)), ("pid", "right", (0.0, -0.2, 0.0))]
MIDDLE_M = (7.0, 5.0, 2.0)


def vehicle(sensors=SENSORS, **parameters) -> Braitenberg:
    return Braitenberg(
        briefing(sensors=sensors, parameters={"declares": False, "speed_m_s": 0.4, "gain": 0.9, **parameters})
    )


def decide(agent, left, right, *, position_m=MIDDLE_M, yaw_rad=0.0, **changes):
    readings = {"left": left, "right": right}
    return agent.decide(observation(position_m=position_m, yaw_rad=yaw_rad, readings=readings, **changes))


def speed_m_s(command):
    return math.hypot(*command.velocity_world_m_s[:2])


def test_in_clean_air_it_flies_straight_on_at_full_speed():
    command = decide(vehicle(), 0.0, 0.0, yaw_rad=0.7)
    assert command.kind == "velocity"
    assert (speed_m_s(command), command.yaw_rad, command.hold_s) == pytest.approx((0.4, 0.7, 0.5))
    x_m_s, y_m_s, z_m_s = command.velocity_world_m_s
    assert math.atan2(y_m_s, x_m_s) == pytest.approx(0.7)
    assert z_m_s == 0.0


@pytest.mark.parametrize(("wiring", "side"), [("straight", 1), ("crossed", -1)])
def test_it_turns_to_more_gas_on_its_left_or_crossed_away_from_it(wiring, side):
    command = decide(vehicle(wiring=wiring), 10.0, 5.0)
    # x is 1 and 0.5: wheels 0.04 and 0.22 m/s, 0.4 m apart, for half a second.
    assert command.yaw_rad == pytest.approx(side * 0.225)
    assert speed_m_s(command) == pytest.approx(0.13)


@pytest.mark.parametrize(("ranges", "turn_rad"), [("shared", 0.45), ("own", 0.0)])
def test_the_first_gas_of_all_turns_it_where_the_noses_share_their_range(ranges, turn_rad):
    assert decide(vehicle(ranges=ranges), 10.0, 5.0).yaw_rad == pytest.approx(0.5 * turn_rad)


def test_noses_of_two_kinds_have_ranges_of_their_own():
    agent = vehicle([("tgs2600", "left", (0.0, 0.2, 0.0)), ("pid", "right", (0.0, -0.2, 0.0))])
    decide(agent, 5e4, 0.0)
    assert decide(agent, 1e4, 100.0).yaw_rad == pytest.approx(0.0)


@pytest.mark.parametrize("seed", range(3))
def test_before_a_wall_it_turns_round(seed):
    agent = Braitenberg(briefing(sensors=SENSORS, seed=seed))
    command = decide(agent, 0.0, 0.0, position_m=(14.0, 5.0, 2.0))
    ahead_m = 0.5 + 0.8 * 0.5
    assert 14.0 + ahead_m * math.cos(command.yaw_rad) <= 14.301
    assert -math.pi <= command.yaw_rad <= math.pi


def test_it_comes_back_to_its_height():
    assert decide(vehicle(), 0.0, 0.0, position_m=(7.0, 5.0, 2.4)).velocity_world_m_s[2] == pytest.approx(-0.2)
