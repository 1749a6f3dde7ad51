import itertools
import math

import pytest
from briefings import briefing, observation
from ribbon_world import Ribbon, fly

from gslcosim.base.errors import MethodError
from gslcosim_agents.moth_inspired.agent import MothInspired

WEST_RAD = math.pi  # the wind comes from -x
PID = (("pid", "nose"), ("anemometer", "vane"))
START_M = (7.0, 5.0, 2.0)


def made(**changes):
    return MothInspired(briefing(**{"sensors": PID, **changes}))


def at(tick, place_m=START_M, *, ppm=0.0, notice=None):
    return observation(tick=tick, position_m=place_m, readings={"nose": ppm, "vane": (0.5, WEST_RAD)}, notice=notice)


def flown(agent, amounts, place_m=START_M):
    places = []
    for i, ppm in enumerate(amounts):
        place_m = agent.decide(at(40 + 40 * i, place_m, ppm=ppm)).position_world_m
        places.append(place_m)
    return places


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


def test_a_refused_leg_is_led_around():
    agent = made()
    first = agent.decide(at(40, ppm=1.0))
    assert agent.decide(at(80, ppm=1.0, notice="no")).position_world_m != first.position_world_m


def test_equal_seeds_give_equal_legs_and_other_seeds_other_sides():
    assert flown(made(seed=3), [1.0, 0.0]) == flown(made(seed=3), [1.0, 0.0])
    assert len({tuple(flown(made(seed=seed), [1.0])) for seed in range(10)}) == 2


def test_a_missing_anemometer_is_reported_at_the_briefing():
    with pytest.raises(MethodError, match="wind"):
        made(sensors=(("pid", "nose"),))


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
