"""Inertial measurement unit: specific force and angular velocity, with noise and Gauss-Markov biases."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gslcosim.base.errors import ModelError
from gslcosim.base.quantities import Vec3
from gslcosim.contract.messages import Reading
from gslcosim.contract.record import NumericArray
from gslcosim.scenario.models.onboard_sensors import ImuSensorSpec, ImuSpec
from gslcosim.scenario.models.sensors import SENSOR_BLOCKS
from gslcosim_services.sensing.models.base import SensorKind, Surroundings
from gslcosim_services.sensing.models.measurement_errors import decay_factor, increment_std

QUANTITY = "specific_force, angular_velocity"
UNIT = "m/s^2, rad/s"


class Imu:
    """Strapped down at its mount, axes as the body's: values = (fx, fy, fz, wx, wy, wz), means over the tick.

    f = a - g + omega x (omega x r) + alpha x r;   sample = truth + bias + N(0, density / sqrt(dt))
    [m/s^2]; r mount in the body frame, dt time between samples

    `array` is (n, 6) float64, a row for each sample of the tick: `rate_hz` of them a second, each the mean of the
    physics steps since the one before, so that sums over rows are changes of velocity and angle. At rest it shows
    (0, 0, g, 0, 0, 0). What exceeds its range is cut there, and the reading `is_saturated`.

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
        """Return the samples of the tick; see `SensorModel.read`."""
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
        return Reading(
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
            [decay_factor(dt_s, correlation_s) ** np.arange(1, n + 1) for _, correlation_s in walks], np.float64
        ),
        noise=density / math.sqrt(dt_s),
    )


# A sample is the mean of as many physics steps as make one; a slower physics than the rate gives a sample a step.
def _n_samples(n_rows: int, rate_hz: float | None, tick_s: float) -> int:
    n = n_rows if rate_hz is None else max(1, min(n_rows, round(rate_hz * tick_s)))
    while n_rows % n:
        n -= 1
    return n


IMU = SensorKind(
    name="imu",
    settings=SENSOR_BLOCKS["imu"],
    quantity=QUANTITY,
    unit=UNIT,
    description="IMU: values = (fx, fy, fz, wx, wy, wz), means over the tick; array = its samples, (n, 6). Body frame.",
    build=Imu,
    n_with_errors=0,
)
