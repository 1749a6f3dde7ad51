"""Range finders and lidars in a box with three different side lengths: 15 x 10 x 6 m."""

import math

import numpy as np
import pytest
from surroundings import make_sensor, surroundings_in

from gslcosim.scenario.models.sensors import make_sensor_spec
from gslcosim_services.sensing.models.range_finders import ray_directions_body

STILL = (0.0, 0.0, 0.0)
YAW_90 = (math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5))
R2 = math.sqrt(0.5)


def read(room, model, spec=None, **around):
    return make_sensor(model, **(spec or {})).read(surroundings_in(room, **around), STILL)


def test_four_beams_are_front_left_back_right(make_room):
    assert read(make_room(), "four_range_finders").values == pytest.approx((14.0, 8.0, 1.0, 2.0))
    turned = read(make_room(), "four_range_finders", quaternion_wxyz=YAW_90)
    assert turned.values == pytest.approx((8.0, 1.0, 2.0, 14.0))


def test_a_single_beam_goes_where_it_points(make_room):
    assert read(make_room(), "range_finder", {"beam_body": (0, 0, -2)}).values == pytest.approx((3.0,))
    assert read(make_room(), "range_finder", {"beam_body": (0, 0, 1)}).values == pytest.approx((3.0,))
    slanted = {"beam_body": (-1, 0, 1), "mount_m": (0.5, 0, 0)}
    assert read(make_room(), "range_finder", slanted).values == pytest.approx((1.5 * math.sqrt(2),))


def test_nothing_in_range_is_the_longest_range_and_reported(make_room):
    reading = read(make_room(), "range_finder", {"max_range_m": 4.0, "noise_std": 0.1})
    assert (reading.values, reading.is_saturated) == ((4.0,), True)
    one_of_four = read(make_room(), "four_range_finders", {"max_range_m": 4.0})
    assert (one_of_four.values, one_of_four.is_saturated) == ((4.0, 4.0, 1.0, 2.0), False)


def test_noise_is_that_of_the_scenario(make_room):
    sensor = make_sensor("range_finder", noise_std=0.02, beam_body=(0, 0, -1))
    around = surroundings_in(make_room())
    ranges = [sensor.read(around, STILL).values[0] for _ in range(2000)]
    assert (np.mean(ranges), np.std(ranges)) == (pytest.approx(3.0, abs=0.002), pytest.approx(0.02, rel=0.06))


def test_a_level_lidar_sees_the_walls(make_room):
    reading = read(make_room(), "lidar_2d", {"lidar": {"n_azimuths": 72}})
    ranges = reading.array.to_array()
    azimuths = np.deg2rad(np.arange(-180, 180, 5))
    with np.errstate(divide="ignore"):
        distances = np.stack(
            [14 / np.cos(azimuths), -1 / np.cos(azimuths), 8 / np.sin(azimuths), -2 / np.sin(azimuths)]
        )
    expected = np.where(distances > 0, distances, np.inf).min(axis=0)
    assert ranges.shape == (1, 72)
    assert ranges[0] == pytest.approx(expected, rel=1e-5)
    assert reading.values[0] == pytest.approx(1.0)


def test_points_of_a_lidar_lie_on_the_faces_of_the_room(make_room):
    settings = {"mount_m": (0.1, 0.2, 0.3), "mount_rpy_rad": (0.3, -0.2, 0.5), "lidar": {"n_azimuths": 90}}
    spec = make_sensor_spec(**{"model": "lidar_3d", "name": "s", **settings})
    around = surroundings_in(make_room(), quaternion_wxyz=(0.5, 0.5, 0.5, 0.5))
    ranges = read(make_room(), "lidar_3d", settings, quaternion_wxyz=(0.5, 0.5, 0.5, 0.5)).array.to_array()
    directions = ray_directions_body(spec)
    assert (ranges.shape, directions.shape) == ((16, 90), (16, 90, 3))
    assert np.linalg.norm(directions, axis=-1) == pytest.approx(np.ones((16, 90)))
    points_body_m = np.array(spec.mount_m) + ranges[..., None] * directions
    points_m = np.array(around.body.position_world_m) + points_body_m @ around.world_from_body.T
    gaps_m = np.minimum(np.abs(points_m), np.abs(np.array([15.0, 10.0, 6.0]) - points_m)).min(axis=-1)
    assert gaps_m == pytest.approx(np.zeros((16, 90)), abs=1e-5)


def test_a_pitched_sensor_looks_down():
    spec = make_sensor_spec(model="range_finder", name="s", mount_rpy_rad=(0.0, math.pi / 4, 0.0))
    assert ray_directions_body(spec) == pytest.approx(np.array([[R2, 0.0, -R2]]))
