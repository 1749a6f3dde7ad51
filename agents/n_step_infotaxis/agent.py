"""N-step infotaxis: goes where the best sequences of several stops are expected to tell most."""

from gslcosim.agent_kit import run
from gslcosim_search.information.information_agent import InformationAgent


class NStepInfotaxis(InformationAgent):
    """Looks several stops ahead, through each outcome of each: a dull step may lead to a telling one."""

    program = __file__
    objective = "n_step_infotaxis"


if __name__ == "__main__":
    run(NStepInfotaxis)
