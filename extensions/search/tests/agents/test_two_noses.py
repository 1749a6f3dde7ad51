import math

import pytest
from briefings import briefing, observation
from ribbon_world import Cloud, fly

from gslcosim.base.errors import MethodError
from gslcosim_agents.two_noses.agent import TwoNosesAgent

MOUNTS_M = ((0.0, 0.075, 0.0), (0.0, -0.075, 0.0))
PAIR = (("pid", "left", MOUNTS_M[0]), ("pid", "right", MOUNTS_M[1]))


def made(**changes):
    return TwoNosesAgent(briefing(**{"sensors": PAIR, **changes}))


def at(tick, *, left=0.0, right=0.0, place_m=(7.0, 5.0, 2.0), notice=None):
    return observation(tick=tick, position_m=place_m, readings={"left": left, "right": right}, notice=notice)


def test_even_gas_lets_it_step_ahead():
    command = made().decide(at(40, left=1.0, right=1.0))
    assert command.position_world_m == (7.6, 5.0, 2.0)
    assert command.yaw_rad == 0.0


@pytest.mark.parametrize(
    ("left", "right", "degrees"), [(1.2, 1.0, 45), (1.0, 1.2, -45), (9.0, 1.0, 90), (1.0, 9.0, -90)]
)
def test_uneven_gas_turns_it_on_the_spot_and_then_it_steps(left, right, degrees):
    agent = made()
    turned = agent.decide(at(40, left=left, right=right))
    assert turned.kind == "hold"
    assert math.degrees(turned.yaw_rad) == pytest.approx(degrees)
    x_m, y_m, _ = agent.decide(at(60, left=left, right=right)).position_world_m
    assert math.degrees(math.atan2(y_m - 5.0, x_m - 7.0)) == pytest.approx(degrees, abs=0.1)


def test_off_the_plume_it_turns_by_45_degrees_to_the_side_of_the_last_gas_and_steps():
    agent = made()
    agent.decide(at(40, left=1.2, right=1.0))
    x_m, y_m, _ = agent.decide(at(80)).position_world_m
    assert math.degrees(math.atan2(y_m - 5.0, x_m - 7.0)) == pytest.approx(90.0, abs=0.1)


def test_without_gas_for_long_it_explores_looking_where_it_flies():
    agent = made(parameters={"give_up_steps": 2})
    agent.decide(at(40, left=1.0, right=1.0))
    agent.decide(at(80))
    command = agent.decide(at(120))
    x_m, y_m, _ = command.position_world_m
    assert math.hypot(x_m - 7.0, y_m - 5.0) != pytest.approx(0.6, abs=0.01)
    assert command.yaw_rad == pytest.approx(math.atan2(y_m - 5.0, x_m - 7.0))


def test_one_nose_is_too_few():
    with pytest.raises(MethodError, match="at least 2"):
        made(sensors=PAIR[:1])


def test_near_a_source_in_still_air_it_finds_it_from_most_places():
    starts = [(4.0, 5.0, 2.0), (3.5, 3.0, 2.0), (3.5, 7.0, 2.0), (5.0, 4.0, 2.0)]
    found = [
        fly(TwoNosesAgent, Cloud(half_m=1.5), mounts_m=MOUNTS_M, has_vane=False, start_m=start_m, limit_s=200.0).found_s
        for start_m in starts
    ]
    assert sum(time_s is not None for time_s in found) >= 3
