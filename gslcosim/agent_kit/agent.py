"""The base class of Python agents."""

from abc import ABC, abstractmethod

from gslcosim.contract.messages import Briefing, Command, Observation


class Agent(ABC):
    """A search method. It is made with the briefing, sees every observation, and decides when asked.

    Nothing here knows about processes: the same object flies over Zenoh and inside the framework's own process.
    All randomness must come from `briefing.seed`, otherwise runs cannot be repeated.
    """

    @abstractmethod
    def __init__(self, briefing: Briefing) -> None:
        """Read the mission, the bounds, the sensors and the seed."""

    def observe(self, observation: Observation) -> None:  # noqa: B027 - optional, not abstract
        """Take note of an observation; called for every tick, before `decide` where that is called too."""

    @abstractmethod
    def decide(self, observation: Observation) -> Command:
        """Return the command that answers an observation with `awaiting_command`; its tick must be the same."""

    def end(self, reason: str) -> None:  # noqa: B027 - optional, not abstract
        """Take note that the run is over."""
