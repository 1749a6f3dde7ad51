"""Information-driven agents: one search over a grid, and the table of objectives by which these agents differ."""

from collections.abc import Callable, Mapping
from types import SimpleNamespace
from typing import ClassVar, Literal

from gslcosim.agent_kit import Agent, Briefing, Command, Observation
from gslcosim.search.information.grid_search import GridSearch, PlanningContext
from gslcosim.search.information.objectives import (
    Array,
    dual_control_cost,
    entrotaxis_cost,
    free_energy_cost,
    information_gain_cost,
    infotaxis_cost,
    n_step_costs,
    renyi_cost,
    space_aware_cost,
)
from gslcosim.search.method_settings import load_settings

Objective = Callable[[PlanningContext, SimpleNamespace], Array]


def _expected_entropy(context: PlanningContext, settings: SimpleNamespace) -> Array:
    # The expected entropy after each stop [bit].
    del settings
    return infotaxis_cost(context.predict())


def _remaining_steps(context: PlanningContext, settings: SimpleNamespace) -> Array:
    # The expected logarithm of the steps that remain after each stop.
    del settings
    return space_aware_cost(context.predict(), step_m=context.step_m, cells_per_step=context.cells_per_step)


def _reading_entropy(context: PlanningContext, settings: SimpleNamespace) -> Array:
    # Minus the entropy of the next reading at each stop [bit], less where one was made already.
    del settings
    return context.novelty * entrotaxis_cost(context.predict())


def _information_gain(context: PlanningContext, settings: SimpleNamespace) -> Array:
    # Minus the divergence that each stop is expected to cause [bit].
    del settings
    return information_gain_cost(context.predict())


def _renyi_or_free_energy(context: PlanningContext, settings: SimpleNamespace) -> Array:
    # The cost of each stop by the chosen reward.
    if settings.reward == "renyi":
        return renyi_cost(context.predict(alpha=settings.alpha))
    return free_energy_cost(context.predict(), step_m=context.step_m, temperature=settings.temperature)


def _distance_and_variance(context: PlanningContext, settings: SimpleNamespace) -> Array:
    # Squared distance to the estimate plus weighed variance [m2], more where findings were made already.
    cost = dual_control_cost(context.predict(), context.places_m, context.mean_m, exploration=settings.exploration)
    return cost / context.novelty


def _entropy_of_sequences(context: PlanningContext, settings: SimpleNamespace) -> Array:
    # Minus the entropy that each first step is expected to gain, with the best ones after it [bit].
    return n_step_costs(context.p, context.tree(settings.depth), depth=settings.depth, discount=settings.discount)


# What each method weighs: the cost of each place of a planning context, of which the least is best.
OBJECTIVES: Mapping[str, Objective] = {
    "infotaxis": _expected_entropy,
    "infotaxis_3d": _expected_entropy,
    "space_aware_infotaxis": _remaining_steps,
    "entrotaxis": _reading_entropy,
    "information_gain": _information_gain,
    "cognitive_search": _renyi_or_free_energy,
    "dual_control": _distance_and_variance,
    "n_step_infotaxis": _entropy_of_sequences,
}


class InformationAgent(Agent):
    """An agent that keeps a belief on a grid and stops next where its objective is best.

    A method is a subclass that names its `program` (`__file__`, with its card beside it) and its `objective`, a key of
    `OBJECTIVES`. `dimensions` is 3 for a belief over the volume.
    """

    program: ClassVar[str]
    objective: ClassVar[str]
    dimensions: ClassVar[Literal[2, 3]] = 2

    def __init__(self, briefing: Briefing) -> None:
        """Begin with an even belief.

        Raises:
            MethodError: the agent lacks something that its card asks for, or a parameter is wrong.
        """
        self.settings = load_settings(briefing, self.program)
        self.search = GridSearch(briefing, self.settings, self.costs, dimensions=self.dimensions)

    def observe(self, observation: Observation) -> None:
        """Take note of wind and gas on the way."""
        self.search.observe(observation)

    def decide(self, observation: Observation) -> Command:
        """Return the next stop, or a declaration."""
        return self.search.decide(observation)

    def costs(self, context: PlanningContext) -> Array:
        """Return the cost of a stop at each place by the method's objective."""
        return OBJECTIVES[self.objective](context, self.settings)
