"""Sensor models by name, and the block of settings of each."""

from functools import cache
from typing import Annotated, Any

from pydantic import SerializeAsAny, TypeAdapter

from gslcosim.base.plugins import EntryPoints, PluginError
from gslcosim.scenario.models import gas_sensors as gas
from gslcosim.scenario.models import onboard_sensors
from gslcosim.scenario.models.base import Spec
from gslcosim.scenario.models.one_of import OneOf
from gslcosim.scenario.models.sensor_base import OnBoardSensorSpec
from gslcosim.scenario.models.sensor_base import SensorSpec as SensorSpec

# The block of settings of each model; what the models do is in gslcosim_services.sensing.
SENSOR_BLOCKS: dict[str, type[SensorSpec]] = {
    "tgs2600": gas.MoxSensorSpec,
    "tgs2602": gas.MoxSensorSpec,
    "tgs2610": gas.MoxSensorSpec,
    "tgs2611": gas.MoxSensorSpec,
    "tgs2612": gas.MoxSensorSpec,
    "tgs2620": gas.MoxSensorSpec,
    "pid": gas.PidSensorSpec,
    "threshold": gas.ThresholdSensorSpec,
    "binary": gas.ThresholdSensorSpec,
    "hit_counter": gas.HitCounterSpec,
    "averaging": gas.AveragingSensorSpec,
    "second_order": gas.SecondOrderSensorSpec,
    "tdlas": gas.TdlasSensorSpec,
    "anemometer": gas.AnemometerSpec,
    "anemometer_3d": gas.Anemometer3dSpec,
    "imu": onboard_sensors.ImuSensorSpec,
    "gps": onboard_sensors.GpsSensorSpec,
    "barometer": onboard_sensors.BarometerSensorSpec,
    "magnetometer": onboard_sensors.MagnetometerSensorSpec,
    "pose": onboard_sensors.PoseSensorSpec,
    "range_finder": onboard_sensors.RangeFinderSpec,
    "four_range_finders": onboard_sensors.FourRangeFindersSpec,
    "lidar_2d": onboard_sensors.LidarSensorSpec,
    "lidar_3d": onboard_sensors.Lidar3dSensorSpec,
    "bump": onboard_sensors.BumpSensorSpec,
    "camera": onboard_sensors.ColourCameraSpec,
    "depth_camera": onboard_sensors.DepthCameraSpec,
}
SENSORS = tuple(SENSOR_BLOCKS)
ON_BOARD_SENSORS = tuple(name for name, block in SENSOR_BLOCKS.items() if issubclass(block, OnBoardSensorSpec))
# Cameras, which a core of their own renders.
CAMERA_SENSORS = tuple(
    name for name, block in SENSOR_BLOCKS.items() if issubclass(block, onboard_sensors.CameraSensorSpec)
)
# Third parties add theirs under this name; each entry point is a `gslcosim_services.sensing.models.SensorKind`.
SENSOR_ENTRY_POINTS = "gslcosim.sensors"


SENSOR_OFFERS = EntryPoints(group=SENSOR_ENTRY_POINTS, what="sensor")
_ONE_OF = OneOf(tag_key="model", base=SensorSpec, own=SENSOR_BLOCKS, offers=SENSOR_OFFERS, part="settings")


@cache
def sensor_names() -> tuple[str, ...]:
    """Return the names of all sensor models: gslcosim's and those of installed packages."""
    return _ONE_OF.names()


@cache
def mox_sensor_names() -> tuple[str, ...]:
    """Return the names of all MOX sensors: gslcosim's and those of installed packages that can be imported."""
    return tuple(name for name in sensor_names() if issubclass(_block_of(name), gas.MoxSensorSpec))


def _block_of(model: str) -> type[Spec]:
    try:
        return _ONE_OF.block_of(model) or SensorSpec
    except PluginError:
        return SensorSpec


def has_estimates(model: str) -> bool:
    """Return whether readings of a sensor model come with an estimate of the mixing ratio."""
    return SENSOR_BLOCKS.get(model, SensorSpec).has_estimates


# Chosen by `model`.
Sensor = Annotated[SerializeAsAny[SensorSpec], _ONE_OF]
_SENSOR: TypeAdapter[SensorSpec] = TypeAdapter(Sensor)


def make_sensor_spec(**settings: Any) -> SensorSpec:
    """Return the block of a sensor with the given settings: `make_sensor_spec(model="pid", name="nose")`.

    Raises:
        ValidationError: there is no such model, or it has no such setting.
    """
    return _SENSOR.validate_python(settings)
