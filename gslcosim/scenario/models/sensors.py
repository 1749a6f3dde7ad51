"""The sensors of a scenario: which models there are, and the block of settings of each."""

from functools import cache
from typing import Annotated, Any

from pydantic import SerializeAsAny, TypeAdapter

from gslcosim.offers import OfferError, Offers
from gslcosim.scenario.models import gas_sensors as gas
from gslcosim.scenario.models import onboard
from gslcosim.scenario.models.one_of import OneOf
from gslcosim.scenario.models.sensor_base import OnBoardSensorSpec
from gslcosim.scenario.models.sensor_base import SensorSpec as SensorSpec
from gslcosim.scenario.models.spec import Spec

# The block of settings of each model; what the models do is in gslcosim.sensing.
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
    "imu": onboard.ImuSensorSpec,
    "gps": onboard.GpsSensorSpec,
    "barometer": onboard.BarometerSensorSpec,
    "magnetometer": onboard.MagnetometerSensorSpec,
    "pose": onboard.PoseSensorSpec,
    "range_finder": onboard.RangeFinderSpec,
    "four_range_finders": onboard.FourRangeFindersSpec,
    "lidar_2d": onboard.LidarSensorSpec,
    "lidar_3d": onboard.Lidar3dSensorSpec,
    "bump": onboard.BumpSensorSpec,
    "camera": onboard.ColourCameraSpec,
    "depth_camera": onboard.DepthCameraSpec,
}
SENSORS = tuple(SENSOR_BLOCKS)
ON_BOARD_SENSORS = tuple(name for name, block in SENSOR_BLOCKS.items() if issubclass(block, OnBoardSensorSpec))
# Cameras, which a core of their own renders.
CAMERA_SENSORS = tuple(name for name, block in SENSOR_BLOCKS.items() if issubclass(block, onboard.CameraSensorSpec))
# Third parties add theirs under this name; each entry point is a `gslcosim.sensing.models.SensorKind`.
SENSOR_ENTRY_POINTS = "gslcosim.sensors"


SENSOR_OFFERS = Offers(group=SENSOR_ENTRY_POINTS, what="sensor")
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
    except OfferError:
        return SensorSpec


def has_estimates(model: str) -> bool:
    """Return whether readings of a sensor model come with an estimate of the mixing ratio."""
    return SENSOR_BLOCKS.get(model, SensorSpec).has_estimates


# Chosen by `model`.
Sensor = Annotated[SerializeAsAny[SensorSpec], _ONE_OF]
_SENSOR: TypeAdapter[SensorSpec] = TypeAdapter(Sensor)


def sensor_of(**settings: Any) -> SensorSpec:
    """Return the block of a sensor with the given settings: `sensor_of(model="pid", name="nose")`.

    Raises:
        ValidationError: there is no such model, or it has no such setting.
    """
    return _SENSOR.validate_python(settings)
