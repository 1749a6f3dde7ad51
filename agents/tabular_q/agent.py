"""Flies a table of what each leg is worth, learned in halls with a leak. README.md beside this file says how."""

from gslcosim.agent_kit import run
from gslcosim_search.learned.policy_agent import PolicyAgent


class TabularQ(PolicyAgent):
    """Goes by legs, each the best of a table in the state that gas and wind make."""

    program = __file__


if __name__ == "__main__":
    run(TabularQ)
