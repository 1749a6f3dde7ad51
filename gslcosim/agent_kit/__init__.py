"""What the author of a Python agent imports: a base class, the messages, and `run`."""

from gslcosim.agent_kit.agent import Agent
from gslcosim.agent_kit.connection import run
from gslcosim.contract.messages import (
    AttitudeSetpoint,
    Briefing,
    Command,
    Declaration,
    DriveSetpoint,
    Observation,
    RadioMessage,
    RadioReception,
    RateSetpoint,
    Reading,
    Waypoint,
)

__all__ = [
    "Agent",
    "AttitudeSetpoint",
    "Briefing",
    "Command",
    "Declaration",
    "DriveSetpoint",
    "Observation",
    "RadioMessage",
    "RadioReception",
    "RateSetpoint",
    "Reading",
    "Waypoint",
    "run",
]
