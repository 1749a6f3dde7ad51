"""Flies a table of what each leg is worth, learned in halls with a leak. README.md beside this file says how."""

from gslcosim.agent_kit import Briefing, run
from gslcosim_search.learned.policy import Policy
from gslcosim_search.learned.policy_agent import PolicyAgent, load_policy_beside


class TabularQ(PolicyAgent):
    """Goes by legs, each the best of a table in the state that gas and wind make."""

    def policy_of(self, briefing: Briefing) -> Policy:
        """Return the policy beside this file."""
        return load_policy_beside(briefing, __file__)


if __name__ == "__main__":
    run(TabularQ)
