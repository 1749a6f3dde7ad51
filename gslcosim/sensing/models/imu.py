"""Inertial measurement unit: specific force and angular velocity, with noise and wandering biases."""

import math

import numpy as np

from gslcosim.contract.arrays import NumericArray
from gslcosim.contract.messages import Reading, Vec3
from gslcosim.errors import ModelError
from gslcosim.scenario.models import SensorSpec
from gslcosim.sensing.inertial_kernels import inertial_samples
from gslcosim.sensing.models.base import SensorKind
from gslcosim.sensing.models.surroundings import Surroundings
from gslcosim.sensing.models.wandering import WanderingBias

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
        tests/unit/sensing/test_imu.py (Allan variance at rest; lever arm; sums of samples)
    """

    def __init__(self, spec: SensorSpec, tick_s: float, rng: np.random.Generator) -> None:
        imu = spec.imu
        self._sensor = spec.name
        self._imu = imu
        self._tick_s = tick_s
        self._arm_m = np.array(spec.mount_m, np.float64)
        self._rng = rng
        self._biases: tuple[WanderingBias, WanderingBias] | None = None
        self._density = np.repeat([imu.accelerometer_noise_density, imu.gyro_noise_density], 3)
        self._limit = np.repeat([imu.max_acceleration_m_s2, imu.max_rate_rad_s], 3)

    def read(self, sample: Surroundings, mount_velocity_world_m_s: Vec3) -> Reading:
        """Return the samples of the tick; see `SensorModel.read`."""
        del mount_velocity_world_m_s
        inertial = sample.body.inertial_body
        if inertial is None:
            raise ModelError(f"sensing: expected inertial_body of vehicle {sample.body.agent!r}, was none.")
        rows = inertial.to_array()
        n = self._n_samples(len(rows))
        dt_s = self._tick_s / n
        force_bias, rate_bias = self._biases = self._biases or self._new_biases(dt_s)
        samples, means, is_cut = inertial_samples(
            rows, n, self._arm_m, force_bias.steps(n), rate_bias.steps(n),
            self._density / math.sqrt(dt_s), self._rng.standard_normal((n, 6)), self._limit,
        )  # fmt: skip
        return Reading(
            sensor=self._sensor,
            quantity=QUANTITY,
            unit=UNIT,
            values=tuple(means.tolist()),
            is_saturated=bool(is_cut),
            array=NumericArray.from_array(samples),
        )

    def _new_biases(self, dt_s: float) -> tuple[WanderingBias, WanderingBias]:
        imu, rng = self._imu, self._rng
        force = WanderingBias(
            (imu.accelerometer_random_walk,) * 3,
            imu.accelerometer_correlation_s,
            dt_s,
            rng,
            start_std=imu.accelerometer_start_bias_m_s2,
        )
        rate = WanderingBias(
            (imu.gyro_random_walk,) * 3, imu.gyro_correlation_s, dt_s, rng, start_std=imu.gyro_start_bias_rad_s
        )
        return force, rate

    # Means of as many physics steps as make a sample; a slower physics than the rate gives a sample a step.
    def _n_samples(self, n_rows: int) -> int:
        rate_hz = self._imu.rate_hz
        n = n_rows if rate_hz is None else max(1, min(n_rows, round(rate_hz * self._tick_s)))
        while n_rows % n:
            n -= 1
        return n


IMU = SensorKind(
    name="imu",
    quantity=QUANTITY,
    unit=UNIT,
    description="IMU: values = (fx, fy, fz, wx, wy, wz), means over the tick; array = its samples, (n, 6). Body frame.",
    build=Imu,
    is_on_board=True,
    n_with_errors=0,
)
