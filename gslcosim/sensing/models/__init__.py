"""All sensor models by name, with quantity, unit and what they stand for."""

from gslcosim.sensing.models.anemometer import ANEMOMETER
from gslcosim.sensing.models.base import SensorKind, SensorModel
from gslcosim.sensing.models.mox import MOX_PARAMETERS, mox_kind

SENSOR_MODELS: dict[str, SensorKind] = {
    kind.name: kind for kind in (*(mox_kind(parameters) for parameters in MOX_PARAMETERS.values()), ANEMOMETER)
}

__all__ = ["SENSOR_MODELS", "SensorKind", "SensorModel"]
