"""GPS, barometer, magnetometer and localization against their laws."""

import math

import numpy as np
import pytest
from surroundings import make_sensor, surroundings_in

from gslcosim.base.frames import world_from_body_rotation
from gslcosim.base.rng import stream
from gslcosim_services.sensing.models.base import GaussMarkovBias

STILL = (0.0, 0.0, 0.0)
YAW_90 = (math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5))


def sensor(model, tick_s=0.1, mount_m=STILL, seed=1, **settings):
    return make_sensor(model, tick_s=tick_s, seed=seed, mount_m=mount_m, **{model: settings})


@pytest.mark.parametrize("dt_s", [0.05, 0.5, 5.0])
def test_a_wandering_bias_does_not_depend_on_the_step(dt_s):
    """After 10 s the variance is q^2 T/2 (1 - e^(-2t/T)), however many steps that takes."""
    rng = stream(1, "walk")
    ends = []
    for _ in range(1500):
        bias = GaussMarkovBias((0.3, 0.3, 0.3), 20.0, dt_s, rng)
        for _ in range(round(10.0 / dt_s)):
            end = bias.step()
        ends.append(end)
    expected = 0.3**2 * 10.0 * (1 - math.exp(-1.0))
    assert np.var(ends) == pytest.approx(expected, rel=0.06)


def test_a_gps_shows_place_and_velocity_of_its_mount(make_room):
    exact = dict.fromkeys(
        ("random_walk_xy", "random_walk_z", "position_noise_xy_m", "position_noise_z_m",
         "velocity_noise_xy_m_s", "velocity_noise_z_m_s"), 0.0
    )  # fmt: skip
    gps = sensor("gps", mount_m=(0.5, 0.0, 0.1), **exact)
    reading = gps.read(surroundings_in(make_room(), quaternion_wxyz=YAW_90), (0.1, 0.2, 0.3))
    assert reading.values == pytest.approx((1.0, 2.5, 3.1, 0.1, 0.2, 0.3))


def test_the_offset_of_a_gps_settles_at_its_law(make_room):
    """Spread q sqrt(T/2), which after twice the correlation time is reached to 2 per cent."""
    around = surroundings_in(make_room())
    ends = []
    for seed in range(300):
        gps = sensor("gps", tick_s=10.0, seed=seed)
        for _ in range(12):
            values = gps.read(around, STILL).values
        ends.append(np.array(values[:3]) - (1.0, 2.0, 3.0))
    q = np.array([0.008, 0.008, 0.016])
    assert np.std(ends, axis=0) == pytest.approx(q * math.sqrt(60.0 / 2), rel=0.12)


def test_pressure_falls_as_in_the_standard_atmosphere(make_room):
    """101325 Pa on the ground, 89874.6 Pa at 1000 m (ISO 2533), 12 Pa a metre at the ground."""

    def at(z_m):
        around = surroundings_in(make_room(), position_world_m=(1.0, 2.0, z_m))
        return sensor("barometer", noise_std_pa=0.0).read(around, STILL).values[0]

    assert at(0.0) == pytest.approx(101325.0)
    assert at(1000.0) == pytest.approx(89874.6, abs=1.0)
    assert at(0.0) - at(1.0) == pytest.approx(12.01, abs=0.01)


def test_noise_and_drift_of_a_barometer(make_room):
    around = surroundings_in(make_room(), position_world_m=(1.0, 2.0, 0.0))
    drifting = sensor("barometer", drift_pa_s=0.5, noise_std_pa=0.0)
    assert [drifting.read(around, STILL).values[0] - 101325.0 for _ in range(3)] == pytest.approx([0.0, 0.05, 0.1])
    noisy = sensor("barometer")
    assert np.std([noisy.read(around, STILL).values[0] for _ in range(2000)]) == pytest.approx(1.0, rel=0.05)


def test_a_magnetometer_turns_against_the_field(make_room):
    compass = sensor("magnetometer", field_world_ut=(0.0, 20.0, -45.0), noise_density=0.0, random_walk=0.0)
    north = compass.read(surroundings_in(make_room(), quaternion_wxyz=YAW_90), STILL).values
    assert north == pytest.approx((20.0, 0.0, -45.0))


def test_the_noise_of_a_magnetometer_has_its_density(make_room):
    around = surroundings_in(make_room())
    compass = sensor("magnetometer", tick_s=0.25, random_walk=0.0)
    values = np.array([compass.read(around, STILL).values for _ in range(3000)])
    assert values.std(axis=0) == pytest.approx([0.04 / math.sqrt(0.25)] * 3, rel=0.06)


def test_a_pose_has_the_set_noise_and_a_unit_quaternion(make_room):
    around = surroundings_in(make_room(), quaternion_wxyz=YAW_90)
    pose = sensor("pose", position_noise_m=0.1, attitude_noise_rad=0.02, velocity_noise_m_s=0.3)
    values = np.array([pose.read(around, STILL).values for _ in range(3000)])
    assert values[:, :3].std(axis=0) == pytest.approx([0.1] * 3, rel=0.06)
    assert values[:, 7:].std(axis=0) == pytest.approx([0.3] * 3, rel=0.06)
    assert np.linalg.norm(values[:, 3:7], axis=1) == pytest.approx(np.ones(3000))
    turns = [world_from_body_rotation(YAW_90).T @ world_from_body_rotation(tuple(q)) for q in values[:, 3:7]]
    angles = np.array([(R[2, 1], R[0, 2], R[1, 0]) for R in turns])
    assert angles.std(axis=0) == pytest.approx([0.02] * 3, rel=0.06)
    assert angles.mean(axis=0) == pytest.approx([0.0] * 3, abs=0.002)
