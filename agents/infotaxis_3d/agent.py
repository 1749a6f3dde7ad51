"""Infotaxis in space: goes, also up and down, where the entropy of its belief is expected to be least."""

from gslcosim.agent_kit import run
from gslcosim_search.information.information_agent import InformationAgent


class Infotaxis3d(InformationAgent):
    """Keeps its belief over the volume: the height of the source is unknown, too."""

    program = __file__
    objective = "infotaxis_3d"
    dimensions = 3


if __name__ == "__main__":
    run(Infotaxis3d)
