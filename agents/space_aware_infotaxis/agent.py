"""Space-aware infotaxis: goes where fewest steps to the source are expected to remain."""

from gslcosim.agent_kit import Agent, Briefing, Command, Observation, run
from gslcosim.search.information.grid_search import GridSearch, PlanningContext
from gslcosim.search.information.objectives import Array, space_aware_cost
from gslcosim.search.method_settings import load_settings


class SpaceAwareInfotaxis(Agent):
    """Adds the way to the source to what infotaxis weighs: knowing where it is is worth less when it is far."""

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
        """Return the expected logarithm of the steps that remain after each stop."""
        predictions = context.predict()
        return space_aware_cost(predictions, step_m=context.step_m, cells_per_step=context.cells_per_step)


if __name__ == "__main__":
    run(SpaceAwareInfotaxis)
