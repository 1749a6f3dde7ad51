"""Ultrasonic anemometers: the apparent wind of a moving vehicle, in world directions."""

import math
from typing import Any

from gslcosim.base import elementary
from gslcosim.base.scalar_kernels import next_normal, norm2, scalar_kernel
from gslcosim.scenario.models.sensors import Anemometer3dSpec, AnemometerSpec
from gslcosim_services.sensing.models.base import Floats, KernelSensorKind, SensorKernel, follow, lag_frac, make_kind

QUANTITY = "apparent_wind"
UNIT = "m/s, rad"


@scalar_kernel
def measure_planar_wind(
    parameters: Floats, state: Floats, ppm: Floats, wind_m_s: Floats, velocity_m_s: Floats, stream: Any, values: Floats
) -> bool:
    """Measure the horizontal wind relative to the moving mount.

    values = (speed_m_s, direction_rad). The direction is that from which the wind comes, in the world frame,
    counter-clockwise from +x, in (-pi, pi]: the instrument has its own heading. In exactly calm air it is 0 + noise.

    speed = |b| + N(0, speed_noise), at least 0; direction = atan2(-b_y, -b_x) + N(0, direction_noise);
    b follows a by `lag_frac` of the gap in each tick, a = wind - velocity of the mount, horizontal part [m/s];
    parameters = (lag_frac, speed_noise, direction_noise) [1, m/s, rad]

    State: whether it has begun, b. Draws in each tick: speed, then direction. Noise defaults are 0.01 m/s and 0.1 rad
    (GADEN's, which takes a tenth of the latter for the speed). Bias, drift, `noise_std`, `gain_spread`, `resolution`
    and `max_value` of the scenario are those of the speed. See `SensorKernel` for the arguments.

    Source:
        GADEN, simulated_anemometer/src/fake_anemometer.cpp; GSL-Bench for the apparent wind.
    Deviation:
        GADEN 2 reports the square of the speed and the direction in the sensor's frame.
    Held by:
        tests/unit/services/sensing/test_anemometer.py
    """
    frac = parameters[0] if state[0] != 0.0 else 1.0
    state[0] = 1.0
    apparent_x = state[1] = follow(state[1], wind_m_s[0] - velocity_m_s[0], frac)
    apparent_y = state[2] = follow(state[2], wind_m_s[1] - velocity_m_s[1], frac)
    speed_m_s = norm2(apparent_x, apparent_y) + parameters[1] * next_normal(stream)
    # 0.0 - a instead of -a: negative zeros would turn calm air into wind from the west.
    direction_rad = elementary.atan2(0.0 - apparent_y, 0.0 - apparent_x) + parameters[2] * next_normal(stream)
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
    parameters: Floats, state: Floats, ppm: Floats, wind_m_s: Floats, velocity_m_s: Floats, stream: Any, values: Floats
) -> bool:
    """Measure the whole wind relative to the moving mount: values = (x, y, z) in world directions [m/s].

    Each component follows wind - velocity of the mount by `lag_frac` of the gap in each tick, with N(0, speed_noise) on
    the values; parameters = (lag_frac, speed_noise) [1, m/s].
    State: whether it has begun, the lagged wind. Draws x, y, z in each tick. See `SensorKernel` for the arguments.

    Held by:
        tests/unit/services/sensing/test_anemometer.py
    """
    frac = parameters[0] if state[0] != 0.0 else 1.0
    state[0] = 1.0
    for axis in range(3):
        state[1 + axis] = follow(state[1 + axis], wind_m_s[axis] - velocity_m_s[axis], frac)
        values[axis] = state[1 + axis] + parameters[1] * next_normal(stream)
    return False


def _planar_kernel(spec: AnemometerSpec, gases: tuple[str, ...], tick_s: float) -> SensorKernel:
    del gases
    numbers = (lag_frac(spec.t90_s, tick_s), spec.speed_noise_std_m_s, spec.direction_noise_std_rad)
    return SensorKernel(advance=measure_planar_wind, parameters=numbers, state=(0.0,) * 3, n_values=2)


ANEMOMETER = make_kind(
    KernelSensorKind,
    "anemometer",
    QUANTITY,
    UNIT,
    "Two-axis anemometer: values = (speed_m_s, direction_rad) of the apparent wind; the direction "
    "it comes from, world frame, counter-clockwise from +x.",
    kernel=_planar_kernel,
    n_with_errors=1,
    least_value=0.0,
)


def _kernel_3d(spec: Anemometer3dSpec, gases: tuple[str, ...], tick_s: float) -> SensorKernel:
    del gases
    numbers = (lag_frac(spec.t90_s, tick_s), spec.speed_noise_std_m_s)
    return SensorKernel(advance=measure_wind, parameters=numbers, state=(0.0,) * 4, n_values=3)


ANEMOMETER_3D = make_kind(
    KernelSensorKind,
    "anemometer_3d",
    QUANTITY,
    "m/s",
    "Three-axis anemometer: values = (x, y, z) of the apparent wind in m/s, world frame.",
    kernel=_kernel_3d,
)
