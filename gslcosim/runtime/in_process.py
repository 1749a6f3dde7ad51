"""A run in one process and one thread: the same cores, gates and doors, without a bus."""

import time
import traceback
from collections.abc import Callable, Generator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from gslcosim.agent_kit import Agent
from gslcosim.contract import codec, keys
from gslcosim.contract.messages import Briefing, Command, Message, Observation, Verdict
from gslcosim.errors import GslCosimError, UsageError
from gslcosim.runtime.agents import find_python_agent, load_python_agent
from gslcosim.runtime.assembly import Setup, build_core, dataflow_of, service_names
from gslcosim.runtime.digest import RunDigest, Trail
from gslcosim.runtime.door import Door, door_name, faults_of
from gslcosim.runtime.outcome import Outcome, ServiceFault
from gslcosim.runtime.status import FlightStatus
from gslcosim.runtime.stepper import Stepper
from gslcosim.scenario.models import AgentSpec
from gslcosim.ticks import seconds_from_ticks

REPORT_EVERY_TICKS = 64


@dataclass
class _Seat:
    """An agent object behind its door."""

    spec: AgentSpec
    agent_type: type[Agent]
    door: Door
    trail: Trail = field(default_factory=Trail)
    agent: Agent | None = None

    def brief(self, briefing: Briefing) -> list[Command]:
        try:
            self.agent = self.agent_type(briefing)
        except (Exception, SystemExit):  # whatever an agent does is a result of the run
            return self.door.lost(f"the agent failed at its briefing: {traceback.format_exc(limit=-1).strip()}")
        return []

    def observe(self, observation: Observation) -> list[Command]:
        commands = self.door.observed(observation)
        if self.agent is None or self.door.is_closed:
            return commands
        try:
            self.agent.observe(observation)
            if observation.awaiting_command:
                answer = self.agent.decide(observation)
                commands += self.door.received(codec.encode(answer))
        except (Exception, SystemExit):  # as above
            reason = f"the agent failed at tick {observation.tick}: {traceback.format_exc(limit=-1).strip()}"
            commands += self.door.lost(reason)
        return commands


class InProcessFlight:
    """Flies a scenario in this thread; the order of steps is that of the dataflow, tick by tick."""

    def __init__(self, setup: Setup, seats: list[_Seat], report: Callable[[FlightStatus], None]) -> None:
        self._setup = setup
        self._report = report
        self._dataflow = dataflow_of(setup.scenario)
        self._seats = {keys.observation(seat.spec.name): seat for seat in seats}
        self._briefed = {keys.briefing(seat.spec.name): seat for seat in seats}
        order = [name for name in self._dataflow.order() if name in service_names(setup.scenario)]
        self._steppers = {name: Stepper(build_core(name, setup), self._dataflow) for name in order}
        self._readers: dict[str, list[Stepper]] = {
            port: [s for s in self._steppers.values() if any(read.port == port for read in s.spec.reads)]
            for port in self._dataflow.writes
        }
        # In one thread nobody runs ahead, so credit is never needed.
        for name in order:
            for reader in self._dataflow.readers_of(name):
                self._steppers[name].gate.grant(reader.name, 2**62)
        self._verdict: Verdict | None = None
        self._culprit = "runtime"

    def fly(self, is_interrupted: Callable[[], bool]) -> Outcome:
        """Fly until the verdict, a fault or an interruption."""
        outcome = Outcome()
        started = time.perf_counter()
        flying_since = started
        try:
            for name, stepper in self._steppers.items():
                self._culprit = name
                for sent in stepper.reset(self._setup.episode):
                    self._deliver(sent.port, sent.message)
            flying_since = time.perf_counter()
            outcome.start_up_s = flying_since - started
            self._step_all(is_interrupted, flying_since)
        except Exception as error:  # a fault of any core ends the run with its name
            text = str(error) if isinstance(error, GslCosimError) else traceback.format_exc()
            outcome.fault = ServiceFault(participant=self._culprit, tick=self._tick, text=text)
        outcome.is_interrupted = self._verdict is None and outcome.fault is None
        self._close(outcome)
        outcome.flight_wall_s = time.perf_counter() - flying_since
        outcome.ticks_flown = self._verdict.tick if self._verdict else self._tick
        outcome.verdict = self._verdict
        outcome.agent_faults = faults_of(seat.door for seat in self._seats.values())
        outcome.timing = {name: stepper.timing.as_fields() for name, stepper in self._steppers.items()}
        if self._verdict and outcome.fault is None:
            outcome.digest = self._digest(self._verdict.tick)
        return outcome

    @property
    def _tick(self) -> int:
        return max(min(stepper.gate.next_tick for stepper in self._steppers.values()) - 1, 0)

    def _step_all(self, is_interrupted: Callable[[], bool], started: float) -> None:
        steppers = list(self._steppers.items())
        while self._tick_is_open() and not is_interrupted():
            for name, stepper in steppers:
                if stepper.gate.may_step():
                    self._culprit = name
                    for sent in stepper.step():
                        self._deliver(sent.port, sent.message)
                elif not stepper.gate.is_finished:
                    missing = ", ".join(f"{m.port} at tick {m.tick}" for m in stepper.gate.missing())
                    raise GslCosimError(f"{name} cannot step tick {stepper.gate.next_tick}: it lacks {missing}.")
            if self._tick % REPORT_EVERY_TICKS == 0:
                self._tell(started)

    def _tick_is_open(self) -> bool:
        return not all(stepper.gate.is_finished for stepper in self._steppers.values())

    def _tell(self, started: float) -> None:
        sim_time_s = seconds_from_ticks(self._tick, self._setup.scenario.tick_ns)
        wall_s = max(time.perf_counter() - started, 1e-9)
        self._report(FlightStatus(state="flying", sim_time_s=sim_time_s, real_time_factor=sim_time_s / wall_s))

    def _deliver(self, port: str, message: Message) -> None:
        for reader in self._readers.get(port, ()):
            reader.gate.deliver(port, message)
        if isinstance(message, Observation):
            seat = self._seats[port]
            self._pass(seat, seat.observe(message))
        elif isinstance(message, Briefing):
            seat = self._briefed[port]
            self._pass(seat, seat.brief(message))
        elif isinstance(message, Verdict):
            self._verdict = message
            for stepper in self._steppers.values():
                stepper.gate.final_tick = message.tick

    def _pass(self, seat: _Seat, commands: list[Command]) -> None:
        for command in commands:
            seat.trail.append(command.tick, codec.encode(command))
            self._setup.run_dir.log_command(seat.spec.name, command)
            self._deliver(keys.command(seat.spec.name), command)

    def _close(self, outcome: Outcome) -> None:
        for name, stepper in self._steppers.items():
            close = getattr(stepper.core, "close", None)
            try:
                if close is not None:
                    close()
            except Exception:  # the others must still be closed
                fault = ServiceFault(participant=name, tick=self._tick, text=traceback.format_exc())
                outcome.fault = outcome.fault or fault
        for seat in self._seats.values():
            if seat.agent is not None and not seat.door.is_closed:
                _end_quietly(seat.agent, self._verdict.end_reason if self._verdict else "the run was ended")

    def _digest(self, final_tick: int) -> RunDigest:
        trails = {port: trail for s in self._steppers.values() for port, trail in s.trails.items()}
        writers = {port: self._dataflow.writer_of[port] for port in trails}
        for seat in self._seats.values():
            port = keys.command(seat.spec.name)
            trails[port], writers[port] = seat.trail, door_name(seat.spec.name)
        return RunDigest(final_tick, writers, {port: trail.until(final_tick) for port, trail in trails.items()})


def fly_in_process(setup: Setup, directory: Path, report: Callable[[FlightStatus], None]) -> Outcome:
    """Fly a scenario whose agents are all Python agents in this process.

    Args:
        setup: The run.
        directory: The scenario's folder, where relative paths of agents start.
        report: Is told how the flight goes.

    Raises:
        UsageError: an agent is not a Python agent, or cannot be loaded.
    """
    seats = [_seat(agent, directory) for agent in setup.scenario.agents]
    with _interruption() as is_interrupted:
        return InProcessFlight(setup, seats, report).fly(is_interrupted)


def _seat(agent: AgentSpec, directory: Path) -> _Seat:
    if agent.start.python is None:
        raise UsageError(
            f"agents.{agent.name}.start: expected a python agent for a run in one process, was another. "
            "Leave out --in-process, or start the agent with `python:`."
        )
    agent_type = load_python_agent(find_python_agent(agent.start.python, directory))
    return _Seat(agent, agent_type, Door(agent.name, may_overlap=agent.latency_ticks > 1))


def _end_quietly(agent: Agent, reason: str) -> None:
    try:
        agent.end(reason)
    except Exception:  # the run is over; nothing an agent does now counts
        return


@contextmanager
def _interruption() -> Generator[Callable[[], bool]]:
    from gslcosim.runtime.interruption import Interruption

    with Interruption() as interruption:
        yield interruption.is_set
