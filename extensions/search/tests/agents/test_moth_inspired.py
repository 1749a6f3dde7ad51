import itertools
import math

import pytest
import stops_in_wind
from stops_in_wind import START_M, WEST_RAD, flown

from gslcosim_agents.moth_inspired.agent import MothInspired


def made(**changes):
    return stops_in_wind.made(MothInspired, **changes)


def turns_deg(places):
    """Angle of each leg to upwind, positive to the left."""
    return [
        math.degrees(math.remainder(math.atan2(b[1] - a[1], b[0] - a[0]) - WEST_RAD, math.tau))
        for a, b in itertools.pairwise(places)
    ]


def test_it_tracks_in_by_20_degrees_to_one_side_and_then_to_the_other():
    angles = turns_deg([START_M, *flown(made(), [1.0] * 4)])
    assert [abs(angle) for angle in angles] == pytest.approx([20.0] * 4, abs=0.1)
    assert [math.copysign(1, a) for a in angles] in ([1, -1, 1, -1], [-1, 1, -1, 1])


def test_it_tracks_out_straight_upwind_and_then_flies_a_cloverleaf_about_the_last_gas():
    places = flown(made(parameters={"lost_m": 2.0}), [1.0] + [0.0] * 15)
    assert turns_deg(places[:2]) == pytest.approx([0.0], abs=0.1)
    clover = places[2:14]
    assert max(math.dist(place, START_M) for place in clover) <= 1.5 + 0.001
    assert sum(math.dist(place, START_M) < 0.002 for place in clover) == 4
