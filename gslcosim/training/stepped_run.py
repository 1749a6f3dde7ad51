"""Stepped run of a scenario as a task for learning: its agents are commanded by the caller."""

import math
import queue
from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from gslcosim.base.errors import SimulationFault, UsageError
from gslcosim.base.files import ScratchFolder
from gslcosim.base.quantities import Vec3
from gslcosim.contract import codec
from gslcosim.contract.messages import AgentScore, BodyPoses, Briefing, Command, Ending, Message, Observation, Score
from gslcosim.environment.generation import prepare_environment
from gslcosim.environment.generation.cache import prepare_variants, with_variants
from gslcosim.environment.positions import draw_positions
from gslcosim.environment.store import load_environment
from gslcosim.runtime.agents.session import (
    AgentEvent,
    AgentSession,
    CommandReceived,
    CommandRefused,
    ObservationOrHead,
    build_session,
)
from gslcosim.runtime.in_process import InProcessRun
from gslcosim.runtime.outcome import RunOutcome
from gslcosim.runtime.run_dir import RunDir
from gslcosim.runtime.setup import RunSetup
from gslcosim.scenario import Scenario, load_scenario
from gslcosim.scenario.checks.registry import list_scenario_checks
from gslcosim.scenario.loader import LoadedScenario
from gslcosim.scenario.models.scenario import AgentSpec
from gslcosim.scenario.overrides import SET_OPTION
from gslcosim.training.path_lengths import PathLengths
from gslcosim.training.rewards import TaskScale


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


class SteppedTransport:
    """The link to an agent that is flown by hand; it keeps what the agent has been sent, and what it is asked."""

    is_lossy = False

    def __init__(self) -> None:
        self.briefing: Briefing | None = None
        self.seen: Observation | None = None
        # With a latency several observations may await their commands, the oldest first.
        self.questions: deque[Observation] = deque()

    def brief(self, briefing: Briefing, payload: bytes) -> None:
        """Keep the briefing; see `AgentTransport`."""
        del payload
        self.briefing = briefing

    def observe(self, observation: ObservationOrHead, payload: bytes) -> None:
        """Keep the observation; see `AgentTransport`."""
        self.seen = observation if isinstance(observation, Observation) else codec.decode(Observation, payload)
        if self.seen.awaiting_command:
            self.questions.append(self.seen)

    def repeat(self) -> None:
        """Do nothing: no message gets lost; see `AgentTransport`."""

    def acknowledge(self, event: CommandReceived | CommandRefused) -> None:
        """Do nothing; see `AgentTransport`."""

    def end(self, ending: Ending, payload: bytes) -> None:
        """Ask no more; see `AgentTransport`."""
        del ending, payload
        self.questions.clear()


class SteppedRun:
    """One flight in this process, with the same messages and digest as `gslcosim up` with the same commands.

    `asked` names the agents whose command is awaited, `seen_by`` holds what they are asked upon, `scores` how each
    stood when the referee looked last, at the tick before.
    When `is_over`, `outcome` has the verdict and the digest. Nothing of it is recorded.

    Args:
        loaded: The scenario; who its agents are is of no importance.

    Raises:
        GslCosimError: the scenario cannot be flown, or time does not wait for one of its agents.
        SimulationFault: a service has failed.
    """

    def __init__(self, loaded: LoadedScenario) -> None:
        if any(agent.is_free for agent in loaded.scenario.agents):
            raise UsageError("agents[].mode: expected modes that wait for the agent, was free. Take on_request.")
        recording = loaded.scenario.recording.model_copy(update={"enabled": False})
        scenario = loaded.scenario.model_copy(update={"recording": recording, "ros2": None})
        environment_dir = prepare_environment(scenario, scenario_dir=loaded.directory)
        later_rooms = prepare_variants(scenario, scenario_dir=loaded.directory)
        self._scratch = ScratchFolder("training")
        setup = RunSetup(
            run_dir=RunDir(self._scratch.path),
            scenario=scenario,
            environment_dir=environment_dir,
            environment=with_variants(load_environment(environment_dir), later_rooms),
            directory=loaded.directory,
        )
        self._setup = setup
        self.environment = setup.environment
        self.outcome = RunOutcome()
        # The referee judges a tick when its commands are known: what an agent is asked upon is not judged yet.
        self.scores: dict[str, AgentScore] = {
            agent.name: _before_the_first(agent, scenario) for agent in scenario.agents
        }
        # Where each agent truly was when the referee looked last, world frame [m].
        self.scored_places_m: dict[str, Vec3] = {agent.name: agent.vehicle.start_m for agent in scenario.agents}
        self._places_m: dict[int, dict[str, Vec3]] = {}
        self.is_over = False
        self._is_closed = False
        self._events: queue.SimpleQueue[AgentEvent] = queue.SimpleQueue()
        self._links = {agent.name: SteppedTransport() for agent in scenario.agents}
        flight = InProcessRun(setup, self._build_sessions(setup), self._events, lambda _: None, self._note)
        self._pauses: Iterator[None] = flight.iter_pauses(self.outcome, lambda: self._is_closed)
        self._go_on()

    @property
    def asked(self) -> tuple[str, ...]:
        """The agents whose command is awaited."""
        return tuple(name for name, link in self._links.items() if link.questions)

    def briefing_of(self, agent: str) -> Briefing:
        """Return the briefing that an agent got at the start."""
        briefing = self._links[agent].briefing
        assert briefing is not None, "a flight that waits for commands has briefed its agents"
        return briefing

    def seen_by(self, agent: str) -> Observation:
        """Return the observation that an agent is asked upon; where it is not asked, what it has seen last."""
        link = self._links[agent]
        seen = link.questions[0] if link.questions else link.seen
        assert seen is not None, "an agent is asked because of what it has seen"
        return seen

    def scale(self, discount: float) -> TaskScale:
        """Return the scales of distance and time in this run, for rewards with a discount."""
        grid, limit = self.environment.grid, self._setup.scenario.referee.stop.time_limit_s
        diagonal_m = math.dist(grid.origin_m, grid.max_m)
        return TaskScale(diagonal_m=diagonal_m, time_limit_s=limit, discount=discount)

    def path_lengths(self, action: str) -> dict[str, PathLengths]:
        """Return the lengths of free paths to the nearest source for each agent, with actions of a kind."""
        found: dict[str, PathLengths] = {}
        for agent in self._setup.scenario.agents:
            found[agent.name] = PathLengths(action)
            found[agent.name].add(self._setup.scenario, agent, self.environment)
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

    def answer(self, agent: str, command: Command) -> None:
        """Give the command of an agent that is asked; it counts with the next `go_on`."""
        self._links[agent].questions.popleft()
        self._events.put(CommandReceived(agent=agent, payload=codec.encode(command), decided_in_s=0.0))

    def go_on(self) -> None:
        """Fly on until an agent is asked or the flight is over, with all commands that were awaited."""
        assert not self.asked, f"{', '.join(self.asked)} owe a command"
        self._go_on()

    def close(self) -> None:
        """End the flight, wherever it is."""
        self._is_closed = True
        for _ in self._pauses:
            pass
        self.is_over = True
        self._scratch.close()

    def _go_on(self) -> None:
        for _ in self._pauses:
            if self.asked:
                return
        self.is_over = True
        if self.outcome.fault is not None:
            raise SimulationFault(f"{self.outcome.fault.participant}: {self.outcome.fault.text}")

    def _build_sessions(self, setup: RunSetup) -> dict[str, AgentSession]:
        sessions = {agent.name: build_session(agent, setup, self._links[agent.name]) for agent in setup.scenario.agents}
        for session in sessions.values():
            session.is_ready = True
            # Whoever flies by hand thinks as long as they like, and keeps their own notes.
            session.answer_within_s = float("inf")
            session.journal = lambda _: None
        return sessions

    def _note(self, port: str, message: Message) -> None:
        del port
        if isinstance(message, BodyPoses):
            self._places_m[message.tick] = {body.agent: body.position_world_m for body in message.bodies}
        elif isinstance(message, Score):
            self.scores = {score.agent: score for score in message.agents}
            self.scored_places_m = self._places_m[message.tick]
            self._places_m = {tick: places for tick, places in self._places_m.items() if tick > message.tick}


def _before_the_first(agent: AgentSpec, scenario: Scenario) -> AgentScore:
    distances_m = (math.dist(agent.vehicle.start_m, source.position_m) for source in scenario.gas.sources)
    return AgentScore(agent=agent.name, distance_to_source_m=min(distances_m), path_length_m=0.0, n_commands=0)
