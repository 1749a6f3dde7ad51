"""Cognitive search: weighs stops by a Renyi divergence of beliefs, or by free energy."""

from gslcosim.agent_kit import Agent, Briefing, Command, Observation, run
from gslcosim.search.information.grid_search import GridSearch, PlanningContext
from gslcosim.search.information.objectives import Array, free_energy_cost, renyi_cost
from gslcosim.search.method_settings import load_settings


class CognitiveSearch(Agent):
    """Infotaxis with another measure of what a reading is worth."""

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
        """Return the cost of each stop by the chosen reward."""
        settings = self.settings
        if settings.reward == "renyi":
            return renyi_cost(context.predict(alpha=settings.alpha))
        return free_energy_cost(context.predict(), step_m=context.step_m, temperature=settings.temperature)


if __name__ == "__main__":
    run(CognitiveSearch)
