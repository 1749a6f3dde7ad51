"""Ultrasonic anemometers: the apparent wind of a moving vehicle, in world directions."""

import math
from collections.abc import MutableSequence, Sequence
from typing import Any

from gslcosim.base.scalar_kernels import next_normal, norm2, scalar_kernel
from gslcosim.scenario.models.sensors import SENSOR_BLOCKS, Anemometer3dSpec, AnemometerSpec
from gslcosim_services.sensing.models.base import KernelSensorKind, SensorKernel

QUANTITY = "apparent_wind"
UNIT = "m/s, rad"


@scalar_kernel
def measure_planar_wind(
    parameters: Sequence[float],
    state: MutableSequence[float],
    ppm: Sequence[float],
    wind_m_s: Sequence[float],
    velocity_m_s: Sequence[float],
    stream: Any,
    values: MutableSequence[float],
) -> bool:
    """Measure the horizontal wind relative to the moving mount.

    values = (speed_m_s, direction_rad). The direction is where the wind comes from, in the world frame,
    counter-clockwise from +x, in (-pi, pi]: the instrument knows its own heading. In exactly calm air it is 0 + noise.

    speed = |a| + N(0, speed_noise), at least 0; direction = atan2(-a_y, -a_x) + N(0, direction_noise);
    a = wind - velocity of the mount, horizontal part [m/s]; parameters = (speed_noise, direction_noise) [m/s, rad]

    State: none. Draws in each tick: speed, then direction. Noise defaults are 0.01 m/s and 0.1 rad (GADEN's, which
    takes a tenth of the latter for the speed). No lag. Bias, drift, `noise_std` and `max_value` of the scenario are
    those of the speed. See `SensorKernel` for the arguments.

    Source:
        GADEN, simulated_anemometer/src/fake_anemometer.cpp; GSL-Bench for the apparent wind.
    Deviation:
        GADEN 2 reports the square of the speed and the direction in the sensor's frame.
    Held by:
        tests/unit/services/sensing/test_anemometer.py
    """
    apparent_x, apparent_y = wind_m_s[0] - velocity_m_s[0], wind_m_s[1] - velocity_m_s[1]
    speed_m_s = norm2(apparent_x, apparent_y) + parameters[0] * next_normal(stream)
    # 0.0 - a instead of -a: negative zeros would turn calm air into wind from the west.
    direction_rad = math.atan2(0.0 - apparent_y, 0.0 - apparent_x) + parameters[1] * next_normal(stream)
    values[0] = speed_m_s if speed_m_s > 0.0 else 0.0
    # Into (-pi, pi]; an angle that is there already keeps its last digit.
    while direction_rad > math.pi:
        direction_rad -= 2.0 * math.pi
    while direction_rad <= -math.pi:
        direction_rad += 2.0 * math.pi
    values[1] = direction_rad
    return False


@scalar_kernel
def measure_wind(
    parameters: Sequence[float],
    state: MutableSequence[float],
    ppm: Sequence[float],
    wind_m_s: Sequence[float],
    velocity_m_s: Sequence[float],
    stream: Any,
    values: MutableSequence[float],
) -> bool:
    """Measure the whole wind relative to the moving mount: values = (x, y, z) in world directions [m/s].

    Each component of wind - velocity of the mount with N(0, speed_noise); parameters = (speed_noise,) [m/s].
    State: none. Draws x, y, z in each tick. No lag. See `SensorKernel` for the arguments.

    Held by:
        tests/unit/services/sensing/test_anemometer.py
    """
    for axis in range(3):
        values[axis] = wind_m_s[axis] - velocity_m_s[axis] + parameters[0] * next_normal(stream)
    return False


def _planar_kernel(spec: AnemometerSpec, gases: tuple[str, ...], tick_s: float) -> SensorKernel:
    del gases, tick_s  # no lag
    noise = (spec.speed_noise_std_m_s, spec.direction_noise_std_rad)
    return SensorKernel(advance=measure_planar_wind, parameters=noise, n_values=2)


ANEMOMETER = KernelSensorKind(
    name="anemometer",
    settings=SENSOR_BLOCKS["anemometer"],
    quantity=QUANTITY,
    unit=UNIT,
    description="Two-axis anemometer: values = (speed_m_s, direction_rad) of the apparent wind; direction is where it "
    "comes from, world frame, counter-clockwise from +x.",
    kernel=_planar_kernel,
    n_with_errors=1,
    least_value=0.0,
)


def _kernel_3d(spec: Anemometer3dSpec, gases: tuple[str, ...], tick_s: float) -> SensorKernel:
    del gases, tick_s  # no lag
    return SensorKernel(advance=measure_wind, parameters=(spec.speed_noise_std_m_s,), n_values=3)


ANEMOMETER_3D = KernelSensorKind(
    name="anemometer_3d",
    settings=SENSOR_BLOCKS["anemometer_3d"],
    quantity=QUANTITY,
    unit="m/s",
    description="Three-axis anemometer: values = (x, y, z) of the apparent wind in m/s, world frame.",
    kernel=_kernel_3d,
)
