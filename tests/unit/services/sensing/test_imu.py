"""The inertial measurement unit against what is set and what is felt."""

import math

import numpy as np
import pytest
from surroundings import G, at_rest, make_sensor, surroundings_in

from gslcosim.base.errors import ModelError
from gslcosim.scenario.models.sensors import make_sensor_spec

GYRO = ("gyro_noise_density", "gyro_random_walk", "gyro_start_bias_rad_s")
ACCELEROMETER = ("accelerometer_noise_density", "accelerometer_random_walk", "accelerometer_start_bias_m_s2")
SILENT = dict.fromkeys(GYRO + ACCELEROMETER, 0.0)


def imu(tick_s=0.1, mount_m=(0.0, 0.0, 0.0), seed=3, **settings):
    return make_sensor("imu", tick_s=tick_s, seed=seed, mount_m=mount_m, imu=settings)


def read(sensor, environment, inertial):
    return sensor.read(surroundings_in(environment, inertial=inertial), (0.0, 0.0, 0.0))


def test_a_perfect_one_at_rest_feels_what_carries_it(make_room):
    reading = read(imu(**SILENT), make_room(), at_rest())
    assert reading.values == pytest.approx((0.0, 0.0, G, 0.0, 0.0, 0.0))
    assert reading.array.to_array() == pytest.approx(at_rest()[:, :6])


def test_sums_of_samples_do_not_depend_on_the_rate(make_room):
    inertial = np.random.default_rng(1).normal(size=(25, 9))
    for rate_hz, n in ((250.0, 25), (50.0, 5), (10.0, 1), (1000.0, 25)):
        array = read(imu(rate_hz=rate_hz, **SILENT), make_room(), inertial).array.to_array()
        assert array.shape == (n, 6)
        assert array.mean(axis=0) == pytest.approx(inertial[:, :6].mean(axis=0))


def test_a_mount_off_the_axis_feels_the_turn(make_room):
    """At a metre ahead, 2 rad/s about z pull inwards with 4 m/s^2, and 3 rad/s^2 push sideways with 3."""
    row = [[0.0, 0.0, G, 0.0, 0.0, 2.0, 0.0, 0.0, 3.0]]
    reading = read(imu(mount_m=(1.0, 0.0, 0.0), **SILENT), make_room(), np.array(row))
    assert reading.values == pytest.approx((-4.0, 3.0, G, 0.0, 0.0, 2.0))


def test_what_exceeds_its_range_is_cut_and_reported(make_room):
    reading = read(imu(max_acceleration_m_s2=5.0, **SILENT), make_room(), at_rest())
    assert reading.is_saturated
    assert reading.values[2] == 5.0


def test_a_world_that_shows_no_forces_is_an_error(make_room):
    with pytest.raises(ModelError, match="expected inertial_body of vehicle 'beetle'"):
        imu().read(surroundings_in(make_room(), inertial_body=None), (0.0, 0.0, 0.0))


def test_the_bias_at_the_start_has_the_set_spread(make_room):
    quiet = {**SILENT, "gyro_start_bias_rad_s": 0.0087, "accelerometer_start_bias_m_s2": 0.196}
    values = np.array([read(imu(seed=seed, **quiet), make_room(), at_rest()).values for seed in range(400)])
    spread = (values - (0.0, 0.0, G, 0.0, 0.0, 0.0)).std(axis=0)
    assert spread == pytest.approx([0.196] * 3 + [0.0087] * 3, rel=0.12)


def allan_variance(samples, n):
    """Return the Allan variance of (m, 3) samples over groups of n, non-overlapping, mean of the axes."""
    means = samples[: len(samples) // n * n].reshape(-1, n, 3).mean(axis=1)
    return float((np.diff(means, axis=0) ** 2).mean() / 2)


def expected_allan_variance(density, walk, correlation_s, over_s):
    """White noise N^2/t, and Gauss-Markov (IEEE 952-1997, annex C, with q^2 the walk's strength)."""
    r = over_s / correlation_s
    decay = 1 - (3 - 4 * math.exp(-r) + math.exp(-2 * r)) / (2 * r)
    return density**2 / over_s + (walk * correlation_s) ** 2 / over_s * decay


@pytest.mark.slow
@pytest.mark.parametrize(("first", "name"), [(0, "accelerometer"), (3, "gyro")])
def test_at_rest_it_has_the_set_allan_variance(make_room, first, name):
    """Three hours with a sample each 0.1 s: white noise at 0.1 s, the walk at 100 s, and both between."""
    tick_s, n_ticks = 1.0, 12_000
    sensor = imu(tick_s, seed=5)
    settings = make_sensor_spec(model="imu", name="imu").imu
    figures = [getattr(settings, f"{name}_{kind}") for kind in ("noise_density", "random_walk", "correlation_s")]
    around = surroundings_in(make_room(), inertial=at_rest(10))
    still = (0.0, 0.0, 0.0)
    rows = np.concatenate([sensor.read(around, still).array.to_array() for _ in range(n_ticks)])
    samples = rows[:, first : first + 3]
    for over_s, rel in ((0.1, 0.03), (1.0, 0.05), (20.0, 0.15), (100.0, 0.3)):
        expected = expected_allan_variance(*figures, over_s)
        assert allan_variance(samples, round(over_s / 0.1)) == pytest.approx(expected, rel=rel), over_s
