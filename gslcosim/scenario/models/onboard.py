"""Settings of on-board sensors: how they err, and what they look at; every field with unit and default."""

import math
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from gslcosim.scenario.models.rules import broken_rule
from gslcosim.scenario.models.spec import NonNegative, Positive, Spec, Vec3

Pixels = Annotated[int, Field(ge=8, le=2048)]
Rays = Annotated[int, Field(ge=1, le=4096)]


class ImuSpec(Spec):
    """Errors of an IMU; those of the sensors of Pegasus (Jacinto et al. 2024), which are of the ADIS16448's kind.

    Noise densities [rad/s/sqrt(Hz), m/s^2/sqrt(Hz)], random walks of the biases [rad/s^2/sqrt(Hz), m/s^3/sqrt(Hz)],
    after whose correlation times [s] they are forgotten, and the spread of the biases at the start. `rate_hz` is how
    many samples there are a second (absent: one for each physics step).
    """

    rate_hz: Positive | None = None
    gyro_noise_density: NonNegative = 3.3937e-4
    gyro_random_walk: NonNegative = 3.8785e-5
    gyro_correlation_s: Positive = 1000.0
    gyro_start_bias_rad_s: NonNegative = 0.0087
    accelerometer_noise_density: NonNegative = 0.004
    accelerometer_random_walk: NonNegative = 0.006
    accelerometer_correlation_s: Positive = 300.0
    accelerometer_start_bias_m_s2: NonNegative = 0.196
    max_rate_rad_s: Positive = 34.9
    max_acceleration_m_s2: Positive = 156.9


class GpsSpec(Spec):
    """Errors of a GPS receiver: a wandering offset and white noise on each position and velocity, horizontal, vertical.

    Random walk of the offset [m/sqrt(s)], forgotten after `correlation_s`; white noise [m, m/s] of each fix.
    """

    random_walk_xy: NonNegative = 0.008
    random_walk_z: NonNegative = 0.016
    correlation_s: Positive = 60.0
    position_noise_xy_m: NonNegative = 2e-4
    position_noise_z_m: NonNegative = 4e-4
    velocity_noise_xy_m_s: NonNegative = 0.0126
    velocity_noise_z_m_s: NonNegative = 0.0253


class BarometerSpec(Spec):
    """Noise [Pa] and drift [Pa/s] of a barometer, and the pressure and temperature where the world's z is 0."""

    noise_std_pa: NonNegative = 1.0
    drift_pa_s: float = 0.0
    ground_pressure_pa: Positive = 101325.0
    ground_temperature_k: Positive = 288.15


class MagnetometerSpec(Spec):
    """Field [uT] in the world's axes (east, north, up) and errors of a magnetometer.

    Noise density [uT/sqrt(Hz)], random walk of the bias [uT/s/sqrt(Hz)], forgotten after `correlation_s`.
    """

    field_world_ut: Vec3 = (0.7, 19.3, -45.5)
    noise_density: NonNegative = 0.04
    random_walk: NonNegative = 6.4e-4
    correlation_s: Positive = 600.0


class PoseSpec(Spec):
    """White noise of a localization system: position [m], attitude [rad] about each body axis, velocity [m/s]."""

    position_noise_m: NonNegative = 0.01
    attitude_noise_rad: NonNegative = 0.01
    velocity_noise_m_s: NonNegative = 0.02


class LidarSpec(Spec):
    """Rays of a lidar: azimuths evenly over `azimuth_span_rad`, elevations evenly over `elevation_span_rad`.

    Both spans are centred on the sensor's x axis; a full turn begins at its back. Absent numbers are the model's.
    """

    n_azimuths: Rays = 360
    n_elevations: Annotated[int, Field(ge=1, le=256)] | None = None
    azimuth_span_rad: Annotated[float, Field(gt=0, le=2 * math.pi)] = 2 * math.pi
    elevation_span_rad: Annotated[float, Field(gt=0, le=math.pi)] = math.pi / 6


class CameraSpec(Spec):
    """Picture of a camera: size [pixels], vertical field of view [rad], and how it travels.

    Colours travel as `png` or `jpeg`; depths always as PNG of 16-bit millimetres.
    """

    width_px: Pixels = 64
    height_px: Pixels = 64
    vertical_fov_rad: Annotated[float, Field(gt=0, lt=3.0)] = 1.2
    encoding: Literal["png", "jpeg"] = "png"


# Which block of settings belongs to which models.
BLOCKS: dict[str, tuple[str, ...]] = {
    "imu": ("imu",),
    "gps": ("gps",),
    "barometer": ("barometer",),
    "magnetometer": ("magnetometer",),
    "pose": ("pose",),
    "lidar": ("lidar_2d", "lidar_3d"),
    "camera": ("camera", "depth_camera"),
}
# The usual errors of a scalar that do not suit readings of several kinds of numbers.
_ERRORS = ("noise_std", "bias", "drift_per_s", "max_value")
_WITHOUT: dict[str, tuple[str, ...]] = {
    **dict.fromkeys(("imu", "gps", "pose", "camera", "depth_camera", "bump"), _ERRORS),
    **dict.fromkeys(("lidar_2d", "lidar_3d"), _ERRORS[1:]),
}
# On-board sensors whose axes can be turned.
TURNED = ("range_finder", "four_range_finders", "lidar_2d", "lidar_3d", "camera", "depth_camera")


class OnBoardFields(Spec):
    """The part of a sensor's settings that only on-board sensors have."""

    model: str
    mount_rpy_rad: Vec3 = (0.0, 0.0, 0.0)
    imu: ImuSpec = ImuSpec()
    gps: GpsSpec = GpsSpec()
    barometer: BarometerSpec = BarometerSpec()
    magnetometer: MagnetometerSpec = MagnetometerSpec()
    pose: PoseSpec = PoseSpec()
    lidar: LidarSpec = LidarSpec()
    camera: CameraSpec = CameraSpec()

    @model_validator(mode="after")
    def _check_block(self) -> Self:
        given = {key for key in self.model_fields_set if getattr(self, key) != type(self).model_fields[key].default}
        useless = [key for key in given if key in BLOCKS and self.model not in BLOCKS[key]]
        useless += [key for key in _WITHOUT.get(self.model, ()) if key in given]
        if "mount_rpy_rad" in given and self.model not in TURNED:
            useless.append("mount_rpy_rad")
        if useless:
            key = min(useless)
            raise broken_rule(
                key=key,
                expected=f"settings that a sensor of model {self.model} has",
                found=key,
                remedy="Leave it out; docs/sensors.md lists what belongs to which model.",
            )
        return self
