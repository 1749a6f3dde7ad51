"""Infotaxis in space: goes, also up and down, where the entropy of its belief is expected to be least."""

from gslcosim.agent_kit import Agent, Briefing, Command, Observation, run
from gslcosim.search.information.grid_search import GridSearch, PlanningContext
from gslcosim.search.information.objectives import Array, infotaxis_cost
from gslcosim.search.method_settings import load_settings


class Infotaxis3d(Agent):
    """Keeps its belief over the volume: the height of the source is unknown, too."""

    def __init__(self, briefing: Briefing) -> None:
        self.settings = load_settings(briefing, __file__)
        self.search = GridSearch(briefing, self.settings, self.costs, dimensions=3)

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
    run(Infotaxis3d)
