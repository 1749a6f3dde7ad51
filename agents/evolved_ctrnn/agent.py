"""Flies a recurrent network that was evolved in halls with a leak. README.md beside this file says how."""

from gslcosim.agent_kit import run
from gslcosim_search.learned.policy_agent import PolicyAgent


class EvolvedCtrnn(PolicyAgent):
    """Remembers gas and wind in a few neurons, and commands a velocity each second."""

    program = __file__


if __name__ == "__main__":
    run(EvolvedCtrnn)
