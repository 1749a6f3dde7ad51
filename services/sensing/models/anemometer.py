"""Ultrasonic anemometers: the apparent wind of a moving vehicle, in world directions."""

import math

import numpy as np

from gslcosim.base.quantities import Vec3
from gslcosim.contract.messages import MountSample, Reading
from gslcosim.scenario.models.sensors import SENSOR_BLOCKS, Anemometer3dSpec, AnemometerSpec
from gslcosim_services.sensing.models.base import SensorKind, new_reading

QUANTITY = "apparent_wind"
UNIT = "m/s, rad"


class Anemometer:
    """Measures the horizontal wind relative to the moving mount.

    values = (speed_m_s, direction_rad). The direction is where the wind comes from, in the world frame,
    counter-clockwise from +x, in (-pi, pi]: the instrument knows its own heading. In exactly calm air it is 0 + noise.

    speed = |a| + N(0, speed_noise), at least 0; direction = atan2(-a_y, -a_x) + N(0, direction_noise);
    a = wind - velocity of the mount, horizontal part [m/s].

    State: none. Draws in each tick: speed, then direction, from the sensor's own stream. Noise defaults are 0.01 m/s
    and 0.1 rad (GADEN's, which takes a tenth of the latter for the speed). No lag. Bias, drift, `noise_std` and
    `max_value` of the scenario are those of the speed.

    Source:
        GADEN, simulated_anemometer/src/fake_anemometer.cpp; GSL-Bench for the apparent wind.
    Deviation:
        GADEN 2 reports the square of the speed and the direction in the sensor's frame.
    Held by:
        tests/unit/services/sensing/test_anemometer.py
    """

    def __init__(self, spec: AnemometerSpec, rng: np.random.Generator) -> None:
        self._sensor = spec.name
        self._speed_noise_m_s = spec.speed_noise_std_m_s
        self._direction_noise_rad = spec.direction_noise_std_rad
        self._rng = rng

    def read(self, sample: MountSample, mount_velocity_world_m_s: Vec3) -> Reading:
        """Return speed and direction at the end of the tick; see `SensorModel.read`."""
        apparent_x = sample.wind_world_m_s[0] - mount_velocity_world_m_s[0]
        apparent_y = sample.wind_world_m_s[1] - mount_velocity_world_m_s[1]
        speed_draw, direction_draw = self._rng.standard_normal(2).tolist()
        speed_m_s = math.hypot(apparent_x, apparent_y) + self._speed_noise_m_s * speed_draw
        # 0.0 - a instead of -a: negative zeros would turn calm air into wind from the west.
        direction_rad = math.atan2(0.0 - apparent_y, 0.0 - apparent_x) + self._direction_noise_rad * direction_draw
        return new_reading(
            sensor=self._sensor,
            quantity=QUANTITY,
            unit=UNIT,
            values=(max(0.0, speed_m_s), _wrap_angle(direction_rad)),
        )


class Anemometer3d:
    """Measures the whole wind relative to the moving mount: values = (x, y, z) in world directions [m/s].

    Each component of wind - velocity of the mount with N(0, speed_noise). State: none. Draws x, y, z in each tick.
    No lag.

    Held by:
        tests/unit/services/sensing/test_anemometer.py
    """

    def __init__(self, spec: Anemometer3dSpec, rng: np.random.Generator) -> None:
        self._sensor = spec.name
        self._noise_m_s = spec.speed_noise_std_m_s
        self._rng = rng

    def read(self, sample: MountSample, mount_velocity_world_m_s: Vec3) -> Reading:
        """Return the apparent wind at the end of the tick; see `SensorModel.read`."""
        draws = self._rng.standard_normal(3).tolist()
        values = tuple(
            wind - velocity + self._noise_m_s * draw
            for wind, velocity, draw in zip(sample.wind_world_m_s, mount_velocity_world_m_s, draws, strict=True)
        )
        return new_reading(sensor=self._sensor, quantity=QUANTITY, unit="m/s", values=values)


def _wrap_angle(angle_rad: float) -> float:
    # Into (-pi, pi]; an angle that is there already keeps its last digit.
    while angle_rad > math.pi:
        angle_rad -= 2.0 * math.pi
    while angle_rad <= -math.pi:
        angle_rad += 2.0 * math.pi
    return angle_rad


def _build(spec: AnemometerSpec, tick_s: float, rng: np.random.Generator) -> Anemometer:
    del tick_s  # no lag
    return Anemometer(spec, rng)


ANEMOMETER = SensorKind(
    name="anemometer",
    settings=SENSOR_BLOCKS["anemometer"],
    quantity=QUANTITY,
    unit=UNIT,
    description="Two-axis anemometer: values = (speed_m_s, direction_rad) of the apparent wind; direction is where it "
    "comes from, world frame, counter-clockwise from +x.",
    build=_build,
    n_with_errors=1,
    least_value=0.0,
)


def _build_3d(spec: Anemometer3dSpec, tick_s: float, rng: np.random.Generator) -> Anemometer3d:
    del tick_s  # no lag
    return Anemometer3d(spec, rng)


ANEMOMETER_3D = SensorKind(
    name="anemometer_3d",
    settings=SENSOR_BLOCKS["anemometer_3d"],
    quantity=QUANTITY,
    unit="m/s",
    description="Three-axis anemometer: values = (x, y, z) of the apparent wind in m/s, world frame.",
    build=_build_3d,
)
