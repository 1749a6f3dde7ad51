import math

import numpy as np
import pytest

from gslcosim.base.errors import MethodError
from gslcosim_search.reactive.taxis import (
    RecentReadings,
    fit_gradient,
    lateral_pair,
    mount_position_m,
)
from gslcosim_search.senses.instruments import Nose

RNG = np.random.default_rng(1)
PLACES_M = RNG.uniform(0.0, 3.0, (7, 2))
ONES = np.ones(7)


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
