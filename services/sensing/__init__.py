"""Sensing service: instruments of vehicles; `core.SensingCore` is the participant that writes agents' observations."""

from gslcosim_services.sensing.models import SENSOR_MODELS

__all__ = ["SENSOR_MODELS"]
