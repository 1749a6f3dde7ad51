"""An agent that stops its process by a signal."""

import os
import signal

from gslcosim.agent_kit import Agent
from gslcosim.contract.messages import Briefing, Command, Observation


class Stops(Agent):
    """An agent that stops its process by a signal."""

    def __init__(self, briefing: Briefing) -> None:
        self.briefing = briefing

    def decide(self, observation: Observation) -> Command:
        """Answer never."""
        os.kill(os.getpid(), signal.SIGSTOP)
        raise AssertionError("nobody continues it")
