import math

import pytest

from gslcosim_search.reactive.reactive_searcher import LossPoints

WEST_RAD = math.pi  # the wind comes from -x, the source is where x is least


def detections(places, *, n=3, spread_m=1.0, upwind_rad=WEST_RAD):
    found = LossPoints(n=n, spread_m=spread_m)
    for place in places:
        found.add(place, upwind_rad)
    return found


def test_only_the_places_farthest_upwind_are_kept():
    found = detections([(9.0, 5.0, 2.0), (4.0, 5.0, 2.0), (2.0, 5.0, 2.0), (6.0, 5.0, 2.0), (3.0, 5.0, 2.0)])
    assert [place[0] for place in found.places_m] == [2.0, 3.0, 4.0]


def test_the_source_is_declared_farthest_upwind_once_the_places_draw_together():
    places = [(9.0, 5.0, 2.0), (2.4, 5.1, 2.0), (2.0, 5.0, 2.0), (2.9, 4.8, 2.0)]
    assert detections(places[:3]).estimate(WEST_RAD) is None
    estimate = detections(places).estimate(WEST_RAD)
    assert estimate is not None
    assert estimate.position_m == (2.0, 5.0, 2.0)
    assert estimate.confidence == 1.0


def test_places_far_apart_across_the_wind_are_less_sure():
    estimate = detections([(2.0, 5.0, 2.0), (2.1, 9.0, 2.0), (2.2, 1.0, 2.0)]).estimate(WEST_RAD)
    assert estimate is not None
    assert estimate.confidence == pytest.approx(1 / 3)


def test_too_few_places_or_a_spread_as_long_as_allowed_declare_nothing():
    assert detections([(2.0, 5.0, 2.0), (2.0, 5.0, 2.0)]).estimate(WEST_RAD) is None
    assert detections([(2.0, 5.0, 2.0), (2.0, 5.0, 2.0), (3.0, 5.0, 2.0)]).estimate(WEST_RAD) is None


@pytest.mark.parametrize("turn_rad", [0.5, 2.0, -1.3])
def test_the_rule_turns_with_the_wind(turn_rad):
    places = [(2.0, 5.0, 2.0), (2.4, 5.1, 2.0), (2.9, 4.8, 2.0)]
    c, s = math.cos(turn_rad), math.sin(turn_rad)
    turned = [(c * x - s * y, s * x + c * y, z) for x, y, z in places]
    estimate = detections(turned, upwind_rad=WEST_RAD + turn_rad).estimate(WEST_RAD + turn_rad)
    assert estimate is not None
    assert estimate.position_m == turned[0]
