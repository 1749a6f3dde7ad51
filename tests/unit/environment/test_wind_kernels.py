"""Trilinear wind: exact for linear fields, in a box with three different side lengths."""

import numpy as np
import pytest

from gslcosim.environment.grid_kernels import trilinear_wind, trilinear_wind_at_points
from gslcosim.environment.model import Grid

GRID = Grid(origin_m=(-1.0, 2.0, 0.5), cell_m=0.25, shape=(9, 6, 4))
SLOPES = np.array([[0.5, -1.0, 2.0], [0.25, 3.0, -0.5], [-2.0, 1.0, 0.75]])
OFFSET = np.array([0.1, -0.2, 0.3])


def linear_wind(points):
    return points @ SLOPES.T + OFFSET


def wind_at(field, points):
    return trilinear_wind_at_points(field, np.array(GRID.origin_m), GRID.cell_m, np.asarray(points, dtype=np.float64))


def test_a_linear_field_is_interpolated_exactly_between_the_outermost_centres():
    field = linear_wind(GRID.centres_m())
    low, high = np.array(GRID.origin_m) + 0.125, np.array(GRID.max_m) - 0.125
    points = low + np.random.default_rng(2).random((200, 3)) * (high - low)
    assert wind_at(field, points) == pytest.approx(linear_wind(points), abs=1e-12)


def test_outside_the_outermost_centres_the_border_value_holds():
    field = linear_wind(GRID.centres_m())
    for axis in range(3):
        inside = np.array(GRID.origin_m) + 0.4
        for border, beyond in ((GRID.origin_m[axis] + 0.125, -50.0), (GRID.max_m[axis] - 0.125, 50.0)):
            at_border, outside = inside.copy(), inside.copy()
            at_border[axis], outside[axis] = border, beyond
            assert wind_at(field, [outside]) == pytest.approx(linear_wind(at_border[None]), abs=1e-12)


def test_one_point_and_many_points_agree():
    field = np.random.default_rng(4).normal(size=(*GRID.shape, 3)).astype(np.float32)
    points = np.array(GRID.origin_m) + np.random.default_rng(5).random((20, 3)) * (2.25, 1.5, 1.0)
    one_by_one = [trilinear_wind(field, GRID.origin_m, GRID.cell_m, *map(float, point)) for point in points]
    assert (wind_at(field, points) == np.array(one_by_one)).all()


def test_a_room_one_cell_wide_has_the_wind_of_that_cell():
    field = np.array([[[[1.0, 2.0, 3.0]]]], dtype=np.float32)
    assert trilinear_wind(field, (0.0, 0.0, 0.0), 0.5, 0.1, 0.4, 9.0) == (1.0, 2.0, 3.0)
