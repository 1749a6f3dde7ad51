"""An agent that never answers."""

from gslcosim.agent_kit import Agent
from gslcosim.contract.messages import Briefing, Command, Observation


class Hangs(Agent):
    """An agent that never answers."""

    def __init__(self, briefing: Briefing) -> None:
        self.briefing = briefing

    def decide(self, observation: Observation) -> Command:
        """Answer badly."""
        while True:
            pass
