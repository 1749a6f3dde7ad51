"""Space-aware infotaxis: goes where fewest steps to the source are expected to remain."""

from gslcosim.agent_kit import Agent, Briefing, Command, Observation, run
from gslcosim.search.information.gains import Array, space_aware_cost
from gslcosim.search.information.grid_search import GridSearch, Outlook
from gslcosim.search.method import settings_of


class SpaceAwareInfotaxis(Agent):
    """Adds the way to the source to what infotaxis weighs: knowing where it is is worth less when it is far."""

    def __init__(self, briefing: Briefing) -> None:
        self.settings = settings_of(briefing, __file__)
        self.search = GridSearch(briefing, self.settings, self.costs)

    def observe(self, observation: Observation) -> None:
        """Take note of wind and gas on the way."""
        self.search.observe(observation)

    def decide(self, observation: Observation) -> Command:
        """Return the next stop, or a declaration."""
        return self.search.decide(observation)

    def costs(self, outlook: Outlook) -> Array:
        """Return the expected logarithm of the steps that remain after each stop."""
        foresight = outlook.foresight()
        return space_aware_cost(foresight, step_m=outlook.step_m, cells_per_step=outlook.cells_per_step)


if __name__ == "__main__":
    run(SpaceAwareInfotaxis)
