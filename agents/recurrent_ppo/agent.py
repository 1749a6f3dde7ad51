"""Flies what recurrent PPO has learned in halls with a leak. README.md beside this file says how it was trained."""

from pathlib import Path

from gslcosim.agent_kit import Briefing, run
from gslcosim.search.learned.policies.policy import Policy
from gslcosim.search.learned.policies.policy_agent import POLICY_FILE, PolicyAgent
from gslcosim.search.learned.policies.policy_files import load_policy
from gslcosim.search.method import settings_of


class RecurrentPpo(PolicyAgent):
    """Remembers gas and wind in gated recurrent units, and commands a velocity each second."""

    def policy_of(self, briefing: Briefing) -> Policy:
        """Return the policy beside this file."""
        settings_of(briefing, __file__)
        return load_policy(Path(__file__).with_name(POLICY_FILE))


if __name__ == "__main__":
    run(RecurrentPpo)
