"""Flies a learned policy: a bundled one by its name, or a file of one's own. README.md beside this file says how."""

from pathlib import Path

from gslcosim.agent_kit import Briefing, run
from gslcosim.agent_kit.settings import load_settings
from gslcosim_search.learned.policy import Policy
from gslcosim_search.learned.policy_agent import PolicyAgent, find_policy


class Learned(PolicyAgent):
    """Does what the policy says that the parameter names."""

    program = __file__

    def policy_of(self, briefing: Briefing) -> Policy:
        """Return the policy of the parameter."""
        return find_policy(load_settings(briefing, self.program).policy, Path(self.program).parents[1])


if __name__ == "__main__":
    run(Learned)
