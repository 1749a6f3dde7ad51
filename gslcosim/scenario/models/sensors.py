"""Sensors by the names of their models, and the settings of each; every field with unit, default and range."""

import math
from functools import cache
from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import Field, SerializeAsAny, TypeAdapter, create_model, model_validator

from gslcosim.base.box_rules import format_point
from gslcosim.base.gases import PID_LAMPS_EV
from gslcosim.base.plugins import EntryPoints, PluginError
from gslcosim.base.problems import broken_rule_error
from gslcosim.base.quantities import Vec3
from gslcosim.scenario.models.base import Name, NonNegative, OneOf, Positive, Spec

# Errors that an ideal instrument lacks, in blocks that have them.
_ERRORS = (
    "noise_std", "gain_spread", "drift_spread_per_s", "resolution", "t90_s", "noise_frac", "baseline_walk",
    "speed_noise_std_m_s", "direction_noise_std_rad",
)  # fmt: skip
IDEAL_SUFFIX = "_ideal"
Pixels = Annotated[int, Field(ge=8, le=2048)]
Rays = Annotated[int, Field(ge=1, le=4096)]
# Entry points of other packages' sensors; each is a `gslcosim_services.sensing.models.SensorKind`.
SENSOR_ENTRY_POINTS = "gslcosim.sensors"
SENSOR_OFFERS = EntryPoints(group=SENSOR_ENTRY_POINTS, what="sensor")
# Descriptions of settings whose default differs between models.
_NOISE = "standard deviation of the white noise, in the unit of its readings"
_GAIN_SPREAD = "spread of units: standard deviation of the logarithm of a factor on each value"
_DRIFT_SPREAD = "spread of the drifts of units, in the unit of its readings"
_RESOLUTION = "resolution, in the unit of its readings (0: none)"
_T90 = "response time T90 to a step (0: none)"


class SensorSpec(Spec):
    """Base of all sensors; the block of a model adds the settings of that model alone.

    With `has_estimates`, a second reading has the mixing ratio that the first one suggests, under the sensor's name
    with the ending `_ppm`.
    """

    has_estimates: ClassVar[bool] = False

    model: str = Field(description="model of the sensor")
    name: Name = Field(description="name of its readings")
    mount_m: Vec3 = Field(default=(0.0, 0.0, 0.0), description="position in the body frame")
    period_s: Positive | None = Field(default=None, description="time between readings (absent: every tick)")
    delay_s: NonNegative = Field(default=0.0, description="age of the sample that a reading shows")
    warm_up_s: NonNegative = Field(default=0.0, description="time from the start to the first valid reading")


class NoisySensorSpec(SensorSpec):
    """A sensor whose values have white noise, in the unit of its readings."""

    noise_std: NonNegative = Field(default=0.0, description=_NOISE)


class MeasuringSensorSpec(NoisySensorSpec):
    """A sensor with the usual errors of an instrument, in the unit of its readings."""

    bias: float = Field(default=0.0, description="offset of each value, in the unit of its readings")
    drift_per_s: float = Field(default=0.0, description="growth of the bias per second, in the unit of its readings")
    max_value: Positive | None = Field(
        default=None, description="limit of the absolute value, in the unit of its readings (absent: none)"
    )
    gain_spread: NonNegative = Field(default=0.0, description=_GAIN_SPREAD)
    drift_spread_per_s: NonNegative = Field(default=0.0, description=_DRIFT_SPREAD)
    resolution: NonNegative = Field(default=0.0, description=_RESOLUTION)


class OnBoardSensorSpec(SensorSpec):
    """A sensor of the vehicle itself or of its surroundings: it measures bodies and the scene, not gas and wind."""


class TurnedSensorSpec(SensorSpec):
    """A sensor with a direction of view: its axes can be turned against the body's."""

    mount_rpy_rad: Vec3 = Field(
        default=(0.0, 0.0, 0.0), description="roll, then pitch, then yaw of its axes about the body's fixed axes"
    )


class ReachingSensorSpec(SensorSpec):
    """A sensor with a limited range."""

    max_range_m: Positive = Field(default=30.0, description="range")


class BeamSensorSpec(ReachingSensorSpec):
    """A sensor along one beam."""

    beam_body: Vec3 = Field(default=(1.0, 0.0, 0.0), description="direction of the beam in the body frame")

    @model_validator(mode="after")
    def _check_beam(self) -> Self:
        if not any(self.beam_body):
            raise broken_rule_error(
                key="beam_body",
                expected="a direction that is not zero",
                found=format_point(self.beam_body),
                remedy="For example [1, 0, 0], ahead.",
            )
        return self


class RaySensorSpec(NoisySensorSpec, TurnedSensorSpec, ReachingSensorSpec, OnBoardSensorSpec):
    """A range finder or lidar: it measures the distance of its surroundings along rays."""


class MoxSensorSpec(MeasuringSensorSpec):
    """A metal-oxide sensor; its figures are those of its model."""

    has_estimates: ClassVar[bool] = True

    gain_spread: NonNegative = Field(
        default=0.3, description="spread of units: standard deviation of the logarithm of R0"
    )
    noise_frac: NonNegative = Field(default=0.003, description="noise of the logarithm of its resistance")
    baseline_walk: NonNegative = Field(
        default=0.0004, description="random walk of the logarithm of its resistance [1/sqrt(s)]"
    )


class PidSensorSpec(MeasuringSensorSpec):
    """A photo-ionisation detector."""

    noise_std: NonNegative = Field(default=0.03, description=_NOISE)
    gain_spread: NonNegative = Field(default=0.05, description=_GAIN_SPREAD)
    drift_spread_per_s: NonNegative = Field(default=3e-5, description=_DRIFT_SPREAD)
    resolution: NonNegative = Field(default=0.1, description=_RESOLUTION)
    t90_s: NonNegative = Field(default=3.0, description=_T90)
    lamp_ev: Positive = Field(default=11.7, description="photon energy of the lamp: 10.6 or 11.7")

    @model_validator(mode="after")
    def _check_lamp(self) -> Self:
        if self.lamp_ev not in PID_LAMPS_EV:
            raise broken_rule_error(
                key="lamp_ev",
                expected="10.6 or 11.7, for which there are correction factors",
                found=f"{self.lamp_ev:g}",
                remedy="10.6 is the usual lamp; 11.7 sees more gases.",
            )
        return self


class ThresholdSensorSpec(MeasuringSensorSpec):
    """A sensor that compares the mixing ratio with a threshold: `threshold` and `binary`."""

    threshold_ppm: NonNegative = Field(default=0.1, description="threshold of the mixing ratio")


class HitCounterSpec(MeasuringSensorSpec):
    """A counter of hits of gas."""

    hits_per_s_per_ppm: Positive = Field(default=1.0, description="mean number of hits per second and ppm")


class AveragingSensorSpec(MeasuringSensorSpec):
    """A sensor that reports a mean over time."""

    averaging_s: Positive = Field(default=1.0, description="averaging time")


class SecondOrderSensorSpec(MeasuringSensorSpec):
    """A slow sensor: two lags in series, one pair of time constants up and one down."""

    response_s: tuple[Positive, Positive] = Field(
        default=(1.0, 2.0), description="two time constants while gas increases"
    )
    recovery_s: tuple[Positive, Positive] = Field(
        default=(2.0, 10.0), description="two time constants while gas decreases"
    )


class TdlasSensorSpec(MeasuringSensorSpec, BeamSensorSpec):
    """An open-path laser along a beam."""

    noise_std: NonNegative = Field(default=3.0, description=_NOISE)
    gain_spread: NonNegative = Field(default=0.05, description=_GAIN_SPREAD)
    resolution: NonNegative = Field(default=1.0, description=_RESOLUTION)
    t90_s: NonNegative = Field(default=0.1, description=_T90)


class Anemometer3dSpec(MeasuringSensorSpec):
    """An anemometer of three axes."""

    gain_spread: NonNegative = Field(default=0.01, description=_GAIN_SPREAD)
    resolution: NonNegative = Field(default=0.01, description=_RESOLUTION)
    t90_s: NonNegative = Field(default=0.25, description=_T90)
    speed_noise_std_m_s: NonNegative = Field(default=0.01, description="noise of the speed, or of each component")


class AnemometerSpec(Anemometer3dSpec):
    """An anemometer of two axes, which reports speed and direction."""

    direction_noise_std_rad: NonNegative = Field(default=0.1, description="noise of the direction")


# Block of the same instrument, by default without errors.
def _ideal(name: str, block: type[MeasuringSensorSpec]) -> type[MeasuringSensorSpec]:
    fields: dict[str, Any] = {
        key: (NonNegative, Field(default=0.0, description=block.model_fields[key].description))
        for key in _ERRORS
        if key in block.model_fields
    }
    doc = f"{block.__doc__} It is without errors unless some are given."
    return create_model(name, __base__=block, __module__=__name__, __doc__=doc, **fields)


IdealMoxSpec = _ideal("IdealMoxSpec", MoxSensorSpec)
IdealPidSpec = _ideal("IdealPidSpec", PidSensorSpec)
IdealTdlasSpec = _ideal("IdealTdlasSpec", TdlasSensorSpec)
IdealAnemometerSpec = _ideal("IdealAnemometerSpec", AnemometerSpec)
IdealAnemometer3dSpec = _ideal("IdealAnemometer3dSpec", Anemometer3dSpec)


class ImuSpec(Spec):
    """Errors of an IMU, from the sensors of Pegasus (Jacinto et al. 2024), which resemble an ADIS16448.

    Noise densities [rad/s/sqrt(Hz), m/s^2/sqrt(Hz)], random walks of the biases [rad/s^2/sqrt(Hz), m/s^3/sqrt(Hz)] with
    correlation times [s], and the spread of the biases at the start.
    """

    rate_hz: Positive | None = Field(default=None, description="samples per second (absent: one for each physics step)")
    gyro_noise_density: NonNegative = Field(
        default=3.3937e-4, description="noise density of the angular velocity [rad/s/sqrt(Hz)]"
    )
    gyro_random_walk: NonNegative = Field(default=3.8785e-5, description="random walk of its bias [rad/s^2/sqrt(Hz)]")
    gyro_correlation_s: Positive = Field(default=1000.0, description="correlation time of that bias")
    gyro_start_bias_rad_s: NonNegative = Field(default=0.0087, description="spread of that bias at the start")
    accelerometer_noise_density: NonNegative = Field(
        default=0.004, description="noise density of the specific force [m/s^2/sqrt(Hz)]"
    )
    accelerometer_random_walk: NonNegative = Field(
        default=0.006, description="random walk of its bias [m/s^3/sqrt(Hz)]"
    )
    accelerometer_correlation_s: Positive = Field(default=300.0, description="correlation time of that bias")
    accelerometer_start_bias_m_s2: NonNegative = Field(default=0.196, description="spread of that bias at the start")
    max_rate_rad_s: Positive = Field(default=34.9, description="limit of the angular velocity")
    max_acceleration_m_s2: Positive = Field(default=156.9, description="limit of the specific force")


class GpsSpec(Spec):
    """Errors of a GPS receiver: a wandering offset and white noise of position and velocity, horizontal and vertical.

    Random walk of the offset [m/sqrt(s)] with the correlation time `correlation_s`; white noise [m, m/s] of each fix.
    """

    random_walk_xy: NonNegative = Field(default=0.008, description="random walk of the horizontal offset [m/sqrt(s)]")
    random_walk_z: NonNegative = Field(default=0.016, description="random walk of the vertical offset [m/sqrt(s)]")
    correlation_s: Positive = Field(default=60.0, description="correlation time of the offset")
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
    """Field [uT] in world axes (east, north, up) and errors of a magnetometer.

    Noise density [uT/sqrt(Hz)], random walk of the bias [uT/s/sqrt(Hz)] with the correlation time `correlation_s`.
    """

    field_world_ut: Vec3 = Field(default=(0.7, 19.3, -45.5), description="the earth's field: east, north, up [uT]")
    noise_density: NonNegative = Field(default=0.04, description="noise density [uT/sqrt(Hz)]")
    random_walk: NonNegative = Field(default=6.4e-4, description="random walk of the bias [uT/s/sqrt(Hz)]")
    correlation_s: Positive = Field(default=600.0, description="correlation time of the bias")


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
        default=2 * math.pi, description="angle that the azimuths span"
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

    encoding: Literal["png", "jpeg"] = Field(default="png", description="encoding of the image")


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
    """A localization system; its pose is then the one in the agent's observations."""

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


# Block of settings of each model; the models are in gslcosim_services.sensing.
SENSOR_BLOCKS: dict[str, type[SensorSpec]] = {
    "tgs2600": MoxSensorSpec,
    "tgs2602": MoxSensorSpec,
    "tgs2610": MoxSensorSpec,
    "tgs2611": MoxSensorSpec,
    "tgs2612": MoxSensorSpec,
    "tgs2620": MoxSensorSpec,
    "pid": PidSensorSpec,
    "threshold": ThresholdSensorSpec,
    "binary": ThresholdSensorSpec,
    "hit_counter": HitCounterSpec,
    "averaging": AveragingSensorSpec,
    "second_order": SecondOrderSensorSpec,
    "tdlas": TdlasSensorSpec,
    "anemometer": AnemometerSpec,
    "anemometer_3d": Anemometer3dSpec,
    "imu": ImuSensorSpec,
    "gps": GpsSensorSpec,
    "barometer": BarometerSensorSpec,
    "magnetometer": MagnetometerSensorSpec,
    "pose": PoseSensorSpec,
    "range_finder": RangeFinderSpec,
    "four_range_finders": FourRangeFindersSpec,
    "lidar_2d": LidarSensorSpec,
    "lidar_3d": Lidar3dSensorSpec,
    "bump": BumpSensorSpec,
    "camera": ColourCameraSpec,
    "depth_camera": DepthCameraSpec,
    "tgs2600_ideal": IdealMoxSpec,
    "tgs2602_ideal": IdealMoxSpec,
    "tgs2610_ideal": IdealMoxSpec,
    "tgs2611_ideal": IdealMoxSpec,
    "tgs2612_ideal": IdealMoxSpec,
    "tgs2620_ideal": IdealMoxSpec,
    "pid_ideal": IdealPidSpec,
    "tdlas_ideal": IdealTdlasSpec,
    "anemometer_ideal": IdealAnemometerSpec,
    "anemometer_3d_ideal": IdealAnemometer3dSpec,
}
SENSORS = tuple(SENSOR_BLOCKS)


_ONE_OF = OneOf(tag_key="model", base=SensorSpec, own=SENSOR_BLOCKS, offers=SENSOR_OFFERS, part="settings")


@cache
def sensor_names() -> tuple[str, ...]:
    """Return the names of all sensor models: gslcosim's and those of installed packages."""
    return _ONE_OF.names()


@cache
def mox_sensor_names() -> tuple[str, ...]:
    """Return the names of all MOX sensors: gslcosim's and those of installed packages that can be imported.

    An ideal sensor has the figures of the real one, and is left out.
    """
    return tuple(name for name in sensor_names() if issubclass(_block_of(name), MoxSensorSpec) and not is_ideal(name))


def is_ideal(model: str) -> bool:
    """Return whether a model is one of gslcosim's without errors, `pid_ideal` beside `pid`."""
    return model in SENSOR_BLOCKS and model.endswith(IDEAL_SUFFIX)


def _block_of(model: str) -> type[Spec]:
    try:
        return _ONE_OF.block_of(model) or SensorSpec
    except PluginError:
        return SensorSpec


def has_estimates(model: str) -> bool:
    """Return whether readings of a sensor model come with an estimate of the mixing ratio."""
    return SENSOR_BLOCKS.get(model, SensorSpec).has_estimates


def real_model(model: str) -> str:
    """Return the real model of an ideal one, `pid` for `pid_ideal`; agents receive this name."""
    return model.removesuffix(IDEAL_SUFFIX) if is_ideal(model) else model


# Selected by `model`.
Sensor = Annotated[SerializeAsAny[SensorSpec], _ONE_OF]
_SENSOR: TypeAdapter[SensorSpec] = TypeAdapter(Sensor)


def make_sensor_spec(**settings: Any) -> SensorSpec:
    """Return the block of a sensor with the given settings: `make_sensor_spec(model="pid", name="nose")`."""
    return _SENSOR.validate_python(settings)
