"""Entrotaxis: goes where it can tell the next reading least."""

from gslcosim.agent_kit import run
from gslcosim_search.information.information_agent import InformationAgent


class Entrotaxis(InformationAgent):
    """Asks where the next reading is most uncertain; what belief would follow it never works out."""

    program = __file__
    objective = "entrotaxis"


if __name__ == "__main__":
    run(Entrotaxis)
