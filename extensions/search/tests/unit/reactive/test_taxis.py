import math

import numpy as np
import pytest
from briefings import briefing, observation

from gslcosim.base.errors import MethodError
from gslcosim_search.reactive.taxis import (
    RecentReadings,
    TwoNoses,
    bearing_rad,
    fit_gradient,
    lateral_pair,
    mount_position_m,
    turn_rad,
)
from gslcosim_search.senses.instruments import Nose

RNG = np.random.default_rng(1)
PLACES_M = RNG.uniform(0.0, 3.0, (7, 2))
ONES = np.ones(7)
LEFT, RIGHT = ("pid", "port", (0.0, 0.075, 0.0)), ("pid", "starboard", (0.0, -0.075, 0.0))
ANGLES = {"straight_rad": math.radians(5), "half_rad": math.radians(45)}


def nose(y_m: float) -> Nose:
    return Nose(name=f"at {y_m}", unit="ppm", mount_body_m=(0.0, y_m, 0.0))


@pytest.mark.parametrize("weights", [ONES, np.arange(1.0, 8.0)])
def test_a_plane_is_recovered_exactly(weights):
    fit = fit_gradient(PLACES_M, 2.0 + PLACES_M @ (0.3, -0.4), weights)
    assert fit.gradient_per_m == pytest.approx((0.3, -0.4))
    assert fit.standard_error_per_m == pytest.approx(0.0, abs=1e-12)
    assert fit.is_significant
    assert fit.heading_rad == pytest.approx(math.atan2(-0.4, 0.3))


def test_it_is_the_least_squares_solution_with_its_error():
    """Against numpy's solver and the textbook's covariance, weighted."""
    values, weights = RNG.normal(size=7), RNG.uniform(0.1, 1.0, 7)
    design = np.column_stack([np.ones(7), PLACES_M])
    root = np.sqrt(weights / weights.mean())
    expected, residuals, *_ = np.linalg.lstsq(design * root[:, None], values * root, rcond=None)
    covariance = np.linalg.inv(design.T @ (design * root[:, None] ** 2)) * residuals[0] / 4
    unit = expected[1:] / np.linalg.norm(expected[1:])
    fit = fit_gradient(PLACES_M, values, weights)
    assert fit.gradient_per_m == pytest.approx(tuple(expected[1:]))
    assert fit.standard_error_per_m == pytest.approx(math.sqrt(unit @ covariance[1:, 1:] @ unit))


def test_places_on_a_line_show_the_slope_along_it():
    along = np.array([0.0, 1.0, 2.0, 3.5])
    fit = fit_gradient(np.outer(along, (0.6, 0.8)), 5.0 * along, np.ones(4))
    assert fit.gradient_per_m == pytest.approx((3.0, 4.0))


@pytest.mark.parametrize(
    ("places_m", "weights"),
    [
        (PLACES_M[:3], np.ones(3)),
        (np.ones((5, 2)), np.ones(5)),
        (PLACES_M, np.zeros(7)),
        (np.empty((0, 2)), np.ones(0)),
    ],
)
def test_too_few_readings_or_one_place_show_nothing(places_m, weights):
    assert fit_gradient(places_m, np.arange(float(len(places_m))), weights) is None


def test_old_and_far_readings_are_left_out():
    readings = RecentReadings(within_m=3.0, within_s=20.0)
    for i, (x_m, y_m) in enumerate([(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)]):
        readings.add(10.0 + i, (x_m, y_m), 2.0 * x_m)
    readings.add(14.0, (9.0, 9.0), 99.0)
    readings.add(14.0, (0.5, 0.5), math.inf)
    assert readings.fit(14.0, (0.5, 0.5)).gradient_per_m == pytest.approx((2.0, 0.0))
    assert readings.fit(14.0, (6.0, 6.0)) is None
    assert readings.fit(30.5, (0.5, 0.5)) is None


def test_a_mount_turns_with_the_vehicle():
    assert mount_position_m((1.0, 2.0, 3.0), math.pi / 2, (0.5, 0.2, 0.1)) == pytest.approx((0.8, 2.5))


def test_the_outermost_noses_are_the_pair():
    left, right = lateral_pair([nose(0.0), nose(-0.2), nose(0.3)])
    assert (left.mount_body_m[1], right.mount_body_m[1]) == (0.3, -0.2)
    with pytest.raises(MethodError, match="m apart across the vehicle"):
        lateral_pair([nose(0.1), nose(0.1)])


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
