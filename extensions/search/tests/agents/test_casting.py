import math
from itertools import pairwise

import pytest
from stops_in_wind import at, flown, made

from gslcosim_agents.casting.agent import Casting


def test_in_the_plume_it_keeps_to_one_angle_to_upwind():
    places = [(7.0, 5.0, 2.0), *flown(made(Casting, parameters={"beta_deg": 20.0}), [1.0, 1.0, 1.0])]
    steps = [(b[0] - a[0], b[1] - a[1]) for a, b in pairwise(places)]
    angles = [math.degrees(math.atan2(y, -x)) for x, y in steps]
    assert [math.hypot(*step) for step in steps] == pytest.approx([1.0] * 3, abs=0.002)
    assert angles == pytest.approx([math.copysign(20.0, angles[0])] * 3, abs=0.2)


def test_past_the_edge_it_goes_back_across_and_then_aslant_to_the_other_side():
    agent = made(Casting, parameters={"lost_m": 1.0, "cast_m": 1.5})
    places = flown(agent, [1.0, 0.0])
    side = math.copysign(1.0, places[0][1] - 5.0)
    assert places[1][0] == pytest.approx(places[0][0], abs=0.001)
    assert places[1][1] - places[0][1] == pytest.approx(-side * 1.5, abs=0.001)
    back_m = agent.decide(at(200, places[1], ppm=1.0)).position_world_m
    assert back_m[0] < places[1][0]
    assert math.copysign(1.0, back_m[1] - places[1][1]) == -side


def test_a_cast_that_meets_nothing_grows_and_ends_in_new_places():
    places = flown(made(Casting, parameters={"lost_m": 1.0, "n_returns": 0, "n_casts": 2}), [1.0] + [0.0] * 12)
    assert math.dist(places[1], places[2]) == pytest.approx(3.0, abs=0.002)
    assert len(set(places)) == len(places)
