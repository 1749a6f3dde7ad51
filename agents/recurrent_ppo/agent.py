"""Flies what recurrent PPO has learned in halls with a leak. README.md beside this file says how it was trained."""

from gslcosim.agent_kit import run
from gslcosim_search.learned.policy_agent import PolicyAgent


class RecurrentPpo(PolicyAgent):
    """Remembers gas and wind in gated recurrent units, and commands a velocity each second."""

    program = __file__


if __name__ == "__main__":
    run(RecurrentPpo)
