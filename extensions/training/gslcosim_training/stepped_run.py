"""Stepped run of a scenario as a task for learning: its agents are commanded by the caller."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from typing_extensions import override

from gslcosim.base.quantities import Vec3
from gslcosim.base.scalar_kernels import distance
from gslcosim.contract.messages import AgentScore, BodyPoses, Message, Observation, Score
from gslcosim.environment.positions import draw_positions
from gslcosim.scenario import Scenario, load_scenario
from gslcosim.scenario.checks.registry import list_scenario_checks
from gslcosim.scenario.loader import LoadedScenario
from gslcosim.scenario.models.scenario import AgentSpec
from gslcosim.scenario.overrides import SET_OPTION
from gslcosim.simulation.simulation import Simulation
from gslcosim_training.path_lengths import PathLengths
from gslcosim_training.rewards import TaskScale


@dataclass(frozen=True, kw_only=True)
class LearningTask:
    """A scenario with values replaced; each seed draws its random places, gas and noise again.

    Problems with values are said to stand in `set_in`.
    """

    scenario: str | Path
    overrides: Sequence[str] = field(default=())
    set_in: str = SET_OPTION

    def loaded(self, seed: int) -> LoadedScenario:
        """Return the scenario with a seed.

        Raises:
            ScenarioError: it has problems.
        """
        return load_scenario(
            self.scenario,
            overrides=self.overrides,
            seed=seed,
            set_in=self.set_in,
            # Not what opens files: a seed changes nothing of them.
            checks=list_scenario_checks("room", without=("stored gas",)),
            placer=draw_positions,
        )


def get_environment_key(loaded: LoadedScenario) -> str:
    """Return the key that scenarios with the same room and wind share."""
    scenario = loaded.scenario
    return f"{loaded.directory}\n{scenario.environment.model_dump_json()}\n{scenario.wind.model_dump_json()}"


class SteppedRun(Simulation):
    """Simulation with all agents commanded by the caller, and the figures that rewards are made of.

    It goes from question to question: `asked` names the agents whose command is awaited, `seen_by` holds what they are
    asked upon, `scores` how each stood when the referee looked last, at the tick before.
    When `is_over`, `outcome` has the verdict and the digest.

    Args:
        loaded: The scenario; who its agents are is of no importance.

    Raises:
        GslCosimError: the scenario cannot be flown, or time does not wait for one of its agents.
        SimulationFault: a service has failed.
    """

    def __init__(self, loaded: LoadedScenario) -> None:
        agents = loaded.scenario.agents
        # The referee judges a tick when its commands are known: what an agent is asked upon is not judged yet.
        self._first_scores = {agent.name: _before_the_first(agent, loaded.scenario) for agent in agents}
        # Where each agent truly was when the referee looked last, world frame [m].
        self.scored_places_m: dict[str, Vec3] = {agent.name: agent.vehicle.start_m for agent in agents}
        self._places_m: dict[int, dict[str, Vec3]] = {}
        # Nobody watches a search for learning.
        unwatched = replace(loaded, scenario=loaded.scenario.without_live_keys())
        super().__init__(unwatched, commanded=[agent.name for agent in agents])
        try:
            self.advance(None)
        except BaseException:
            self.close()
            raise

    @property
    def scores(self) -> Mapping[str, AgentScore]:
        """Standing of each agent when the referee looked last; at the start before that."""
        return super().scores or self._first_scores

    def seen_by(self, agent: str) -> Observation:
        """Return the observation that an agent is asked upon; where it is not asked, what it has seen last."""
        return self.get_question(agent) or self.observe()[agent]

    def scale(self, discount: float) -> TaskScale:
        """Return the scales of distance and time in this run, for rewards with a discount."""
        grid, limit = self.environment.grid, self.scenario.referee.stop.time_limit_s
        diagonal_m = distance(grid.origin_m, grid.max_m)
        return TaskScale(diagonal_m=diagonal_m, time_limit_s=limit, discount=discount)

    def path_lengths(self, action: str) -> dict[str, PathLengths]:
        """Return the lengths of free paths to the nearest source for each agent, with actions of a kind."""
        found: dict[str, PathLengths] = {}
        for agent in self.scenario.agents:
            found[agent.name] = PathLengths(action)
            found[agent.name].add(self.scenario, agent, self.environment)
        return found

    def path_m(self, agent: str, lengths: PathLengths) -> float:
        """Return the length of an agent's free path to the nearest source when the referee looked last [m]."""
        places_m = np.array([self.scored_places_m[agent]])
        distances_m = np.array([self.scores[agent].distance_to_source_m])
        return float(lengths.lengths_m(np.zeros(1, np.int64), places_m, distances_m)[0])

    def outcome_of(self, agent: str) -> str | None:
        """Return the outcome of an agent's search; None while the run continues."""
        verdict = self.outcome.verdict
        if verdict is None:
            return None
        return next((result.outcome for result in verdict.agents if result.name == agent), verdict.end_reason)

    def end_of(self, agent: str) -> dict[str, Any]:
        """Return an agent's outcome, whether it succeeded, and the run's digest; nothing while the run goes on."""
        if not self.is_over or self.outcome.digest is None:
            return {}
        outcome = self.outcome_of(agent)
        return {"outcome": outcome, "success": outcome == "success", "digest": self.outcome.digest.hex}

    def go_on(self) -> None:
        """Fly on until an agent is asked or the flight is over, with all commands that were awaited."""
        assert not self.asked, f"{', '.join(self.asked)} owe a command"
        self.advance(None)

    @override
    def on_message(self, port: str, message: Message) -> None:
        super().on_message(port, message)
        if isinstance(message, BodyPoses):
            self._places_m[message.tick] = {body.agent: body.position_world_m for body in message.bodies}
        elif isinstance(message, Score):
            self.scored_places_m = self._places_m[message.tick]
            self._places_m = {tick: places for tick, places in self._places_m.items() if tick > message.tick}


def _before_the_first(agent: AgentSpec, scenario: Scenario) -> AgentScore:
    distances_m = (distance(agent.vehicle.start_m, source.position_m) for source in scenario.gas.searched)
    return AgentScore(agent=agent.name, distance_to_source_m=min(distances_m), path_length_m=0.0, n_commands=0)
