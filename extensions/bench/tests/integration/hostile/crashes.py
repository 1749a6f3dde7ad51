"""An agent that takes its process with it."""

import os
import sys

from gslcosim.agent_kit import Agent
from gslcosim.contract.messages import Briefing, Command, Observation


class Crashes(Agent):
    """An agent that takes its process with it."""

    def __init__(self, briefing: Briefing) -> None:
        self.briefing = briefing

    def decide(self, observation: Observation) -> Command:
        """Answer badly."""
        sys.stdout.write("these are my last words\n")
        sys.stdout.flush()
        os._exit(7)
