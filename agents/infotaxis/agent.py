"""Infotaxis: goes where the entropy of its belief is expected to be least after the next stop."""

from gslcosim.agent_kit import Agent, Briefing, Command, Observation, run
from gslcosim.search.information.grid_search import GridSearch, PlanningContext
from gslcosim.search.information.objectives import Array, infotaxis_cost
from gslcosim.search.method_settings import load_settings


class Infotaxis(Agent):
    """Trades nearing the source for learning where it is by one number, the entropy of its belief."""

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
        """Return the expected entropy after each stop [bit]."""
        return infotaxis_cost(context.predict())


if __name__ == "__main__":
    run(Infotaxis)
