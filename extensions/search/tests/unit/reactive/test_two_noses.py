import math

import pytest
from briefings import briefing, observation

from gslcosim_search.reactive.taxis import TwoNoses, bearing_rad, turn_rad

LEFT, RIGHT = ("pid", "port", (0.0, 0.075, 0.0)), ("pid", "starboard", (0.0, -0.075, 0.0))
ANGLES = {"straight_rad": math.radians(5), "half_rad": math.radians(45)}


@pytest.mark.parametrize(("left", "right", "degrees"), [(1, 1, 0), (3, 1, 30), (1, 3, -30), (1, 0, 90), (0, 0, 0)])
def test_the_bearing_is_to_the_side_with_more_gas(left, right, degrees):
    assert math.degrees(bearing_rad(left, right, 1.0)) == pytest.approx(degrees)


def test_a_gain_widens_small_differences_and_stops_at_a_right_angle():
    assert bearing_rad(1.1, 1.0, 5.0) > bearing_rad(1.1, 1.0, 1.0) > 0.0
    assert bearing_rad(1.0, 3.0, 100.0) == -math.pi / 2
    assert bearing_rad(math.inf, 1.0, 1.0) == 0.0


@pytest.mark.parametrize(("bearing", "turn"), [(4, 0), (-4, 0), (5, 45), (45, 45), (-30, -45), (46, 90), (-80, -90)])
def test_turns_are_none_half_a_right_angle_or_one(bearing, turn):
    assert math.degrees(turn_rad(math.radians(bearing), **ANGLES)) == pytest.approx(turn)


def watch(sensors=(LEFT, RIGHT)):
    return TwoNoses(briefing(sensors=sensors), sample_s=0.2, window_s=1.0, threshold_ppm=0.1)


@pytest.mark.parametrize("sensors", [(LEFT, RIGHT), (RIGHT, LEFT), (RIGHT, ("pid", "middle"), LEFT)])
def test_noses_are_distinguished_by_where_they_are_not_by_their_order(sensors):
    noses = watch(sensors)
    noses.add(observation(tick=1, readings={"port": 3.0, "starboard": 1.0, "middle": 9.0}))
    assert noses.means() == (3.0, 1.0)


def test_means_are_those_of_the_window():
    noses = watch()
    for tick in range(40):
        noses.add(observation(tick=tick, readings={"port": 1.0 if tick < 20 else 2.0, "starboard": 0.0}))
        noses.add(observation(tick=tick, readings={"port": 99.0, "starboard": 99.0}))
    assert noses.means() == (2.0, 0.0)


@pytest.mark.parametrize("side", ["port", "starboard"])
def test_gas_that_grows_on_either_side_is_a_bout_once(side):
    noses = watch()
    for tick in range(60):
        ppm = 1.0 if tick > 50 else 0.0
        noses.add(observation(tick=tick, readings={"port": 0.0, "starboard": 0.0, side: ppm}))
    assert noses.take()
    assert not noses.take()


def test_steady_gas_and_clean_air_are_no_bout():
    noses = watch()
    for tick in range(60):
        noses.add(observation(tick=tick, readings={"port": 1.0, "starboard": 0.0}))
    assert not noses.take()


def test_noses_that_warm_up_are_left_out():
    noses = watch()
    noses.add(observation(tick=1, readings={"port": 9.0, "starboard": 1.0}, warming=("port",)))
    assert noses.means() == (0.0, 0.0)
