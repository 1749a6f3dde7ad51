"""Parallel environment of PettingZoo: several agents search at once, with radio messages of numbers."""

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gslcosim.agent_kit import Briefing, Observation, RadioMessage
from gslcosim.base.errors import UsageError
from gslcosim.base.ticks import NS_PER_S
from gslcosim.contract.messages import Command
from gslcosim_search.learned.encoding import ActionKind, ObservationVector, action_kind
from gslcosim_training import REMEDY
from gslcosim_training.path_lengths import PathLengths
from gslcosim_training.rewards import TIME_LIMIT, AgentState, Reward, TaskScale, reward_function
from gslcosim_training.stepped_run import LearningTask, SteppedRun

_DECIMALS = 3
_MOST_SEED = 2**31
_Numbers = NDArray[np.float32]


class RadioCodec:
    """Numbers between -1 and 1 that one agent sends to all others, and the last ones received from each.

    They travel on the first channel that the briefing names, with its range, losses and delay.

    Args:
        briefing: Of the agent.
        n_numbers: How many numbers an agent sends.

    Raises:
        UsageError: the agent has no channel.
    """

    def __init__(self, briefing: Briefing, n_numbers: int) -> None:
        if n_numbers and not briefing.channels:
            raise UsageError(
                f"radio_numbers: expected 0 for {briefing.agent}, which has no channel, was {n_numbers}. Add one to "
                "channels of the scenario."
            )
        self.n_numbers = n_numbers
        self._channel = briefing.channels[0].name if n_numbers else ""
        members = briefing.channels[0].members if n_numbers else ()
        self.others = tuple(name for name in members if name != briefing.agent)
        self._received = {name: [0.0] * n_numbers for name in self.others}

    @property
    def size(self) -> int:
        """Number of numbers received."""
        return self.n_numbers * len(self.others)

    def message(self, numbers: Sequence[float]) -> tuple[RadioMessage, ...]:
        """Return the text that carries numbers."""
        if not self.n_numbers:
            return ()
        text = json.dumps([round(float(number), _DECIMALS) for number in numbers])
        return (RadioMessage(channel=self._channel, text=text),)

    def receive(self, observation: Observation) -> NDArray[np.float32]:
        """Take note of what came, and return what each of `others` has told last, (size,); 0 before the first.

        A text comes with one observation only, so each has to be heard.
        """
        for reception in observation.incoming:
            if reception.sender in self._received and (numbers := _numbers_of(reception.text, self.n_numbers)):
                self._received[reception.sender] = numbers
        return np.array([number for name in self.others for number in self._received[name]], dtype=np.float32)


# Others may speak on the channel too.
def _numbers_of(text: str, n_numbers: int) -> list[float] | None:
    try:
        numbers = [float(number) for number in json.loads(text)]
    except (ValueError, TypeError):
        return None
    if len(numbers) != n_numbers or not all(math.isfinite(number) for number in numbers):
        return None
    return [min(max(number, -1.0), 1.0) for number in numbers]


try:
    from gymnasium import spaces
    from gymnasium.utils import seeding
    from pettingzoo import ParallelEnv
except ImportError as error:  # an extra
    raise UsageError(f"pettingzoo: expected the package, found none. Install it with: {REMEDY}") from error


class ParallelSearchEnv(ParallelEnv[str, _Numbers, _Numbers]):
    """A scenario whose agents all act every `step_s` of simulated time, and search until the run ends.

    Agents fly with `mode: lockstep`, whatever the scenario says: their commands count at once, and between two steps
    they go on. An action is what `SearchEnv` takes, and behind it `radio_numbers` numbers in [-1, 1] that the others
    hear on the agent's first channel; an observation is that of `SearchEnv`, and behind it what each other member of
    the channel has told last.

    Args:
        scenario: A file, or the name of a bundled scenario.
        overrides: Values to replace, such as `seed=5`.
        step_s: Simulated time between actions [s].
        action: `velocity`, `velocity_3d`, `waypoint`, `waypoint_3d` or `drive`.
        step_m: The longest leg [m].
        speed_m_s: The highest speed [m/s].
        radio_numbers: How many numbers an agent sends with each action.
        reward: As for `SearchEnv`.
        discount: Of the shaping of `potential`.

    Raises:
        UsageError: an argument is not one of those.
        ScenarioError: the scenario has problems.
    """

    metadata = {"name": "gslcosim_search_v0", "render_modes": []}  # noqa: RUF012 - as PettingZoo declares it

    def __init__(
        self,
        scenario: str | Path = "swarm_tiny",
        *,
        overrides: Sequence[str] = (),
        step_s: float = 0.5,
        action: str = "velocity",
        step_m: float = 1.0,
        speed_m_s: float = 1.0,
        radio_numbers: int = 0,
        reward: str | Reward = "potential",
        discount: float = 0.99,
    ) -> None:
        self.render_mode = None
        self._scenario, self._overrides = scenario, tuple(overrides)
        self._settings = {"step_m": step_m, "speed_m_s": speed_m_s, "hold_s": step_s}
        self._action_name, self._step_s, self._n_told = action, step_s, radio_numbers
        self._reward, self._discount = reward_function(reward), discount
        self._rng = seeding.np_random()[0]
        plain = LearningTask(scenario=scenario, overrides=self._overrides).loaded(0).scenario
        modes = tuple(f"agents[{i}].mode=lockstep" for i in range(len(plain.agents)))
        self._task = LearningTask(scenario=scenario, overrides=(*self._overrides, *modes))
        self._step_ticks = _whole_ticks(step_s, plain.tick_ns)
        search = self._begun(0)
        search.flight.close()
        self.possible_agents = [*search.talkers]
        self.agents: list[str] = []
        self.observation_spaces = {name: _box(talker.n_observed) for name, talker in search.talkers.items()}
        self.action_spaces = {name: _box(talker.n_acted) for name, talker in search.talkers.items()}
        self._search: _Search | None = None

    def observation_space(self, agent: str) -> "spaces.Space[Any]":
        """Return the observation space of an agent."""
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> "spaces.Space[Any]":
        """Return the action space of an agent."""
        return self.action_spaces[agent]

    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, _Numbers], dict[str, dict[str, Any]]]:
        """Begin a search; see `SearchEnv.reset`. PettingZoo's own tests give options, so they are not refused."""
        del options
        if seed is not None:
            self._rng = seeding.np_random(seed)[0]
        self.close()
        drawn = int(self._rng.integers(_MOST_SEED)) if seed is None else seed % _MOST_SEED
        search = self._search = self._begun(drawn)
        self.agents = [*self.possible_agents]
        return search.seen(), {name: {} for name in self.agents}

    def step(
        self, actions: dict[str, _Numbers]
    ) -> tuple[dict[str, _Numbers], dict[str, float], dict[str, bool], dict[str, bool], dict[str, dict[str, Any]]]:
        """Act, and fly on for `step_s` or to the end; the search of all ends with the run."""
        search = self._search
        if search is None or not self.agents:
            raise UsageError("No search is active. Call reset before step.")
        before = search.moments()
        search.act(actions, self._step_ticks)
        after = search.moments()
        verdict = search.flight.outcome.verdict
        is_truncated = verdict is not None and verdict.end_reason == TIME_LIMIT
        is_terminated = search.flight.is_over and not is_truncated
        rewards = {name: self._reward(before[name], after[name], search.scale) for name in self.agents}
        terminated, truncated = dict.fromkeys(self.agents, is_terminated), dict.fromkeys(self.agents, is_truncated)
        if search.flight.is_over:
            self.agents = []
        return search.seen(), rewards, terminated, truncated, search.infos()

    def render(self) -> None:
        """Do nothing: there is no picture of several agents."""

    def close(self) -> None:
        """End the search that goes on, if one does."""
        search, self._search = self._search, None
        if search is not None:
            search.flight.close()

    def _begun(self, seed: int) -> "_Search":
        flight = SteppedRun(self._task.loaded(seed))
        talkers: dict[str, _Talker] = {}
        for name in flight.asked:
            briefing = flight.get_briefing(name)
            actions = action_kind(self._action_name, briefing, **self._settings)
            if actions.n_choices:
                raise UsageError(f"action: expected a kind with numbers, was {self._action_name!r}.")
            talkers[name] = _Talker(ObservationVector(briefing), actions, RadioCodec(briefing, self._n_told))
        return _Search(flight, talkers, flight.scale(self._discount), flight.path_lengths(self._action_name))


@dataclass
class _Talker:
    """Codec of one agent: its messages into numbers, and numbers into commands."""

    vector: ObservationVector
    actions: ActionKind
    radio: RadioCodec

    @property
    def n_observed(self) -> int:
        return self.vector.size + self.radio.size

    @property
    def n_acted(self) -> int:
        return self.actions.n_numbers + self.radio.n_numbers

    def command(self, seen: Observation, action: _Numbers) -> Command:
        n_moved = self.actions.n_numbers
        command = self.actions.command(seen, action[:n_moved])
        return command.model_copy(update={"outgoing": self.radio.message(action[n_moved:].tolist())})

    def seen(self, observation: Observation) -> _Numbers:
        return np.concatenate([self.vector.of(observation), self.radio.receive(observation)])


@dataclass
class _Search:
    """One flight of all agents."""

    flight: SteppedRun
    talkers: dict[str, _Talker]
    scale: TaskScale
    lengths: dict[str, PathLengths]

    def act(self, actions: dict[str, _Numbers], step_ticks: int) -> None:
        flight = self.flight
        for name, talker in self.talkers.items():
            flight.command(name, talker.command(flight.seen_by(name), actions[name]))
        flight.go_on()
        for _ in range(step_ticks - 1):
            if flight.is_over:
                return
            for name in flight.asked:
                seen = flight.seen_by(name)
                self.talkers[name].radio.receive(seen)
                flight.command(name, Command(tick=seen.tick, kind="noop"))
            flight.go_on()

    def seen(self) -> dict[str, _Numbers]:
        return {name: talker.seen(self.flight.seen_by(name)) for name, talker in self.talkers.items()}

    def moments(self) -> dict[str, AgentState]:
        return {
            name: AgentState(
                distance_m=score.distance_to_source_m,
                time_s=self.flight.seen_by(name).time_s,
                n_commands=score.n_commands,
                outcome=self.flight.outcome_of(name),
                path_m=self.flight.path_m(name, self.lengths[name]),
            )
            for name, score in self.flight.scores.items()
        }

    def infos(self) -> dict[str, dict[str, Any]]:
        return {
            name: {
                "distance_to_source_m": score.distance_to_source_m,
                "path_length_m": score.path_length_m,
                "time_s": self.flight.seen_by(name).time_s,
                **self.flight.end_of(name),
            }
            for name, score in self.flight.scores.items()
        }


def _box(n_numbers: int) -> "spaces.Space[_Numbers]":
    return spaces.Box(-1.0, 1.0, (n_numbers,), np.float32)


def parallel_env(**settings: Any) -> ParallelSearchEnv:
    """Return a parallel environment, as modules of PettingZoo name theirs; see `ParallelSearchEnv`."""
    return ParallelSearchEnv(**settings)


def _whole_ticks(step_s: float, tick_ns: int) -> int:
    ticks = step_s * NS_PER_S / tick_ns
    if ticks < 1 or abs(ticks - round(ticks)) > 1e-6:
        raise UsageError(f"step_s: expected a whole number of ticks of {tick_ns / NS_PER_S:g} s, was {step_s:g} s.")
    return round(ticks)
