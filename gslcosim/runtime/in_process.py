"""Run in one process and one thread: the same cores, gates and agent sessions, without a bus."""

import queue
import time
import traceback
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any

from gslcosim.agent_kit import Agent
from gslcosim.base.errors import GslCosimError, RunFolderError, format_fault
from gslcosim.base.files import ScratchFolder
from gslcosim.base.processes import Interruption
from gslcosim.base.ticks import seconds_from_ticks
from gslcosim.contract import codec, keys
from gslcosim.contract.messages import Briefing, Message, Observation, Verdict
from gslcosim.contract.participant import Core, SupportsClose, SupportsSummary
from gslcosim.runtime.agents.gateway_transport import GatewayAgents
from gslcosim.runtime.agents.loader import load_agent_types
from gslcosim.runtime.agents.session import (
    AgentEvent,
    AgentSession,
    AgentTransport,
    EventSink,
    ObjectTransport,
    ThreadedTransport,
    WorkerThread,
    build_agent_statuses,
    build_session,
)
from gslcosim.runtime.agents.validator import collect_faults
from gslcosim.runtime.digest import RunDigest
from gslcosim.runtime.network import JOIN_TIMEOUT_S, Network
from gslcosim.runtime.outcome import RunOutcome, ServiceFault, build_ending
from gslcosim.runtime.participant_status import ParticipantStatus
from gslcosim.runtime.processes.children import EXIT_TIMEOUT_S, ChildProcesses, PauseDetector, StopMonitor
from gslcosim.runtime.replay.snapshot_policy import SnapshotPolicy
from gslcosim.runtime.services import build_core, build_dataflow, list_service_names
from gslcosim.runtime.setup import RunSetup
from gslcosim.runtime.status import RunStatus
from gslcosim.runtime.stepper import NO_TICK_LIMIT, PACED_PARTICIPANT, SentMessage, Stepper, build_clock_pace
from gslcosim.scenario.models.scenario import AgentSpec

REPORT_EVERY_TICKS = 64
POLL_PERIOD_S = 0.1
# Receives every message with its port, in the order in which they are delivered.
MessageObserver = Callable[[str, Message], None]


class InProcessRun:
    """Run of a scenario in this thread; the order of steps is that of the dataflow, tick by tick.

    Agents behind the gateway are processes; simulated time goes on until it needs their answer, and then waits.
    The run ends with the verdict, or after `until_tick` if that comes first.
    """

    def __init__(
        self,
        setup: RunSetup,
        sessions: Mapping[str, AgentSession],
        events: "queue.SimpleQueue[AgentEvent]",
        report: Callable[[RunStatus], None],
        watch: MessageObserver | None = None,
        until_tick: int | None = None,
    ) -> None:
        self._watch = watch
        self._events = events
        self._sessions = sessions
        self._setup = setup
        self._report = report
        self._dataflow = build_dataflow(setup.scenario)
        self._observed_by = {keys.observation(name): session for name, session in sessions.items()}
        self._briefed_by = {keys.briefing(name): session for name, session in sessions.items()}
        self._keeping = SnapshotPolicy.of(setup)
        order = [name for name in self._dataflow.order() if name in list_service_names(setup.scenario)]
        self._steppers = {name: self._keeping.stepper(build_core(name, setup), self._dataflow) for name in order}
        self._readers: dict[str, list[Stepper]] = {
            port: [s for s in self._steppers.values() if any(read.port == port for read in s.spec.reads)]
            for port in self._dataflow.writes
        }
        for stepper in self._steppers.values():
            stepper.gate.final_tick = until_tick
        # In one thread nobody runs ahead, so credit is never needed.
        for name in order:
            for reader in self._dataflow.readers_of(name):
                self._steppers[name].gate.grant(reader.name, NO_TICK_LIMIT)
        self._verdict: Verdict | None = None
        self._culprit = "runtime"
        self._pauses = PauseDetector()
        self._pace = build_clock_pace(setup)

    def fly(self, is_interrupted: Callable[[], bool]) -> RunOutcome:
        """Fly until the verdict, a fault or an interruption."""
        outcome = RunOutcome()
        for _ in self.iter_pauses(outcome, is_interrupted):
            pass
        return outcome

    def iter_pauses(self, outcome: RunOutcome, is_interrupted: Callable[[], bool]) -> Iterator[None]:
        """Fly as `fly` does, and pause wherever simulated time has come as far as it can without an agent's answer.

        Whoever flies an agent by hand answers in the pause.

        Args:
            outcome: What the run has brought in is put into it, in the end.
            is_interrupted: Is asked again and again whether to go on.
        """
        started = flying_since = time.perf_counter()
        try:
            for name, stepper in self._steppers.items():
                self._culprit = name
                for sent in stepper.reset(self._setup.episode):
                    self._deliver(sent)
            self._go_on(is_interrupted)
            flying_since = time.perf_counter()
            outcome.start_up_s = flying_since - started
            yield from self._step_all(is_interrupted, flying_since)
        except Exception as error:  # a fault of any core ends the run with its name
            # The journal of commands is the runtime's own, whatever the transport.
            culprit = "supervisor" if isinstance(error, RunFolderError) else self._culprit
            text = format_fault(error, traceback.format_exc())
            outcome.fault = ServiceFault(participant=culprit, tick=self._tick, text=text)
        outcome.is_cut = self._verdict is None and outcome.fault is None and not self._tick_is_open()
        outcome.is_interrupted = self._verdict is None and outcome.fault is None and not outcome.is_cut
        self._close(outcome)
        outcome.flight_wall_s = time.perf_counter() - flying_since
        outcome.ticks_flown = self._verdict.tick if self._verdict else self._tick
        outcome.verdict = self._verdict
        outcome.decisions_s = [taken_s for session in self._sessions.values() for taken_s in session.decisions_s]
        outcome.agent_faults = collect_faults(session.validator for session in self._sessions.values())
        outcome.timing = {name: stepper.timing.as_fields() for name, stepper in self._steppers.items()}
        outcome.summary = _collect_summaries(stepper.core for stepper in self._steppers.values())
        outcome.summary |= self._pace.summary() if self._pace else {}
        if outcome.is_cut or (self._verdict and outcome.fault is None):
            outcome.digest = self._digest(outcome.ticks_flown)

    # Services begin at the snapshot; agents live through what came before, in the order in which they got it.
    def _go_on(self, is_interrupted: Callable[[], bool]) -> None:
        self._keeping.go_on(self._steppers.values(), self._dataflow)
        for observations in self._setup.snapshot.read_observations() if self._setup.snapshot else ():
            for agent, payload in observations:
                self._deliver_all(self._sessions[agent].observe(codec.decode_observation_head(payload), payload))
                self._handle_agent_events()
            while any(session.is_pending for session in self._sessions.values()) and not is_interrupted():
                self._wait_for_agent()
            if is_interrupted():
                return

    @property
    def _tick(self) -> int:
        return max(min(stepper.gate.next_tick for stepper in self._steppers.values()) - 1, 0)

    def _step_all(self, is_interrupted: Callable[[], bool], started: float) -> Iterator[None]:
        steppers = list(self._steppers.items())
        while self._tick_is_open() and not is_interrupted():
            self._handle_agent_events()
            self._keep_pace(is_interrupted)
            for name, stepper in steppers:
                may_step = stepper.gate.can_step()
                while not may_step and self._waits_for_agent(stepper) and not is_interrupted():
                    yield
                    self._wait_for_agent()
                    may_step = stepper.gate.can_step()
                if is_interrupted():
                    return
                if may_step:
                    self._culprit = name
                    for sent in stepper.step():
                        self._deliver(sent)
                elif not stepper.gate.is_finished:
                    missing = ", ".join(f"{m.port} at tick {m.tick}" for m in stepper.gate.missing())
                    raise GslCosimError(f"{name} cannot step tick {stepper.gate.next_tick}: it lacks {missing}.")
            self._keeping.write_due_parts(self._steppers.values())
            if self._tick % REPORT_EVERY_TICKS == 0 or self._pace is not None:
                self._report_status(started)

    def _keep_pace(self, is_interrupted: Callable[[], bool]) -> None:
        if self._pace is None:
            return
        tick = self._steppers[PACED_PARTICIPANT].gate.next_tick
        while (wait_s := self._pace.wait_s(tick, time.monotonic())) > 0 and not is_interrupted():
            with suppress(queue.Empty):
                self._handle_event(self._events.get(timeout=min(wait_s, POLL_PERIOD_S)))
        self._pace.begins(tick, time.monotonic())

    def _waits_for_agent(self, stepper: Stepper) -> bool:
        return not stepper.gate.is_finished and any(session.is_pending for session in self._sessions.values())

    def _wait_for_agent(self) -> None:
        self._renew()
        with suppress(queue.Empty):
            self._handle_event(self._events.get(timeout=POLL_PERIOD_S))
        self._renew()
        for session in self._sessions.values():
            self._deliver_all(session.check_deadline())

    # While this process stood still no agent was late.
    def _renew(self) -> None:
        if missed_s := self._pauses.missed_s(time.monotonic()):
            for session in self._sessions.values():
                session.extend_deadlines(missed_s)

    # One round, so that an agent that never stops talking does not stop the run.
    def _handle_agent_events(self) -> None:
        for _ in range(self._events.qsize()):
            self._handle_event(self._events.get())

    def _handle_event(self, event: AgentEvent) -> None:
        self._deliver_all(self._sessions[event.agent].handle(event))

    def _tick_is_open(self) -> bool:
        return not all(stepper.gate.is_finished for stepper in self._steppers.values())

    def _report_status(self, started: float) -> None:
        sim_time_s = seconds_from_ticks(self._tick, self._setup.scenario.tick_ns)
        wall_s = max(time.perf_counter() - started, 1e-9)
        self._report(
            RunStatus(
                state="flying",
                sim_time_s=sim_time_s,
                real_time_factor=sim_time_s / wall_s,
                participants=self._participants,
            )
        )

    # On the caller's thread, while a core may be in its step.
    def _participants(self) -> list[ParticipantStatus]:
        return [*(stepper.look() for stepper in self._steppers.values()), *build_agent_statuses(self._sessions)]

    def _deliver_all(self, sent: Iterable[SentMessage]) -> None:
        for each in sent:
            self._deliver(each)

    def _deliver(self, sent: SentMessage) -> None:
        port, message = sent.port, sent.message
        if self._watch is not None:
            self._watch(port, message)
        for reader in self._readers.get(port, ()):
            reader.gate.deliver(port, message)
        if isinstance(message, Observation):
            self._deliver_all(self._observed_by[port].observe(message, sent.payload))
            # An object has answered by now.
            self._handle_agent_events()
        elif isinstance(message, Briefing):
            self._briefed_by[port].brief(message, sent.payload)
            self._handle_agent_events()
        elif isinstance(message, Verdict):
            self._verdict = message
            for stepper in self._steppers.values():
                stepper.gate.final_tick = message.tick

    def _close(self, outcome: RunOutcome) -> None:
        for name, stepper in self._steppers.items():
            try:
                if isinstance(stepper.core, SupportsClose):
                    stepper.core.close()
            except Exception as error:  # the others must still be closed
                text = format_fault(error, traceback.format_exc())
                fault = ServiceFault(participant=name, tick=self._tick, text=text)
                outcome.fault = outcome.fault or fault
        for session in self._sessions.values():
            session.end(build_ending(self._verdict))

    def _digest(self, final_tick: int) -> RunDigest:
        trails = {port: trail for s in self._steppers.values() for port, trail in s.trails.items()}
        trails |= {keys.command(name): session.trail for name, session in self._sessions.items()}
        return RunDigest.of(trails, self._dataflow.writer_of, final_tick)


def _collect_summaries(cores: Iterable[Core]) -> dict[str, Any]:
    accounts = (core.summary() for core in cores if isinstance(core, SupportsSummary))
    return {key: summary for account in accounts for key, summary in account.items()}


def run_in_process(
    setup: RunSetup,
    directory: Path,
    network: Network,
    report: Callable[[RunStatus], None],
    watch: MessageObserver | None = None,
) -> RunOutcome:
    """Run a scenario in this process: Python agents as objects in it, agents behind the gateway as processes.

    Args:
        setup: The run.
        directory: The scenario's folder, where relative paths of agents start.
        network: Where agents that attach themselves find their join data.
        report: Receives the status of the run.
        watch: Receives every message, for figures of the run; it must change none.

    Raises:
        UsageError: an agent is neither, or cannot be loaded or started.
    """
    events: queue.SimpleQueue[AgentEvent] = queue.SimpleQueue()
    gateway = GatewayAgents(setup, directory, network, events.put)
    agent_types = load_agent_types(setup.scenario, directory, gateway)
    sessions: dict[str, AgentSession] = {}
    workers: dict[str, WorkerThread] = {}
    for agent in setup.scenario.agents:
        is_guest = agent.name in gateway
        link = (
            gateway.get_transport(agent.name)
            if is_guest
            else _build_local_transport(agent, agent_types, workers, events.put)
        )
        sessions[agent.name] = build_session(agent, setup, link)
        sessions[agent.name].is_ready = not is_guest
    with ExitStack() as stack:
        socket_dir = stack.enter_context(ScratchFolder.for_sockets()).path
        interruption = stack.enter_context(Interruption())
        children = stack.enter_context(ChildProcesses(gateway.exited))
        stack.enter_context(StopMonitor(lambda: children.pids, gateway.stopped))
        stack.callback(gateway.close)
        gateway.start(children, socket_dir)
        _await_gateway_agents(gateway, sessions, events, interruption)
        outcome = InProcessRun(setup, sessions, events, report, watch).fly(interruption.is_set)
        children.wait(EXIT_TIMEOUT_S)
    return outcome


# Time does not wait for an agent in free mode, so it decides on a thread of its own.
def _build_local_transport(
    agent: AgentSpec, types: Mapping[str, type[Agent]], workers: dict[str, WorkerThread], put: EventSink
) -> AgentTransport:
    link = ObjectTransport(agent.name, types[agent.process], put)
    return ThreadedTransport(link, workers.setdefault(agent.process, WorkerThread())) if agent.is_free else link


def _await_gateway_agents(
    gateway: GatewayAgents,
    sessions: Mapping[str, AgentSession],
    events: "queue.SimpleQueue[AgentEvent]",
    interruption: Interruption,
) -> None:
    deadline_s, pauses = time.monotonic() + JOIN_TIMEOUT_S, PauseDetector()
    while not interruption.is_set() and (absent := [session for session in sessions.values() if session.is_awaited]):
        deadline_s += pauses.missed_s(time.monotonic())
        if time.monotonic() > deadline_s:
            for session in absent:
                session.mark_lost(gateway.describe_absence(session.agent))
            return
        with suppress(queue.Empty):
            event = events.get(timeout=POLL_PERIOD_S)
            sessions[event.agent].handle(event)
