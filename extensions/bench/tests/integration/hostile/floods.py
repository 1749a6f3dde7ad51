"""An agent that never stops printing."""

import sys

from gslcosim.agent_kit import Agent
from gslcosim.contract.messages import Briefing, Command, Observation


class Floods(Agent):
    """An agent that never stops printing."""

    def __init__(self, briefing: Briefing) -> None:
        self.briefing = briefing

    def decide(self, observation: Observation) -> Command:
        """Answer badly."""
        for _ in range(2000):
            sys.stdout.write("flood " * 200)
        return Command(tick=observation.tick, kind="hold", hold_s=1.0)
