import itertools
import math

import pytest
import stops_in_wind
from ribbon_world import Ribbon, fly
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


def test_the_cloverleaf_ends_with_new_places():
    places = flown(made(parameters={"lost_m": 1.0, "leaf_m": 0.5}), [1.0] + [0.0] * 25)
    assert len(set(places[14:])) == len(places[14:])


def test_other_seeds_give_other_sides():
    assert len({tuple(flown(made(seed=seed), [1.0])) for seed in range(10)}) == 2


@pytest.mark.parametrize("nose", ["pid", "binary", "tgs2600"])
def test_it_comes_up_a_ribbon_of_gas(nose):
    assert fly(MothInspired, Ribbon(), nose=nose, limit_s=150.0).found_s is not None


def test_it_declares_near_the_source_and_not_where_it_may_not():
    def declared(**parameters):
        flight = fly(MothInspired, Ribbon(), found_m=0.0, limit_s=240.0, parameters=parameters)
        return [command.declaration for command in flight.commands if command.declaration is not None]

    (first, *_) = declared()
    assert math.dist(first.position_world_m, (2.0, 5.0, 2.0)) < 0.6
    assert declared(declares=False) == []
