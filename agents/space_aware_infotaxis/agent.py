"""Space-aware infotaxis: goes where fewest steps to the source are expected to remain."""

from gslcosim.agent_kit import run
from gslcosim_search.information.information_agent import InformationAgent


class SpaceAwareInfotaxis(InformationAgent):
    """Adds the way to the source to what infotaxis weighs: knowing where it is is worth less when it is far."""

    program = __file__
    objective = "space_aware_infotaxis"


if __name__ == "__main__":
    run(SpaceAwareInfotaxis)
