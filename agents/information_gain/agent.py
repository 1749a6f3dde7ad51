"""Information gain: goes where the next reading is expected to change its belief most."""

from gslcosim.agent_kit import run
from gslcosim_search.information.information_agent import InformationAgent


class InformationGain(InformationAgent):
    """Weighs stops by the divergence of the belief after the reading from that before it."""

    program = __file__
    objective = "information_gain"


if __name__ == "__main__":
    run(InformationGain)
