"""An agent that takes all memory there is."""

from gslcosim.agent_kit import Agent
from gslcosim.contract.messages import Briefing, Command, Observation


class Eats(Agent):
    """An agent that takes all memory there is."""

    def __init__(self, briefing: Briefing) -> None:
        self.briefing = briefing

    def decide(self, observation: Observation) -> Command:
        """Answer badly."""
        hoard: list[bytearray] = []
        while True:
            hoard.append(bytearray(b"x" * 50_000_000))
