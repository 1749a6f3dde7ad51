import itertools
import math

import pytest
import stops_in_wind
from stops_in_wind import START_M, flown

from gslcosim_agents.surge_spiral.agent import SurgeSpiral


def made(**changes):
    return stops_in_wind.made(SurgeSpiral, **changes)


def test_gas_sends_it_a_step_upwind():
    assert flown(made(), [1.0, 1.0]) == [(6.0, 5.0, 2.0), (5.0, 5.0, 2.0)]


def test_without_gas_it_winds_outwards_around_the_place_of_loss():
    places = flown(made(parameters={"lost_m": 1.0, "reach_m": 1.5}), [1.0] + [0.0] * 14)
    away_m = [math.dist(place, places[0]) for place in places[1:]]
    assert away_m == sorted(away_m)
    steps_m = [math.dist(a, b) for a, b in itertools.pairwise(places)]
    assert max(steps_m) <= 0.75 + 0.001


def test_after_the_spiral_it_winds_out_from_the_last_gas_and_then_explores():
    parameters = {"lost_m": 1.0, "shape": "square", "n_sides": 1}
    places = flown(made(parameters=parameters), [1.0] + [0.0] * 3)
    assert math.dist(places[1], (6.0, 5.0, 2.0)) == pytest.approx(1.0)
    assert math.dist(places[2], START_M) == pytest.approx(1.0)
    assert places[3] not in places[:3]


def test_in_a_corner_it_stays_inside_the_margin():
    places = flown(made(parameters={"lost_m": 1.0}), [1.0] + [0.0] * 30, place_m=(1.6, 0.6, 2.0))
    assert all(0.5 <= x <= 14.5 and 0.5 <= y <= 9.5 for x, y, _ in places)
