"""Settings of on-board sensors: their errors and what they look at; every field with unit and default."""

import math
from typing import Annotated, Literal

from pydantic import Field

from gslcosim.base.quantities import Vec3
from gslcosim.scenario.models.base import NonNegative, Positive, Spec
from gslcosim.scenario.models.sensor_base import (
    BeamSensorSpec,
    MeasuringSensorSpec,
    OnBoardSensorSpec,
    RaySensorSpec,
    ReachingSensorSpec,
    TurnedSensorSpec,
)

Pixels = Annotated[int, Field(ge=8, le=2048)]
Rays = Annotated[int, Field(ge=1, le=4096)]


class ImuSpec(Spec):
    """Errors of an IMU; those of the sensors of Pegasus (Jacinto et al. 2024), which are of the ADIS16448's kind.

    Noise densities [rad/s/sqrt(Hz), m/s^2/sqrt(Hz)], random walks of the biases [rad/s^2/sqrt(Hz), m/s^3/sqrt(Hz)],
    after whose correlation times [s] they are forgotten, and the spread of the biases at the start. `rate_hz` is how
    many samples there are a second (absent: one for each physics step).
    """

    rate_hz: Positive | None = Field(default=None, description="samples per second (absent: one for each physics step)")
    gyro_noise_density: NonNegative = Field(
        default=3.3937e-4, description="noise density of the angular velocity [rad/s/sqrt(Hz)]"
    )
    gyro_random_walk: NonNegative = Field(default=3.8785e-5, description="random walk of its bias [rad/s^2/sqrt(Hz)]")
    gyro_correlation_s: Positive = Field(default=1000.0, description="time after which that bias is forgotten")
    gyro_start_bias_rad_s: NonNegative = Field(default=0.0087, description="spread of that bias at the start")
    accelerometer_noise_density: NonNegative = Field(
        default=0.004, description="noise density of the specific force [m/s^2/sqrt(Hz)]"
    )
    accelerometer_random_walk: NonNegative = Field(
        default=0.006, description="random walk of its bias [m/s^3/sqrt(Hz)]"
    )
    accelerometer_correlation_s: Positive = Field(default=300.0, description="time after which that bias is forgotten")
    accelerometer_start_bias_m_s2: NonNegative = Field(default=0.196, description="spread of that bias at the start")
    max_rate_rad_s: Positive = Field(default=34.9, description="limit of the angular velocity")
    max_acceleration_m_s2: Positive = Field(default=156.9, description="limit of the specific force")


class GpsSpec(Spec):
    """Errors of a GPS receiver: a wandering offset and white noise on each position and velocity, horizontal, vertical.

    Random walk of the offset [m/sqrt(s)], forgotten after `correlation_s`; white noise [m, m/s] of each fix.
    """

    random_walk_xy: NonNegative = Field(default=0.008, description="random walk of the horizontal offset [m/sqrt(s)]")
    random_walk_z: NonNegative = Field(default=0.016, description="random walk of the vertical offset [m/sqrt(s)]")
    correlation_s: Positive = Field(default=60.0, description="time after which the offset is forgotten")
    position_noise_xy_m: NonNegative = Field(default=2e-4, description="white noise of the horizontal position")
    position_noise_z_m: NonNegative = Field(default=4e-4, description="white noise of the height")
    velocity_noise_xy_m_s: NonNegative = Field(default=0.0126, description="white noise of the horizontal velocity")
    velocity_noise_z_m_s: NonNegative = Field(default=0.0253, description="white noise of the vertical velocity")


class BarometerSpec(Spec):
    """Noise [Pa] and drift [Pa/s] of a barometer, and the pressure and temperature where the world's z is 0."""

    noise_std_pa: NonNegative = Field(default=1.0, description="noise of the pressure")
    drift_pa_s: float = Field(default=0.0, description="drift of the pressure")
    ground_pressure_pa: Positive = Field(default=101325.0, description="pressure at z = 0")
    ground_temperature_k: Positive = Field(default=288.15, description="temperature at z = 0")


class MagnetometerSpec(Spec):
    """Field [uT] in the world's axes (east, north, up) and errors of a magnetometer.

    Noise density [uT/sqrt(Hz)], random walk of the bias [uT/s/sqrt(Hz)], forgotten after `correlation_s`.
    """

    field_world_ut: Vec3 = Field(default=(0.7, 19.3, -45.5), description="the earth's field: east, north, up [uT]")
    noise_density: NonNegative = Field(default=0.04, description="noise density [uT/sqrt(Hz)]")
    random_walk: NonNegative = Field(default=6.4e-4, description="random walk of the bias [uT/s/sqrt(Hz)]")
    correlation_s: Positive = Field(default=600.0, description="time after which the bias is forgotten")


class PoseSpec(Spec):
    """White noise of a localization system: position [m], attitude [rad] about each body axis, velocity [m/s]."""

    position_noise_m: NonNegative = Field(default=0.01, description="white noise of the position")
    attitude_noise_rad: NonNegative = Field(
        default=0.01, description="white noise of the attitude about each body axis"
    )
    velocity_noise_m_s: NonNegative = Field(default=0.02, description="white noise of the velocity")


class AzimuthsSpec(Spec):
    """Rays of a lidar of one level: azimuths evenly over `azimuth_span_rad`.

    The span is centred on the sensor's x axis; a full turn begins at its back.
    """

    n_azimuths: Rays = Field(default=360, description="number of rays in a level")
    azimuth_span_rad: Annotated[float, Field(gt=0, le=2 * math.pi)] = Field(
        default=2 * math.pi, description="angle that they span"
    )


class ElevationsSpec(AzimuthsSpec):
    """Rays of a lidar of several levels: elevations evenly over `elevation_span_rad`, which is centred too."""

    n_elevations: Annotated[int, Field(ge=1, le=256)] = Field(default=16, description="number of levels")
    elevation_span_rad: Annotated[float, Field(gt=0, le=math.pi)] = Field(
        default=math.pi / 6, description="angle that the levels span"
    )


class PictureSpec(Spec):
    """Picture of a camera: its size [pixels] and vertical field of view [rad]; depths are PNG of 16-bit millimetres."""

    width_px: Pixels = Field(default=64, description="width of the picture")
    height_px: Pixels = Field(default=64, description="height of the picture")
    vertical_fov_rad: Annotated[float, Field(gt=0, lt=3.0)] = Field(default=1.2, description="vertical field of view")


class ColourPictureSpec(PictureSpec):
    """Picture in colours, and how it travels."""

    encoding: Literal["png", "jpeg"] = Field(default="png", description="how colours travel")


class ImuSensorSpec(OnBoardSensorSpec):
    """An inertial measurement unit."""

    imu: ImuSpec = Field(default=ImuSpec(), description="its errors")


class GpsSensorSpec(OnBoardSensorSpec):
    """A GPS receiver."""

    gps: GpsSpec = Field(default=GpsSpec(), description="its errors")


class BarometerSensorSpec(MeasuringSensorSpec, OnBoardSensorSpec):
    """A barometer."""

    barometer: BarometerSpec = Field(default=BarometerSpec(), description="its errors")


class MagnetometerSensorSpec(MeasuringSensorSpec, OnBoardSensorSpec):
    """A magnetometer."""

    magnetometer: MagnetometerSpec = Field(default=MagnetometerSpec(), description="the field and its errors")


class PoseSensorSpec(OnBoardSensorSpec):
    """A localization system; the pose that an agent gets is then this one."""

    pose: PoseSpec = Field(default=PoseSpec(), description="its errors")


class RangeFinderSpec(MeasuringSensorSpec, RaySensorSpec, BeamSensorSpec):
    """A range finder of one beam."""


class FourRangeFindersSpec(MeasuringSensorSpec, RaySensorSpec):
    """Range finders to the front, left, back and right."""


class LidarSensorSpec(RaySensorSpec):
    """A lidar of one level."""

    lidar: AzimuthsSpec = Field(default=AzimuthsSpec(), description="its rays")


class Lidar3dSensorSpec(LidarSensorSpec):
    """A lidar of several levels."""

    lidar: ElevationsSpec = ElevationsSpec()  # pyright: ignore[reportIncompatibleVariableOverride]


class BumpSensorSpec(OnBoardSensorSpec):
    """A bumper."""


class CameraSensorSpec(TurnedSensorSpec, OnBoardSensorSpec):
    """A camera of any kind."""

    camera: PictureSpec = Field(default=PictureSpec(), description="its picture")


class ColourCameraSpec(CameraSensorSpec):
    """A camera of colours."""

    camera: ColourPictureSpec = ColourPictureSpec()  # pyright: ignore[reportIncompatibleVariableOverride]


class DepthCameraSpec(CameraSensorSpec, ReachingSensorSpec):
    """A camera of depths."""
