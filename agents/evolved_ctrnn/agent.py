"""Flies a recurrent network that was evolved in halls with a leak. README.md beside this file says how."""

from gslcosim.agent_kit import Briefing, run
from gslcosim_search.learned.policy import Policy
from gslcosim_search.learned.policy_agent import PolicyAgent, load_policy_beside


class EvolvedCtrnn(PolicyAgent):
    """Remembers gas and wind in a few neurons, and commands a velocity each second."""

    def policy_of(self, briefing: Briefing) -> Policy:
        """Return the policy beside this file."""
        return load_policy_beside(briefing, __file__)


if __name__ == "__main__":
    run(EvolvedCtrnn)
