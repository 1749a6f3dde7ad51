"""Inertial measurement unit: specific force and angular velocity, with noise and wandering biases."""

import math

import numpy as np
from numpy.typing import NDArray

from gslcosim.contract.arrays import NumericArray
from gslcosim.contract.messages import Reading, Vec3
from gslcosim.errors import ModelError
from gslcosim.scenario.models import SensorSpec
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
        self._spec = spec
        self._tick_s = tick_s
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
        rows = self._at_rate(_at_mount(inertial.to_array(), self._spec.mount_m))
        n, dt_s = len(rows), self._tick_s / len(rows)
        self._biases = self._biases or self._new_biases(dt_s)
        bias = np.hstack([bias.steps(n) for bias in self._biases])
        rows = rows + bias + self._density / math.sqrt(dt_s) * self._rng.standard_normal(rows.shape)
        kept = np.clip(rows, -self._limit, self._limit)
        return Reading(
            sensor=self._spec.name,
            quantity=QUANTITY,
            unit=UNIT,
            values=tuple(kept.mean(axis=0).tolist()),
            is_saturated=bool((kept != rows).any()),
            array=NumericArray.from_array(kept),
        )

    def _new_biases(self, dt_s: float) -> tuple[WanderingBias, WanderingBias]:
        imu, rng = self._spec.imu, self._rng
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
    def _at_rate(self, rows: NDArray[np.float64]) -> NDArray[np.float64]:
        rate_hz = self._spec.imu.rate_hz
        if rate_hz is None:
            return rows
        n = max(1, min(len(rows), round(rate_hz * self._tick_s)))
        while len(rows) % n:
            n -= 1
        return rows.reshape(n, -1, 6).mean(axis=1)


# (n, 6) specific force and angular velocity at a mount, from those and the angular acceleration at the body's origin.
def _at_mount(inertial: NDArray[np.float64], mount_m: Vec3) -> NDArray[np.float64]:
    if not any(mount_m):
        return inertial[:, :6]
    arm, omega, alpha = np.array(mount_m), inertial[:, 3:6], inertial[:, 6:]
    force = inertial[:, :3] + np.cross(omega, np.cross(omega, arm)) + np.cross(alpha, arm)
    return np.hstack([force, omega])


IMU = SensorKind(
    name="imu",
    quantity=QUANTITY,
    unit=UNIT,
    description="IMU: values = (fx, fy, fz, wx, wy, wz), means over the tick; array = its samples, (n, 6). Body frame.",
    build=Imu,
    is_on_board=True,
    n_with_errors=0,
)
