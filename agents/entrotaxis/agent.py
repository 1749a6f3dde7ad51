"""Entrotaxis: goes where it can tell the next reading least."""

from gslcosim.agent_kit import Agent, Briefing, Command, Observation, run
from gslcosim.search.information.grid_search import GridSearch, PlanningContext
from gslcosim.search.information.objectives import Array, entrotaxis_cost
from gslcosim.search.method_settings import load_settings


class Entrotaxis(Agent):
    """Asks where the next reading is most uncertain; what belief would follow it never works out."""

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
        """Return minus the entropy of the next reading at each stop [bit], less where one was made already."""
        return context.novelty * entrotaxis_cost(context.predict())


if __name__ == "__main__":
    run(Entrotaxis)
