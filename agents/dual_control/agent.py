"""Dual control: nears the mean of its belief and shrinks the variance of it, weighed as one cost."""

from gslcosim.agent_kit import run
from gslcosim_search.information.information_agent import InformationAgent


class DualControl(InformationAgent):
    """Exploits by going to where it believes the source to be, explores by the variance that a reading would leave."""

    program = __file__
    objective = "dual_control"


if __name__ == "__main__":
    run(DualControl)
