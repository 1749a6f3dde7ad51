import math

import pytest

from gslcosim_search.reactive.cast_and_surge import oblique_surge_end_m, surge_end_m

HERE_M = (3.0, 4.0, 2.0)


def in_wind_frame(place_m, upwind_rad):
    dx_m, dy_m = place_m[0] - HERE_M[0], place_m[1] - HERE_M[1]
    c, s = math.cos(upwind_rad), math.sin(upwind_rad)
    return dx_m * c + dy_m * s, dy_m * c - dx_m * s


@pytest.mark.parametrize("upwind_rad", [0.0, 0.7, -2.5, math.pi])
def test_a_surge_without_a_place_of_gas_goes_straight_upwind(upwind_rad):
    assert in_wind_frame(surge_end_m(HERE_M, None, upwind_rad, 0.8), upwind_rad) == pytest.approx((0.8, 0.0))


@pytest.mark.parametrize("upwind_rad", [0.0, 0.7, -2.5, math.pi])
def test_a_surge_ends_on_the_line_upwind_through_the_gas_and_loses_no_way(upwind_rad):
    gas_m = (3.4, 3.1, 2.0)
    along_m, across_m = in_wind_frame(surge_end_m(HERE_M, gas_m, upwind_rad, 0.8), upwind_rad)
    assert along_m == pytest.approx(0.8)
    assert across_m == pytest.approx(in_wind_frame(gas_m, upwind_rad)[1])


@pytest.mark.parametrize("slant_rad", [0.3, -0.3, 1.2])
def test_a_slanted_leg_has_its_length_and_its_angle_to_upwind(slant_rad):
    along_m, across_m = in_wind_frame(oblique_surge_end_m(HERE_M, None, 0.7, slant_rad, 0.8), 0.7)
    assert math.hypot(along_m, across_m) == pytest.approx(0.8)
    assert math.atan2(across_m, along_m) == pytest.approx(slant_rad)


def test_a_leg_without_slant_is_a_surge():
    gas_m = (3.4, 3.1, 2.0)
    assert oblique_surge_end_m(HERE_M, gas_m, 0.7, 0.0, 0.8) == surge_end_m(HERE_M, gas_m, 0.7, 0.8)
