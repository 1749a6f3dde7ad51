"""All sensor models by name, with quantity, unit and what they stand for."""

from gslcosim.sensing.models.anemometer import ANEMOMETER, ANEMOMETER_3D
from gslcosim.sensing.models.base import SensorKind, SensorModel
from gslcosim.sensing.models.imperfect import build_sensor
from gslcosim.sensing.models.mox import MOX_PARAMETERS, mox_kind
from gslcosim.sensing.models.ppm_sensors import PPM_KINDS

_MOX_KINDS = tuple(mox_kind(parameters) for parameters in MOX_PARAMETERS.values())

SENSOR_MODELS: dict[str, SensorKind] = {
    kind.name: kind for kind in (*_MOX_KINDS, *PPM_KINDS, ANEMOMETER, ANEMOMETER_3D)
}

__all__ = ["SENSOR_MODELS", "SensorKind", "SensorModel", "build_sensor"]
