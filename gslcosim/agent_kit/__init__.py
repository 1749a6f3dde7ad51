"""Kit that the author of a Python agent imports: a base class, the messages, and `run`."""

from gslcosim.agent_kit.agent import Agent, run
from gslcosim.contract.messages import (
    AttitudeSetpoint,
    Belief,
    Briefing,
    Command,
    Declaration,
    DriveSetpoint,
    KnownMap,
    NominalPlume,
    Note,
    Observation,
    RadioMessage,
    RadioReception,
    RateSetpoint,
    Reading,
    Task,
    Waypoint,
)

__all__ = [
    "Agent",
    "AttitudeSetpoint",
    "Belief",
    "Briefing",
    "Command",
    "Declaration",
    "DriveSetpoint",
    "KnownMap",
    "NominalPlume",
    "Note",
    "Observation",
    "RadioMessage",
    "RadioReception",
    "RateSetpoint",
    "Reading",
    "Task",
    "Waypoint",
    "run",
]
