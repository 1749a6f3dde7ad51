"""A run in one process and one thread: the same cores, gates and doors, without a bus."""

import queue
import shutil
import tempfile
import time
import traceback
from collections.abc import Callable, Generator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path

from gslcosim.agent_kit import Agent
from gslcosim.contract import codec, keys
from gslcosim.contract.messages import Briefing, Command, Message, Observation, Verdict
from gslcosim.contract.participant import Closes
from gslcosim.errors import GslCosimError, UsageError
from gslcosim.runtime.agents.door import Door, door_name, door_of, faults_of
from gslcosim.runtime.agents.guests import COMMAND, GONE, READY, REFUSED, Guests
from gslcosim.runtime.agents.starting import find_python_agent, load_python_agent
from gslcosim.runtime.assembly import build_core, dataflow_of, service_names
from gslcosim.runtime.digest import RunDigest, Trail
from gslcosim.runtime.joining import JOIN_LIMIT_S, Network
from gslcosim.runtime.outcome import Outcome, ServiceFault, ending_of
from gslcosim.runtime.processes import EXIT_LIMIT_S, Children
from gslcosim.runtime.setup import Setup
from gslcosim.runtime.status import FlightStatus
from gslcosim.runtime.stepper import Stepper
from gslcosim.scenario import Scenario
from gslcosim.scenario.models.scenario import AgentSpec
from gslcosim.ticks import seconds_from_ticks

REPORT_EVERY_TICKS = 64
LOOK_EVERY_S = 0.1
_Event = tuple[str, str, bytes]
# Is told every message with its port, in the order in which they are delivered.
Watch = Callable[[str, Message], None]


@dataclass
class _Seat:
    """An agent object behind its door."""

    spec: AgentSpec
    agent_type: type[Agent]
    door: Door
    trail: Trail = field(default_factory=Trail)
    agent: Agent | None = None
    decisions_s: list[float] = field(default_factory=list[float])

    @property
    def owes_answer(self) -> bool:
        """Whether to wait for it: never, an object answers at once."""
        return False

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
                asked_at = time.perf_counter()
                answer = self.agent.decide(observation)
                self.decisions_s.append(time.perf_counter() - asked_at)
                commands += self.door.received(codec.encode(answer))
                commands += self._lost_answer(answer)
        except (Exception, SystemExit):  # as above
            reason = f"the agent failed at tick {observation.tick}: {traceback.format_exc(limit=-1).strip()}"
            commands += self.door.lost(reason)
        return commands

    # An object answers now or never: what is still owed after its answer never comes.
    def _lost_answer(self, answer: Command) -> list[Command]:
        ticks = [observation.tick for observation in self.door.pending]
        if not ticks:
            return []
        return self.door.lost(
            f"expected an answer to the observation of tick {ticks[0]}, was one to tick {answer.tick}."
        )

    def end(self, reason: str) -> None:
        """Tell the agent that the run is over."""
        if self.agent is not None and not self.door.is_closed:
            _end_quietly(self.agent, reason)


@dataclass
class _GuestSeat:
    """An agent's process behind the gateway and behind its door."""

    spec: AgentSpec
    guests: Guests
    door: Door
    trail: Trail = field(default_factory=Trail)
    decisions_s: list[float] = field(default_factory=list[float])
    asked_at: float = 0.0

    @property
    def owes_answer(self) -> bool:
        """Whether the run may have to wait for it."""
        return bool(self.door.pending)

    def brief(self, briefing: Briefing) -> list[Command]:
        self.guests.brief(self.spec.name, codec.encode(briefing))
        return []

    def observe(self, observation: Observation) -> list[Command]:
        was_asked = self.owes_answer
        commands = self.door.observed(observation)
        if self.owes_answer and not was_asked:
            self.asked_at = time.monotonic()
        self.guests.observe(self.spec.name, codec.encode(observation), is_question=observation.awaiting_command)
        return commands

    def handle(self, kind: str, payload: bytes) -> list[Command]:
        """Take what the agent's process did; return the commands that can pass now."""
        if kind == GONE:
            return self.door.lost(self.guests.with_last_words(self.spec.name, payload.decode()))
        if kind not in (COMMAND, REFUSED):
            return []
        self.guests.handled(self.spec.name)
        if self.owes_answer:
            self.decisions_s.append(time.monotonic() - self.asked_at)
        self.asked_at = time.monotonic()
        return self.door.received(payload) if kind == COMMAND else self.door.refused(payload.decode())

    def check_time(self) -> list[Command]:
        """Return `failed` when an answer is owed for too long."""
        limit_s = self.spec.answer_within_s
        if not self.owes_answer or time.monotonic() - self.asked_at <= limit_s:
            return []
        text = f"the agent did not answer within {limit_s:g} s."
        return self.door.lost(self.guests.with_last_words(self.spec.name, text))

    def end(self, reason: str) -> None:
        """Leave it to the gateway to tell the process."""


class InProcessFlight:
    """Flies a scenario in this thread; the order of steps is that of the dataflow, tick by tick.

    Agents behind the gateway are processes; simulated time goes on until it needs their answer, and then waits.
    """

    def __init__(
        self,
        setup: Setup,
        seats: "list[_Seat | _GuestSeat]",
        events: "queue.SimpleQueue[_Event]",
        report: Callable[[FlightStatus], None],
        watch: Watch | None = None,
    ) -> None:
        self._watch = watch
        self._events = events
        self._by_agent = {seat.spec.name: seat for seat in seats}
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
        outcome.decisions_s = [taken_s for seat in self._seats.values() for taken_s in seat.decisions_s]
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
            self._hear_guests()
            for name, stepper in steppers:
                while not stepper.gate.may_step() and self._waits_for_guest(stepper) and not is_interrupted():
                    self._wait_for_guest()
                if is_interrupted():
                    return
                if stepper.gate.may_step():
                    self._culprit = name
                    for sent in stepper.step():
                        self._deliver(sent.port, sent.message)
                elif not stepper.gate.is_finished:
                    missing = ", ".join(f"{m.port} at tick {m.tick}" for m in stepper.gate.missing())
                    raise GslCosimError(f"{name} cannot step tick {stepper.gate.next_tick}: it lacks {missing}.")
            if self._tick % REPORT_EVERY_TICKS == 0:
                self._tell(started)

    def _waits_for_guest(self, stepper: Stepper) -> bool:
        return not stepper.gate.is_finished and any(seat.owes_answer for seat in self._seats.values())

    def _wait_for_guest(self) -> None:
        with suppress(queue.Empty):
            self._hear(*self._events.get(timeout=LOOK_EVERY_S))
        for seat in self._seats.values():
            if isinstance(seat, _GuestSeat):
                self._pass(seat, seat.check_time())

    # One round, so that an agent that never stops talking does not stop the run.
    def _hear_guests(self) -> None:
        for _ in range(self._events.qsize()):
            self._hear(*self._events.get())

    def _hear(self, kind: str, name: str, payload: bytes) -> None:
        seat = self._by_agent[name]
        if isinstance(seat, _GuestSeat):
            self._pass(seat, seat.handle(kind, payload))

    def _tick_is_open(self) -> bool:
        return not all(stepper.gate.is_finished for stepper in self._steppers.values())

    def _tell(self, started: float) -> None:
        sim_time_s = seconds_from_ticks(self._tick, self._setup.scenario.tick_ns)
        wall_s = max(time.perf_counter() - started, 1e-9)
        self._report(FlightStatus(state="flying", sim_time_s=sim_time_s, real_time_factor=sim_time_s / wall_s))

    def _deliver(self, port: str, message: Message) -> None:
        if self._watch is not None:
            self._watch(port, message)
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

    def _pass(self, seat: _Seat | _GuestSeat, commands: list[Command]) -> None:
        for command in commands:
            seat.trail.append(command.tick, codec.encode(command))
            self._setup.run_dir.log_command(seat.spec.name, command)
            self._deliver(keys.command(seat.spec.name), command)

    def _close(self, outcome: Outcome) -> None:
        for name, stepper in self._steppers.items():
            try:
                if isinstance(stepper.core, Closes):
                    stepper.core.close()
            except Exception:  # the others must still be closed
                fault = ServiceFault(participant=name, tick=self._tick, text=traceback.format_exc())
                outcome.fault = outcome.fault or fault
        for seat in self._seats.values():
            seat.end(ending_of(self._verdict).reason)

    def _digest(self, final_tick: int) -> RunDigest:
        trails = {port: trail for s in self._steppers.values() for port, trail in s.trails.items()}
        writers = {port: self._dataflow.writer_of[port] for port in trails}
        for seat in self._seats.values():
            port = keys.command(seat.spec.name)
            trails[port], writers[port] = seat.trail, door_name(seat.spec.name)
        return RunDigest(final_tick, writers, {port: trail.until(final_tick) for port, trail in trails.items()})


def fly_in_process(
    setup: Setup,
    directory: Path,
    network: Network,
    report: Callable[[FlightStatus], None],
    watch: Watch | None = None,
) -> Outcome:
    """Fly a scenario in this process: Python agents as objects in it, agents behind the gateway as processes.

    Args:
        setup: The run.
        directory: The scenario's folder, where relative paths of agents start.
        network: Where agents that attach themselves find their join data.
        report: Is told how the flight goes.
        watch: Is told every message, for figures of the flight; it must change none.

    Raises:
        UsageError: an agent is neither, or cannot be loaded or started.
    """
    events: queue.SimpleQueue[_Event] = queue.SimpleQueue()
    guests = Guests(setup, directory, network, lambda kind, name, payload: events.put((kind, name, payload)))
    agent_types = _agent_types(setup, directory, guests)
    seats = [_seat(agent, setup.scenario, agent_types, guests) for agent in setup.scenario.agents]
    socket_dir = Path(tempfile.mkdtemp(prefix="gslcosim-"))
    with ExitStack() as stack:
        stack.callback(shutil.rmtree, socket_dir, ignore_errors=True)
        is_interrupted = stack.enter_context(_interruption())
        children = stack.enter_context(Children(guests.exited))
        stack.callback(guests.close)
        guests.start(children, socket_dir)
        _await_guests(guests, seats, events, is_interrupted)
        outcome = InProcessFlight(setup, seats, events, report, watch).fly(is_interrupted)
        guests.end(codec.encode(ending_of(outcome.verdict)))
        children.wait(EXIT_LIMIT_S)
    return outcome


def _await_guests(
    guests: Guests,
    seats: "list[_Seat | _GuestSeat]",
    events: "queue.SimpleQueue[_Event]",
    is_interrupted: Callable[[], bool],
) -> None:
    expected = {seat.spec.name: seat for seat in seats if isinstance(seat, _GuestSeat)}
    by_name = dict(expected)
    deadline = time.monotonic() + JOIN_LIMIT_S
    while expected and not is_interrupted():
        if time.monotonic() > deadline:
            for name, seat in expected.items():
                seat.door.lost(guests.absence_text(name))
            return
        with suppress(queue.Empty):
            kind, name, payload = events.get(timeout=LOOK_EVERY_S)
            if kind in (READY, GONE):
                expected.pop(name, None)
            by_name[name].handle(kind, payload)


# One for each process, so that its agents share here what they share there.
def _agent_types(setup: Setup, directory: Path, guests: Guests) -> dict[str, type[Agent]]:
    types: dict[str, type[Agent]] = {}
    for agent in setup.scenario.agents:
        if agent.name in guests or agent.process != agent.name:
            continue
        if agent.start.python is None:
            raise UsageError(
                f"agents.{agent.name}.start: expected a python agent, or one with door: stdio, tcp or unix, for a run "
                "in one process, was one with door: zenoh. Leave out --in-process."
            )
        types[agent.name] = load_python_agent(find_python_agent(agent.start.python, directory))
    return types


def _seat(
    agent: AgentSpec, scenario: Scenario, agent_types: dict[str, type[Agent]], guests: Guests
) -> "_Seat | _GuestSeat":
    door = door_of(agent, scenario)
    return _GuestSeat(agent, guests, door) if agent.name in guests else _Seat(agent, agent_types[agent.process], door)


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
