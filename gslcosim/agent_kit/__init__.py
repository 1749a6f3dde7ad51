"""What the author of a Python agent imports: a base class, the messages, and `run`."""

from gslcosim.agent_kit.agent import Agent
from gslcosim.agent_kit.connection import run
from gslcosim.contract.messages import (
    Briefing,
    Command,
    Declaration,
    Observation,
    RadioMessage,
    RadioReception,
    Reading,
)

__all__ = [
    "Agent",
    "Briefing",
    "Command",
    "Declaration",
    "Observation",
    "RadioMessage",
    "RadioReception",
    "Reading",
    "run",
]
