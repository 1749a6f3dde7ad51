import math
from itertools import pairwise

import pytest
from briefings import briefing, observation

from gslcosim_agents.gradient.agent import Gradient

SOURCE_M = (11.0, 5.0)
SENSORS = [("pid", "nose")]


def searcher(**changes) -> Gradient:
    return Gradient(briefing(**{"sensors": SENSORS, **changes}))


def flown_m(agent: Gradient, gas, n=25, here_m=(4.0, 5.0, 2.0)):
    """Places of its stops in a gas that does not change, a stop every 4 s."""
    found = [here_m]
    for i in range(n):
        seen = observation(tick=40 * (i + 1), position_m=found[-1], readings={"nose": gas(found[-1])})
        command = agent.decide(seen)
        if command.position_world_m is not None:
            found.append(command.position_world_m)
    return found


def bump(place_m):
    return 30.0 * math.exp(-math.dist(place_m[:2], SOURCE_M) / 3.0)


def test_it_climbs_a_smooth_hill():
    path_m = flown_m(searcher(), bump)
    assert min(math.dist(place_m[:2], SOURCE_M) for place_m in path_m) < 0.8
    assert max(math.dist(place_m[:2], SOURCE_M) for place_m in path_m[-6:]) < 3.0


def test_on_a_plane_it_goes_off_the_slope_to_either_side_in_turn():
    path_m = flown_m(searcher(parameters={"off_rad": 0.35, "declares": False}), lambda place_m: 5.0 + place_m[0], n=12)
    headings = [math.atan2(b[1] - a[1], b[0] - a[0]) for a, b in pairwise(path_m)]
    assert [abs(heading) for heading in headings[4:9]] == pytest.approx([0.35] * 5, abs=0.01)
    assert all(a * b < 0.0 for a, b in pairwise(headings[4:9]))


def test_with_four_noses_one_stop_is_enough():
    mounts = [(0.3, 0.3), (0.3, -0.3), (-0.3, 0.3), (-0.3, -0.3)]
    sensors = [("pid", f"nose{i}", (*mount, 0.0)) for i, mount in enumerate(mounts)]
    agent = searcher(sensors=sensors, parameters={"off_rad": 0.0})
    # The vehicle looks to +y: its left is -x.
    readings = {f"nose{i}": 5.0 - y_m for i, (_, y_m) in enumerate(mounts)}
    x_m, y_m, _ = agent.decide(
        observation(position_m=(7.0, 5.0, 2.0), yaw_rad=math.pi / 2, readings=readings)
    ).position_world_m
    assert (x_m, y_m) == pytest.approx((8.0, 5.0), abs=0.002)
