"""Simulation: a live run of a scenario in this process, stepped, played, paused and reset by its caller."""

import threading
import time
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Self, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gslcosim.base.errors import SimulationFault, UsageError
from gslcosim.base.files import ScratchFolder
from gslcosim.base.processes import Interruption
from gslcosim.base.ticks import NS_PER_S, seconds_from_ticks
from gslcosim.contract import codec
from gslcosim.contract.messages import (
    AgentScore,
    BodyPoses,
    BodyState,
    Briefing,
    Command,
    FieldSamples,
    Message,
    MountSample,
    Observation,
    Score,
)
from gslcosim.environment.generation.cache import load_rooms, prepare_environment
from gslcosim.environment.model import Environment
from gslcosim.environment.positions import draw_positions
from gslcosim.runtime.agents.session import AgentSessions, AgentTransport, CommandReceived, SteppedTransport
from gslcosim.runtime.in_process import InProcessRun, host_agents
from gslcosim.runtime.network import Network
from gslcosim.runtime.outcome import RunOutcome
from gslcosim.runtime.run_dir import RunDir
from gslcosim.runtime.setup import RunSetup
from gslcosim.runtime.warmup import build_resting_body
from gslcosim.scenario import LoadedScenario, Scenario, load_scenario
from gslcosim.scenario.checks.registry import list_scenario_checks
from gslcosim.scenario.models.gas import SourceSpec
from gslcosim_services.fields.core import FieldsCore

_Message = TypeVar("_Message", bound=Message)


class Truth:
    """Ground truth of a simulation now: for its caller, which organises the run, and never for agents.

    `bodies` and `samples` are of the tick of the last step, or of the one that waits for a command.
    """

    def __init__(self, simulation: "Simulation") -> None:
        self._simulation = simulation

    @property
    def bodies(self) -> Mapping[str, BodyState]:
        """True pose, velocity and contacts of each agent's vehicle; at its start before the first step."""
        poses = self._simulation.get_latest(BodyPoses)
        if poses is None:
            return {agent.name: build_resting_body(agent) for agent in self._simulation.scenario.agents}
        return {body.agent: body for body in poses.bodies}

    @property
    def samples(self) -> Sequence[MountSample]:
        """True gas and wind at each sensor; empty before the first step."""
        samples = self._simulation.get_latest(FieldSamples)
        return () if samples is None else samples.samples

    @property
    def sources(self) -> Sequence[SourceSpec]:
        """Sources of the scenario, with `position_m`; events of the run may have moved or closed them."""
        return self._simulation.scenario.gas.sources

    @property
    def gases(self) -> tuple[str, ...]:
        """Names of all gases; the first is the one to find."""
        return self._simulation.find_fields().gases

    def gas_ppm(self, points_world_m: ArrayLike, gas: str | None = None) -> NDArray[np.float64]:
        """Return the mixing ratio at (n, 3) points, world frame [m], as (n,) in ppm by volume.

        It is what a sensor without errors would read there: gas behind walls is not seen.

        Args:
            points_world_m: The points; a single one may be given by three numbers.
            gas: Its name; absent: the gas to find.

        Raises:
            UsageError: a point is outside the room, or there is no such gas.
        """
        fields, points_m = self._simulation.find_fields(), self._check_points(points_world_m)
        if gas is not None and gas not in fields.gases:
            raise UsageError(f"gas: expected one of {', '.join(fields.gases)}, was {gas!r}.")
        i_gas = 0 if gas is None else fields.gases.index(gas)
        with self._simulation.lock:
            return fields.compute_gas_ppm(points_m)[:, i_gas]

    def wind_m_s(self, points_world_m: ArrayLike) -> NDArray[np.float64]:
        """Return the wind at (n, 3) points, world frame [m], as (n, 3) in m/s.

        Raises:
            UsageError: a point is outside the room.
        """
        fields, points_m = self._simulation.find_fields(), self._check_points(points_world_m)
        with self._simulation.lock:
            samples = self._simulation.get_latest(FieldSamples)
            return fields.compute_wind_m_s(points_m, 0 if samples is None else samples.tick)

    def _check_points(self, points_world_m: ArrayLike) -> NDArray[np.float64]:
        points_m = np.atleast_2d(np.asarray(points_world_m, np.float64))
        if points_m.ndim != 2 or points_m.shape[1] != 3:
            raise UsageError(f"points_world_m: expected (n, 3) coordinates, was of shape {points_m.shape}.")
        grid = self._simulation.environment.grid
        i = grid.find_point_outside(points_m)
        if i is not None:
            raise UsageError(
                f"points_world_m: expected points in the room, from {grid.origin_m} to {grid.max_m} m, "
                f"was {tuple(points_m[i].tolist())} m at index {i}."
            )
        return points_m


class Simulation:
    """Live run of a scenario in this process, which its caller steps, plays, pauses and resets; use it as a context.

    It is the run that `gslcosim up` makes of the scenario, with the same digest; nothing of it is recorded. Agents
    of the scenario decide as usual, except those that `commanded` names: time waits for `command`. A caller that steps
    gets the true state as `truth`, agents never do.

    Args:
        scenario: A file, or the name of a bundled scenario.
        seed: Replaces the scenario's seed.
        overrides: Values to replace, such as `agents[0].mode=lockstep`.
        commanded: Names of agents whose commands come from the caller; absent: those with `start: {attach: true}`.

    Raises:
        GslCosimError: the scenario has problems, time does not wait for one of its agents, or an agent cannot be
            started.

    Example:
        >>> with gslcosim.Simulation("tiny_room", seed=3) as simulation:
        ...     simulation.step(50)
        ...     print(simulation.time_s, simulation.observe()["beetle"].position_world_m)
    """

    def __init__(
        self,
        scenario: str | Path | LoadedScenario,
        *,
        seed: int | None = None,
        overrides: Sequence[str] = (),
        commanded: Collection[str] | None = None,
    ) -> None:
        self._source = scenario
        self._overrides = tuple(overrides)
        self._commanded = commanded
        # Held while a tick is computed or state is read: `play` steps on a thread of its own.
        self.lock = threading.RLock()
        self._player: _Player | None = None
        self._start(self._load(seed))

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def scenario(self) -> Scenario:
        """Scenario of the run, with its seed."""
        return self._loaded.scenario

    @property
    def tick(self) -> int:
        """Tick of the present state, -1 before the first; while a command is awaited, that of the observation."""
        return self._run.next_tick - (1 if self._run.is_between_ticks else 0)

    @property
    def n_finished_ticks(self) -> int:
        """Number of ticks that all participants have finished."""
        return self._run.next_tick

    @property
    def time_s(self) -> float:
        """Simulated time of the present state [s]; 0 before the first tick."""
        return seconds_from_ticks(max(self.tick, 0), self.scenario.tick_ns)

    @property
    def is_over(self) -> bool:
        """True when the run has ended, by its verdict or by `close`; `outcome` then has the reason."""
        return self._is_over

    @property
    def is_playing(self) -> bool:
        """True between `play` and `pause`, until the run ends."""
        return self._player is not None and self._player.is_alive()

    @property
    def asked(self) -> tuple[str, ...]:
        """The agents whose command is awaited from the caller."""
        return tuple(name for name, transport in self._transports.items() if transport.questions)

    @property
    def truth(self) -> Truth:
        """Ground truth of now."""
        return Truth(self)

    @property
    def scores(self) -> Mapping[str, AgentScore]:
        """Referee's standing of each agent at the last tick; empty before the first."""
        score = self.get_latest(Score)
        return {} if score is None else {agent.agent: agent for agent in score.agents}

    @property
    def digest(self) -> str:
        """Digest of all messages of finished ticks; equal for equal runs.

        Raises:
            UsageError: no tick is finished.
        """
        with self.lock:
            if self.outcome.digest is not None:
                return self.outcome.digest.hex
            if self.n_finished_ticks == 0:
                raise UsageError("digest: expected a simulation with a finished tick, was one before its first.")
            return self._run.digest(self.n_finished_ticks - 1).hex

    def observe(self) -> Mapping[str, Observation]:
        """Return the last observation of each agent, as the agent gets it; empty before the first step."""
        with self.lock:
            return dict(self._observations)

    def get_briefing(self, agent: str) -> Briefing:
        """Return the briefing that an agent got at the start.

        Raises:
            UsageError: the scenario has no such agent.
        """
        if agent not in self._briefings:
            raise UsageError(f"agent: expected one of {', '.join(self._briefings)}, was {agent!r}.")
        return self._briefings[agent]

    def get_question(self, agent: str) -> Observation | None:
        """Return the observation for which a command of the caller is awaited; None where none is."""
        questions = self._transports[agent].questions if agent in self._transports else ()
        return questions[0] if questions else None

    def step(self, n_ticks: int = 1) -> int:
        """Simulate so many ticks, or fewer where the run ends or a command of the caller is awaited in one of them.

        A tick in which a command is awaited is finished by the next step. Ctrl-C ends the step after the present
        tick; the simulation can be continued.

        Returns:
            By how many ticks `tick` has grown.

        Raises:
            UsageError: it is playing, over, or a command is awaited.
            SimulationFault: a service has failed.
        """
        if n_ticks < 1:
            raise UsageError(f"n_ticks: expected at least 1, was {n_ticks}.")
        self._check_paused("step")
        if self._is_over:
            raise UsageError(f"step: expected a run that goes on, was over ({self._describe_end()}). Call reset.")
        if self.asked:
            raise UsageError(f"step: expected commands for {', '.join(self.asked)} first, was none. Call command.")
        first = self.tick
        with Interruption() as interruption:
            while self.tick < first + n_ticks and not (self._is_over or self.asked):
                if interruption.is_set():
                    raise KeyboardInterrupt
                self.advance(self.tick + 2)
        return self.tick - first

    def command(self, agent: str, command: Command) -> None:
        """Give the command of an agent that is asked; it is checked, and takes effect, as that of any agent.

        Args:
            agent: Its name.
            command: With the tick of the observation that it answers.

        Raises:
            UsageError: the agent is not one that is asked.
        """
        with self.lock:
            if agent not in self.asked:
                found = f"{', '.join(self.asked)} are asked" if self.asked else "no agent is asked"
                raise UsageError(f"command: expected an agent that is asked, was {agent!r}: {found}.")
            self._transports[agent].questions.popleft()
            self._agents.events.put(CommandReceived(agent=agent, payload=codec.encode(command), decided_in_s=0.0))

    def play(self, pace: float | None = None) -> None:
        """Let time go on, on a thread of its own, until `pause`, the end of the run, or a command that is awaited.

        Args:
            pace: Simulated seconds in a second; absent: as fast as it goes.

        Raises:
            UsageError: it is playing already, or over.
        """
        self._check_paused("play")
        if self._is_over:
            raise UsageError(f"play: expected a run that goes on, was over ({self._describe_end()}). Call reset.")
        if pace is not None and not pace > 0.0:
            raise UsageError(f"pace: expected a number greater than 0, was {pace}.")
        self._player = _Player(self, None if pace is None else self.scenario.tick_ns / NS_PER_S / pace)
        self._player.start()

    def pause(self) -> None:
        """Let time stand still after the tick that is being computed; without effect where it does.

        Raises:
            SimulationFault: a service has failed while it played.
        """
        player, self._player = self._player, None
        if player is not None:
            player.finish()

    def reset(self, seed: int | None = None) -> None:
        """Start again before tick 0, paused: with the seed it had, or another.

        Raises:
            GslCosimError: the scenario cannot be run with this seed.
        """
        seed = self.scenario.seed if seed is None else seed
        loaded = self._loaded if seed == self.scenario.seed else self._load(seed)
        self.close()
        self._start(loaded)

    def close(self) -> None:
        """End the run, wherever it is, and all that it has started."""
        try:
            self.pause()
        finally:
            with self.lock:
                self._is_closed = True
                for _ in self._pauses:
                    pass
                self._is_over = True
                self._stack.close()

    def advance(self, until_tick: int | None) -> None:
        """Go on until all ticks before `until_tick` are finished, a command is awaited, or the run is over.

        Args:
            until_tick: The first tick that is not simulated; None: no tick ends it.

        Raises:
            SimulationFault: a service has failed.
        """
        with self.lock:
            self._run.pause_before_tick = until_tick
            for _ in self._pauses:
                if self.asked or (until_tick is not None and self._run.next_tick >= until_tick):
                    return
            self._is_over = True
        if self.outcome.fault is not None:
            raise SimulationFault(f"{self.outcome.fault.participant}: {self.outcome.fault.text}")

    def get_latest(self, kind: type[_Message]) -> _Message | None:
        """Return the last message of a type; None before the first."""
        return self._latest.get(kind)  # type: ignore[return-value]

    def find_fields(self) -> FieldsCore:
        """Return the core that computes gas and wind.

        Raises:
            UsageError: a service of another package has taken its place.
        """
        fields = self._run.find_core(FieldsCore)
        if fields is None:
            raise UsageError("truth: expected the fields service of gslcosim, was that of another package.")
        return fields

    def _load(self, seed: int | None) -> LoadedScenario:
        if isinstance(self._source, LoadedScenario):
            if seed is not None and seed != self._source.scenario.seed:
                raise UsageError(f"seed: expected that of the scenario, {self._source.scenario.seed}, was {seed}.")
            return self._source
        return load_scenario(
            self._source,
            overrides=self._overrides,
            seed=seed,
            checks=list_scenario_checks(processes="one"),
            placer=draw_positions,
        )

    def _start(self, loaded: LoadedScenario) -> None:
        if any(agent.is_free for agent in loaded.scenario.agents):
            raise UsageError("agents[].mode: expected modes that wait for the agent, was free. Take on_request.")
        self._loaded = loaded
        self._is_over = self._is_closed = False
        self._latest: dict[type[Message], Message] = {}
        self._observations: dict[str, Observation] = {}
        self._briefings: dict[str, Briefing] = {}
        self._transports = {name: SteppedTransport() for name in self._list_commanded()}
        with ExitStack() as stack:
            setup = self._build_setup(Path(stack.enter_context(ScratchFolder("simulation")).path))
            self.environment: Environment = setup.environment
            transports: Mapping[str, AgentTransport] = dict(self._transports)
            self._agents: AgentSessions = stack.enter_context(
                host_agents(setup, loaded.directory, Network(), commanded=transports)
            )
            for name in self._transports:
                session = self._agents[name]
                # A caller takes as long as they like, and keeps their own notes.
                session.answer_within_s = float("inf")
                session.journal = lambda _: None
            self._run = InProcessRun(setup, self._agents, lambda _: None, self.on_message)
            self.outcome: RunOutcome = self._run.outcome
            self._pauses: Iterator[None] = self._run.iter_pauses(lambda: self._is_closed)
            self._stack = stack.pop_all()
        try:
            self.advance(0)
        except BaseException:
            self.close()
            raise

    def on_message(self, port: str, message: Message) -> None:
        """Take note of a message of the run, in the order in which they are delivered."""
        del port
        if isinstance(message, Observation):
            self._observations[message.agent] = message
        elif isinstance(message, Briefing):
            self._briefings[message.agent] = message
        else:
            self._latest[type(message)] = message

    def _list_commanded(self) -> tuple[str, ...]:
        agents = self.scenario.agents
        if self._commanded is None:
            attached = {agent.name for agent in agents if agent.start.attach}
            return tuple(agent.name for agent in agents if agent.process in attached)
        names = [agent.name for agent in agents]
        unknown = [name for name in self._commanded if name not in names]
        if unknown:
            raise UsageError(f"commanded: expected agents of the scenario ({', '.join(names)}), was {unknown[0]!r}.")
        for agents_of_process in self.scenario.agents_by_process().values():
            if 0 < len(set(agents_of_process) & set(self._commanded)) < len(agents_of_process):
                raise UsageError(
                    f"commanded: expected all of {', '.join(agents_of_process)} or none: they are one process."
                )
        return tuple(name for name in names if name in self._commanded)

    def _build_setup(self, folder: Path) -> RunSetup:
        loaded = self._loaded
        recording = loaded.scenario.recording.model_copy(update={"enabled": False})
        scenario = loaded.scenario.model_copy(update={"recording": recording})
        environment_dir = prepare_environment(scenario, scenario_dir=loaded.directory)
        environment, _ = load_rooms(environment_dir, scenario, scenario_dir=loaded.directory)
        return RunSetup(
            run_dir=RunDir(folder),
            scenario=scenario,
            environment_dir=environment_dir,
            environment=environment,
            directory=loaded.directory,
        )

    def _check_paused(self, action: str) -> None:
        if self.is_playing:
            raise UsageError(f"{action}: expected a paused simulation, was playing. Call pause first.")
        # The error that ended the playing is raised here at the latest.
        self.pause()

    def _describe_end(self) -> str:
        if self.outcome.verdict is not None:
            return self.outcome.verdict.end_reason
        return "a service failed" if self.outcome.fault is not None else "closed"


class _Player(threading.Thread):
    """Thread that steps a simulation until it is stopped, the run ends or a command of the caller is awaited."""

    def __init__(self, simulation: Simulation, tick_wall_s: float | None) -> None:
        super().__init__(name="plays a simulation", daemon=True)
        self._simulation = simulation
        self._tick_wall_s = tick_wall_s
        self._pause_request = threading.Event()
        self._error: BaseException | None = None

    def finish(self) -> None:
        """Stop after the tick that is being computed, and raise what has gone wrong."""
        self._pause_request.set()
        self.join()
        if self._error is not None:
            raise self._error

    def run(self) -> None:
        """Step tick by tick; see `threading.Thread`."""
        simulation, due_s = self._simulation, time.monotonic()
        try:
            while not (self._pause_request.is_set() or simulation.is_over or simulation.asked):
                simulation.advance(simulation.tick + 2)
                if self._tick_wall_s is not None:
                    due_s += self._tick_wall_s
                    self._pause_request.wait(max(0.0, due_s - time.monotonic()))
        except BaseException as error:  # raised again by `pause`, on the caller's thread
            self._error = error
