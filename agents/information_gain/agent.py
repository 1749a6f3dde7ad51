"""Information gain: goes where the next reading is expected to change its belief most."""

from gslcosim.agent_kit import Agent, Briefing, Command, Observation, run
from gslcosim.search.information.grid_search import GridSearch, PlanningContext
from gslcosim.search.information.objectives import Array, information_gain_cost
from gslcosim.search.method_settings import load_settings


class InformationGain(Agent):
    """Weighs stops by the divergence of the belief after the reading from that before it."""

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
        """Return minus the divergence that each stop is expected to cause [bit]."""
        return information_gain_cost(context.predict())


if __name__ == "__main__":
    run(InformationGain)
