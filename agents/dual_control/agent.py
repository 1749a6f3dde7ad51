"""Dual control: nears the mean of its belief and shrinks the variance of it, weighed as one cost."""

from gslcosim.agent_kit import Agent, Briefing, Command, Observation, run
from gslcosim.search.information.grid_search import GridSearch, PlanningContext
from gslcosim.search.information.objectives import Array, dual_control_cost
from gslcosim.search.method_settings import load_settings


class DualControl(Agent):
    """Exploits by going to where it believes the source to be, explores by the variance that a reading would leave."""

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
        """Return squared distance to the estimate plus weighed variance [m2], more where findings were made already."""
        cost = dual_control_cost(
            context.predict(), context.places_m, context.mean_m, exploration=self.settings.exploration
        )
        return cost / context.novelty


if __name__ == "__main__":
    run(DualControl)
