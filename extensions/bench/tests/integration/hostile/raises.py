"""An agent that raises an error."""

from gslcosim.agent_kit import Agent
from gslcosim.contract.messages import Briefing, Command, Observation


class Raises(Agent):
    """An agent that raises an error."""

    def __init__(self, briefing: Briefing) -> None:
        self.briefing = briefing

    def decide(self, observation: Observation) -> Command:
        """Answer badly."""
        raise RuntimeError("no idea")
