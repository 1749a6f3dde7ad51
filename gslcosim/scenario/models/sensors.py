"""The sensors of a scenario; every field with unit, default and range."""

from functools import cache
from importlib.metadata import entry_points
from typing import Self

from pydantic import model_validator

from gslcosim.scenario.models.onboard import OnBoardFields
from gslcosim.scenario.models.rules import broken_rule
from gslcosim.scenario.models.spec import Name, NonNegative, Positive, Vec3, shown

# Cameras, which a core of their own renders.
CAMERA_SENSORS = ("camera", "depth_camera")
# Sensors of the vehicle itself and of what is around it: they look at bodies and the scene, not at gas and wind.
ON_BOARD_SENSORS = (
    "imu", "gps", "barometer", "magnetometer", "pose", "range_finder", "four_range_finders", "lidar_2d", "lidar_3d",
    "bump", *CAMERA_SENSORS,
)  # fmt: skip
# The sensors that there are; the table with their models is in gslcosim.sensing.
SENSORS = (
    "tgs2600", "tgs2602", "tgs2610", "tgs2611", "tgs2612", "tgs2620", "pid", "threshold", "binary", "hit_counter",
    "averaging", "second_order", "tdlas", "anemometer", "anemometer_3d", *ON_BOARD_SENSORS,
)  # fmt: skip
# Third parties add theirs under this name; each entry point is a `gslcosim.sensing.models.SensorKind`.
SENSOR_ENTRY_POINTS = "gslcosim.sensors"


@cache
def sensor_names() -> tuple[str, ...]:
    """Return the names of all sensor models: gslcosim's and those of installed packages."""
    return (*SENSORS, *sorted(point.name for point in entry_points(group=SENSOR_ENTRY_POINTS)))


class SensorSpec(OnBoardFields):
    """A sensor on the vehicle; `mount_m` is its place in the body frame [m].

    Any sensor, in the unit of its readings: `period_s` between readings (absent: every tick), `delay_s`, `noise_std`,
    `bias`, `drift_per_s` added to the bias, `max_value` at which it saturates, `warm_up_s` until it measures.
    Some only: `speed_noise_std_m_s`, `direction_noise_std_rad` of anemometers; `threshold_ppm` of threshold, binary;
    `hits_per_s_per_ppm` of hit_counter; `averaging_s` of averaging; the two time constants each of `response_s` and
    `recovery_s` of second_order; `beam_body`, the direction of the beam in the body frame, of tdlas and range_finder;
    `max_range_m` of these, lidars and depth_camera; `mount_rpy_rad` of what looks around: its axes are turned against
    the body's by roll, then pitch, then yaw about fixed axes. Blocks such as `imu` are those of the models so named.
    """

    model: str
    name: Name
    mount_m: Vec3 = (0.0, 0.0, 0.0)
    speed_noise_std_m_s: NonNegative = 0.01
    direction_noise_std_rad: NonNegative = 0.1
    period_s: Positive | None = None
    delay_s: NonNegative = 0.0
    noise_std: NonNegative = 0.0
    bias: float = 0.0
    drift_per_s: float = 0.0
    max_value: Positive | None = None
    threshold_ppm: NonNegative = 0.1
    hits_per_s_per_ppm: Positive = 1.0
    averaging_s: Positive = 1.0
    response_s: tuple[Positive, Positive] = (1.0, 2.0)
    recovery_s: tuple[Positive, Positive] = (2.0, 10.0)
    warm_up_s: NonNegative = 0.0
    beam_body: Vec3 = (1.0, 0.0, 0.0)
    max_range_m: Positive = 30.0

    @model_validator(mode="after")
    def _check_beam(self) -> Self:
        if not any(self.beam_body):
            raise broken_rule(
                key="beam_body",
                expected="a direction that is not zero",
                found=shown(self.beam_body),
                remedy="For example [1, 0, 0], ahead.",
            )
        return self
