"""Instruments: what a vehicle's sensors report of the true fields, and the core that tells the agents."""

from gslcosim.sensing.models import SENSOR_MODELS

__all__ = ["SENSOR_MODELS"]
