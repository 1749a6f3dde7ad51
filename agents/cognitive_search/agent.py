"""Cognitive search: weighs stops by a Renyi divergence of beliefs, or by free energy."""

from gslcosim.agent_kit import run
from gslcosim_search.information.information_agent import InformationAgent


class CognitiveSearch(InformationAgent):
    """Infotaxis with another measure of what a reading is worth."""

    program = __file__
    objective = "cognitive_search"


if __name__ == "__main__":
    run(CognitiveSearch)
