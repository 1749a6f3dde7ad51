"""N-step infotaxis: goes where the best sequences of several stops are expected to tell most."""

from gslcosim.agent_kit import Agent, Briefing, Command, Observation, run
from gslcosim.search.information.grid_search import GridSearch, PlanningContext
from gslcosim.search.information.objectives import Array, n_step_costs
from gslcosim.search.method_settings import load_settings


class NStepInfotaxis(Agent):
    """Looks several stops ahead, through each outcome of each: a dull step may lead to a telling one."""

    def __init__(self, briefing: Briefing) -> None:
        self.settings = load_settings(briefing, __file__)
        self.search = GridSearch(briefing, self.settings, self.costs)

    def observe(self, observation: Observation) -> None:
        """Take note of wind and gas on the way."""
        self.search.observe(observation)

    def decide(self, observation: Observation) -> Command:
        """Return the next stop, or a declaration."""
        return self.search.decide(observation)

    def costs(self, context: PlanningContext) -> Array:
        """Return minus the entropy that each first step is expected to gain, with the best ones after it [bit]."""
        settings = self.settings
        return n_step_costs(context.p, context.tree(settings.depth), depth=settings.depth, discount=settings.discount)


if __name__ == "__main__":
    run(NStepInfotaxis)
