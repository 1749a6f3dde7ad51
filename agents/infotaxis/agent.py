"""Infotaxis: goes where the entropy of its belief is expected to be least after the next stop."""

from gslcosim.agent_kit import run
from gslcosim_search.information.information_agent import InformationAgent


class Infotaxis(InformationAgent):
    """Trades nearing the source for learning where it is by one number, the entropy of its belief."""

    program = __file__
    objective = "infotaxis"


if __name__ == "__main__":
    run(Infotaxis)
