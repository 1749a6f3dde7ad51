"""Navigation sensors: GPS, barometer, magnetometer, localization system, and inertial measurement unit."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gslcosim.base import elementary
from gslcosim.base.errors import ModelError
from gslcosim.base.quantities import Vec3
from gslcosim.base.scalar_kernels import norm3
from gslcosim.contract.messages import Quaternion, Reading
from gslcosim.contract.record import NumericArray
from gslcosim.scenario.models.sensors import (
    BarometerSensorSpec,
    GpsSensorSpec,
    ImuSensorSpec,
    ImuSpec,
    MagnetometerSensorSpec,
    PoseSensorSpec,
)
from gslcosim_services.sensing.models.base import (
    GaussMarkovBias,
    SensorKind,
    Surroundings,
    decay_factor,
    increment_std,
    make_kind,
    new_reading,
)

QUANTITY = "specific_force, angular_velocity"
UNIT = "m/s^2, rad/s"

# International standard atmosphere: lapse rate [K/m], and exponent g M / (R L).
LAPSE_K_M = 0.0065
ISA_EXPONENT = 5.25588


class Imu:
    """Strapped down at its mount, axes as the body's: values = (fx, fy, fz, wx, wy, wz), means over the tick.

    f = a - g + omega x (omega x r) + alpha x r;   sample = truth + bias + N(0, density / sqrt(dt))
    [m/s^2]; r mount in the body frame, dt time between samples

    `array` is (n, 6) float64, a row for each sample of the tick: `rate_hz` of them a second, each the mean of the
    physics steps since the one before, so that sums over rows are changes of velocity and angle. At rest it shows
    (0, 0, g, 0, 0, 0). Values beyond its range are cut there, and the reading `is_saturated`.

    State: two wandering biases. Draws the accelerometer's and the gyroscope's at the start; in each tick the steps of
    the one, of the other, and then the noise of all samples.

    Source:
        Law and numbers as in Pegasus, after RotorS; the numbers are in `ImuSpec`.
    Left out:
        Scale errors, cross-axis sensitivity, vibration, temperature.
    Held by:
        tests/unit/services/sensing/test_imu.py (Allan variance at rest; lever arm; sums of samples)
    """

    def __init__(self, spec: ImuSensorSpec, tick_s: float, rng: np.random.Generator) -> None:
        imu = spec.imu
        self._sensor = spec.name
        self._imu = imu
        self._tick_s = tick_s
        self._rng = rng
        self._arm_m = np.array(spec.mount_m, np.float64)
        self._limit = np.repeat([imu.max_acceleration_m_s2, imu.max_rate_rad_s], 3)
        start = np.repeat([imu.accelerometer_start_bias_m_s2, imu.gyro_start_bias_rad_s], 3)
        self._constant = start * rng.standard_normal(6)
        self._wandering = np.zeros(6)
        self._pace = _sample_errors(imu, 1, tick_s)

    def read(self, sample: Surroundings, mount_velocity_world_m_s: Vec3) -> Reading:
        """Return the samples of the tick."""
        del mount_velocity_world_m_s
        from gslcosim_services.sensing.models.imu_kernels import sample_imu  # the table of sensors needs no compiler

        inertial = sample.body.inertial_body
        if inertial is None:
            raise ModelError(f"sensing: expected inertial_body of vehicle {sample.body.agent!r}, was none.")
        n = _n_samples(inertial.shape[0], self._imu.rate_hz, self._tick_s)
        if n != self._pace.n:
            self._pace = _sample_errors(self._imu, n, self._tick_s)
        pace = self._pace
        samples, means, is_cut = sample_imu(
            inertial.to_array(), self._arm_m, self._constant, self._wandering,
            pace.kick, pace.powers, pace.noise, self._limit, self._rng.standard_normal(12 * n),
        )  # fmt: skip
        return new_reading(
            sensor=self._sensor,
            quantity=QUANTITY,
            unit=UNIT,
            values=means,
            is_saturated=is_cut,
            array=NumericArray.from_array(samples),
        )


@dataclass(frozen=True)
class _SampleErrors:
    """Errors of a sample for a number of samples in a tick."""

    n: int
    kick: NDArray[np.float64]
    powers: NDArray[np.float64]
    noise: NDArray[np.float64]


def _sample_errors(imu: ImuSpec, n: int, tick_s: float) -> _SampleErrors:
    dt_s = tick_s / n
    walks = (
        (imu.accelerometer_random_walk, imu.accelerometer_correlation_s),
        (imu.gyro_random_walk, imu.gyro_correlation_s),
    )
    density = np.repeat([imu.accelerometer_noise_density, imu.gyro_noise_density], 3)
    return _SampleErrors(
        n=n,
        kick=np.array([increment_std(dt_s, walk, correlation_s) for walk, correlation_s in walks]),
        powers=np.array(
            [elementary.pow_each(decay_factor(dt_s, correlation_s), np.arange(1, n + 1)) for _, correlation_s in walks]
        ),
        noise=density / math.sqrt(dt_s),
    )


# A sample is the mean of as many physics steps as make one; a slower physics than the rate gives a sample a step.
def _n_samples(n_rows: int, rate_hz: float | None, tick_s: float) -> int:
    n = n_rows if rate_hz is None else max(1, min(n_rows, round(rate_hz * tick_s)))
    while n_rows % n:
        n -= 1
    return n


IMU = make_kind(
    SensorKind, "imu", QUANTITY, UNIT,
    "IMU: values = (fx, fy, fz, wx, wy, wz), means over the tick; array = its samples, (n, 6). Body frame.",
    build=Imu, n_with_errors=0,
)  # fmt: skip


class Gps:
    """A receiver at its mount: values = (x, y, z, vx, vy, vz) in the world frame.

    position + wandering offset + N(0, position noise);   velocity + N(0, velocity noise)

    The offset is a Gauss-Markov process with the random walk q [m/sqrt(s)] and correlation time T; its spread settles
    at q sqrt(T/2). State: the offset, 0 at the start. Draws in each tick: the offset's step, position, velocity.

    Source:
        Pegasus, after PX4's Gazebo plug-in: random walk 2.0 and 4.0, noise density 2e-4 and 4e-4 (horizontal,
        vertical), velocity 0.2 and 0.4, T = 60 s.
    Deviation:
        There the walk's steps are scaled by dt^1.5 and the noises by dt^0.5, so that they depend on the rate. Ours do
        not: the defaults are what those laws give at 250 Hz for walk (2.0 * 0.004) and velocity (0.2 * 0.004^0.5).
    Left out:
        That there is no reception indoors.
    Held by:
        tests/unit/services/sensing/test_navigation_sensors.py
    """

    def __init__(self, spec: GpsSensorSpec, tick_s: float, rng: np.random.Generator) -> None:
        gps = spec.gps
        self._spec = spec
        self._rng = rng
        walk = (gps.random_walk_xy, gps.random_walk_xy, gps.random_walk_z)
        self._offset = GaussMarkovBias(walk, gps.correlation_s, tick_s, rng)
        position = (gps.position_noise_xy_m, gps.position_noise_xy_m, gps.position_noise_z_m)
        velocity = (gps.velocity_noise_xy_m_s, gps.velocity_noise_xy_m_s, gps.velocity_noise_z_m_s)
        self._noise = position + velocity

    def read(self, sample: Surroundings, mount_velocity_world_m_s: Vec3) -> Reading:
        """Return the fix."""
        place_m, offset_m = sample.place_world_m(self._spec.mount_m), self._offset.step()
        truth = *(x + off for x, off in zip(place_m, offset_m, strict=True)), *mount_velocity_world_m_s
        draws = self._rng.standard_normal(6).tolist()
        values = tuple(x + std * draw for x, std, draw in zip(truth, self._noise, draws, strict=True))
        return new_reading(sensor=self._spec.name, quantity=GPS.quantity, unit=GPS.unit, values=values)


class Barometer:
    """Air pressure at the mount in the standard atmosphere: values = (pressure_pa,).

    p = p0 (1 - L z / T0)^5.25588 + drift t + N(0, noise_std)      [Pa]; about -12 Pa a metre near the ground

    State: the number of the tick, for the drift. Draws one number a tick.

    Source:
        International standard atmosphere; 1 Pa of noise and no drift as in Pegasus.
    Held by:
        tests/unit/services/sensing/test_navigation_sensors.py
    """

    def __init__(self, spec: BarometerSensorSpec, tick_s: float, rng: np.random.Generator) -> None:
        self._spec = spec
        self._tick_s = tick_s
        self._rng = rng
        self._tick = -1

    def read(self, sample: Surroundings, mount_velocity_world_m_s: Vec3) -> Reading:
        """Return the pressure."""
        del mount_velocity_world_m_s
        self._tick += 1
        barometer = self._spec.barometer
        _, _, z_m = sample.place_world_m(self._spec.mount_m)
        truth_pa = pressure_pa(z_m, barometer.ground_pressure_pa, barometer.ground_temperature_k)
        error_pa = barometer.drift_pa_s * self._tick * self._tick_s
        error_pa += barometer.noise_std_pa * float(self._rng.standard_normal())
        return new_reading(sensor=self._spec.name, quantity="pressure", unit="Pa", values=(truth_pa + error_pa,))


def pressure_pa(z_m: float, ground_pressure_pa: float, ground_temperature_k: float) -> float:
    """Return the pressure of the standard atmosphere at a height above the ground [Pa]."""
    return ground_pressure_pa * elementary.pow(1.0 - LAPSE_K_M * z_m / ground_temperature_k, ISA_EXPONENT)


class Magnetometer:
    """The earth's field in the body's axes: values = (x, y, z) [uT].

    R' B + bias + N(0, density / sqrt(tick))

    State: a wandering bias, 0 at the start. Draws in each tick: the bias's step, then x, y, z.

    Source:
        Noise density 4e-4 G/sqrt(Hz), random walk 6.4e-6 G/s/sqrt(Hz) and 600 s as in Pegasus; 1 G is 100 uT. The
        default field is about that of Delft (chosen; 49.4 uT, dipping 67 degrees).
    Left out:
        Iron and currents of vehicle and room.
    Held by:
        tests/unit/services/sensing/test_navigation_sensors.py
    """

    def __init__(self, spec: MagnetometerSensorSpec, tick_s: float, rng: np.random.Generator) -> None:
        magnetometer = spec.magnetometer
        self._sensor = spec.name
        self._rng = rng
        self._field_ut = np.array(magnetometer.field_world_ut)
        self._noise_ut = magnetometer.noise_density / math.sqrt(tick_s)
        self._bias = GaussMarkovBias((magnetometer.random_walk,) * 3, magnetometer.correlation_s, tick_s, rng)

    def read(self, sample: Surroundings, mount_velocity_world_m_s: Vec3) -> Reading:
        """Return the field."""
        del mount_velocity_world_m_s
        values = elementary.product(sample.world_from_body.T, self._field_ut) + np.array(self._bias.step())
        values = values + self._noise_ut * self._rng.standard_normal(3)
        return new_reading(sensor=self._sensor, quantity="magnetic_field", unit="uT", values=tuple(values.tolist()))


class PoseSensor:
    """A localization system: values = (x, y, z, qw, qx, qy, qz, vx, vy, vz) of the body frame, in the world frame.

    p + N(0, position);   q * exp(N(0, attitude) / 2);   v + N(0, velocity)

    On a vehicle with this sensor, the pose in the observation is its last reading, not the exact one. State: none.
    Draws in each tick: position, attitude about body x, y, z, velocity. The noises are chosen, as of motion capture
    with a margin.

    Held by:
        tests/unit/services/sensing/test_navigation_sensors.py
    """

    def __init__(self, spec: PoseSensorSpec, tick_s: float, rng: np.random.Generator) -> None:
        del tick_s  # white noise only
        pose = spec.pose
        self._sensor = spec.name
        self._rng = rng
        self._noise = np.repeat([pose.position_noise_m, pose.attitude_noise_rad, pose.velocity_noise_m_s], 3)

    def read(self, sample: Surroundings, mount_velocity_world_m_s: Vec3) -> Reading:
        """Return the pose of the vehicle, independent of the sensor's mount."""
        del mount_velocity_world_m_s
        body = sample.body
        errors = (self._noise * self._rng.standard_normal(9)).tolist()
        position_m = (p + e for p, e in zip(body.position_world_m, errors[:3], strict=True))
        velocity_m_s = (v + e for v, e in zip(body.velocity_world_m_s, errors[6:], strict=True))
        quaternion = _rotate_attitude(body.quaternion_wxyz, (errors[3], errors[4], errors[5]))
        values = (*position_m, *quaternion, *velocity_m_s)
        return new_reading(sensor=self._sensor, quantity=POSE.quantity, unit=POSE.unit, values=values)


# The attitude after a further turn by a rotation vector in the body frame [rad].
def _rotate_attitude(q: Quaternion, turn_rad: Vec3) -> Quaternion:
    angle = norm3(*turn_rad)
    if angle == 0.0:
        return q
    s = elementary.sin(angle / 2) / angle
    b, c, d = (s * component for component in turn_rad)
    a = elementary.cos(angle / 2)
    w, x, y, z = q
    return (
        w * a - x * b - y * c - z * d,
        w * b + x * a + y * d - z * c,
        w * c - x * d + y * a + z * b,
        w * d + x * c - y * b + z * a,
    )


GPS = make_kind(
    SensorKind, "gps", "position, velocity", "m, m/s", "GPS: values = (x, y, z, vx, vy, vz), world frame.",
    build=Gps, n_with_errors=0,
)  # fmt: skip
BAROMETER = make_kind(
    SensorKind, "barometer", "pressure", "Pa",
    "Barometer: values = (pressure_pa,), about 12 Pa lower per metre of height.", build=Barometer,
)  # fmt: skip
MAGNETOMETER = make_kind(
    SensorKind, "magnetometer", "magnetic_field", "uT",
    "Magnetometer: values = (x, y, z) of the earth's field, body frame.", build=Magnetometer,
)  # fmt: skip
POSE = make_kind(
    SensorKind, "pose", "position, attitude, velocity", "m, 1, m/s",
    "Localization system: values = (x, y, z, qw, qx, qy, qz, vx, vy, vz), world frame; it "
    "replaces the pose in observations.", build=PoseSensor, n_with_errors=0,
)  # fmt: skip
