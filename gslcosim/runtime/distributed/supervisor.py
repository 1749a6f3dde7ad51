"""Supervisor of a distributed run: watches its processes, reports its status, and names the culprit when one fails."""

import queue
import time
from collections.abc import Callable, Sequence
from contextlib import suppress

from typing_extensions import override

from gslcosim.base.errors import ExitCode
from gslcosim.bus.zenoh_bus import ZenohBus
from gslcosim.contract import codec, keys
from gslcosim.contract.messages import Verdict
from gslcosim.contract.participant import get_agent_participant
from gslcosim.runtime.agents.bus_transport import AgentHost, BusTransport
from gslcosim.runtime.agents.gateway_transport import GatewayAgents
from gslcosim.runtime.agents.session import AgentJoined, AgentSessions, build_session
from gslcosim.runtime.digest import HashChain, RunDigest
from gslcosim.runtime.distributed import protocol
from gslcosim.runtime.distributed.protocol import (
    Interrupted,
    LivelinessChanged,
    MessageReceived,
    ProcessEnded,
    ProcessStopped,
    SupervisorEvent,
)
from gslcosim.runtime.distributed.watchdog import LOST_CONTACT_GRACE_S, RestartPolicy, Watchdog
from gslcosim.runtime.loop_host import LoopHost
from gslcosim.runtime.network import describe_absence
from gslcosim.runtime.outcome import ServiceFault
from gslcosim.runtime.participant_status import MissingMessage, ParticipantState, ParticipantStatus
from gslcosim.runtime.processes.fork_server import FORK_SERVER
from gslcosim.runtime.processes.stop_detection import describe_stop
from gslcosim.runtime.services import ServiceGroup, build_dataflow, list_service_names, list_services
from gslcosim.runtime.setup import RunSetup
from gslcosim.runtime.status import RunStatus
from gslcosim.runtime.stepper import SnapshotPolicy
from gslcosim.scenario.models.scenario import AgentSpec

# A participant without an answer by then is silent: it is stopped, or its process has too much to do.
INSPECTION_TIMEOUT_S = 0.5
# A service that has started or ended ignores the next signal.
SIGNAL_PERIOD_S = 1.0


class RunEndedError(Exception):
    """The run is over before its verdict; carries the fault."""

    def __init__(self, fault: ServiceFault) -> None:
        super().__init__(fault.text)
        self.fault = fault


class Supervisor(LoopHost):
    """Supervisor of one run: validates agents' commands, and ends the run with the culprit's name."""

    def __init__(
        self,
        setup: RunSetup,
        bus: ZenohBus,
        gateway: GatewayAgents,
        events: "queue.SimpleQueue[SupervisorEvent]",
        report: Callable[[RunStatus], None],
        groups: Sequence[ServiceGroup],
        restarts: RestartPolicy,
    ) -> None:
        super().__init__(setup, AgentSessions(events), report)
        self._bus = bus
        self._services = list_service_names(setup.scenario)
        self._watchdog = Watchdog(groups, setup.run_dir)
        self._restarts = restarts
        self._bus_links = {
            agent.name: BusTransport(agent.name, bus, events.put)
            for agent in setup.scenario.agents
            if agent.name not in gateway
        }
        self._agent_hosts = {agent.name: self._build_agent_host(agent, gateway) for agent in setup.scenario.agents}
        self._sessions.update({name: host.session for name, host in self._agent_hosts.items()})
        self._handlers = self._build_handlers()
        self._described: set[str] = set()
        self._departed_at_s: dict[str, float] = {}
        # The fault before which all others still have ticks to do.
        self._fault: ServiceFault | None = None
        self._signalled_at_s = self._asked_at_s = 0.0

    def listen(self) -> None:
        """Subscribe to services and agents."""
        bus = self._bus
        for name, host in self._agent_hosts.items():
            bus.subscribe(keys.briefing(name), self._put)
            host.listen()
        for link in self._bus_links.values():
            link.listen()
        # Observations and the verdict come in their writers' bundles.
        for name in ("sensing", "referee"):
            bus.subscribe(protocol.build_outgoing_bundles_key(name), self._put)
        bus.subscribe(protocol.FAULT_KEY, self._put)
        bus.subscribe(protocol.build_progress_key("*"), self._put)
        bus.subscribe(protocol.build_final_report_key("*"), self._put)
        for pattern in (protocol.build_liveliness_key("*"), protocol.build_agent_liveliness_key("*")):
            bus.watch_alive(pattern, lambda key, is_alive: self._sessions.events.put(LivelinessChanged(key, is_alive)))

    # On any thread.
    def _put(self, key: str, payload: bytes) -> None:
        self._sessions.events.put(MessageReceived(key, payload))

    def fly(self, is_interrupted: Callable[[], bool]) -> None:
        """Start simulated time, and watch until all services have sent their last message, or an interruption."""
        if is_interrupted():
            return
        self._started_at_s = time.perf_counter()
        self._watchdog.moved(time.monotonic())
        if self._setup.snapshot is not None:
            # Sensing, which otherwise sends agents on the bus their messages, resumes at the snapshot.
            for link in self._bus_links.values():
                link.is_writer = True
            self._brief_agents()
            self._replay_observations(is_interrupted)
            for link in self._bus_links.values():
                link.is_writer = False
        try:
            while not (self._watchdog.is_finished and not self._list_overdue()) and not is_interrupted():
                self._repeat_signals()
                self._handle_next()
                self._check_time()
                state = "flying" if self._verdict is None else "closing"
                tick = self._watchdog.tick_of("referee")
                self._status_reporter.report_run(state, tick, self.wall_s, self._restarts.text)
        except RunEndedError:
            # The fault remains the cause where the ticks before it cannot be finished.
            self._raise_fault()
            raise
        self._raise_fault()

    # A verdict before the fault ends the run; a later one does not count.
    def _raise_fault(self) -> None:
        if self._fault is not None and (self._verdict is None or self._verdict.tick > self._fault.tick):
            self._verdict = None
            raise RunEndedError(self._fault)

    # A service that missed the start would wait, and one that missed the stop would go on, until the run times out.
    def _repeat_signals(self) -> None:
        now_s = time.monotonic()
        if now_s - self._signalled_at_s < SIGNAL_PERIOD_S:
            return
        self._signalled_at_s = now_s
        if self._watchdog.finished_tick == 0:
            self._bus.publish(protocol.START_KEY, b"", urgent=True)
        self._send_stop()

    def fault(self, text: str) -> ServiceFault:
        """Return a fault of the supervisor's own, at the tick that all services have reached."""
        return ServiceFault(participant="supervisor", tick=self._watchdog.finished_tick, text=text)

    def shut_down(self) -> None:
        """Send agents and services the end of the run."""
        self._end_agents()
        self._bus.publish(protocol.CLOSE_KEY, b"", urgent=True)

    def complete(self) -> None:
        """Add verdict, faults, timing and digest to the outcome."""
        outcome, reports, verdict = self.outcome, self._watchdog.final_reports, self._verdict
        ending = self._fault if self._watchdog.is_finished else None
        outcome.collect(
            self._sessions,
            verdict=verdict,
            reached_tick=ending.tick if ending else self._watchdog.finished_tick,
            timing={name: report.timing for name, report in sorted(reports.items())},
            summaries=(*(report.summary for report in reports.values()), self._restarts.summary),
        )
        if verdict is None or outcome.fault is not None or not self._watchdog.is_finished:
            return
        writer_of = build_dataflow(self._setup.scenario).writer_of
        trails = self._sessions.trails
        for name, report in reports.items():
            written = {port for port, writer in writer_of.items() if writer == name}
            if report.last_tick < verdict.tick or report.trails.keys() != written:
                expected = f"its final report: expected tick {verdict.tick} and chains of {len(written)} ports"
                found = f"was tick {report.last_tick} and {len(report.trails)}, or others."
                outcome.fault = self._watchdog.fault(name, f"{expected}, {found}")
                return
            trails |= {port: HashChain.from_fields(fields) for port, fields in report.trails.items()}
        outcome.digest = RunDigest.of(trails, writer_of, verdict.tick)

    def _build_agent_host(self, agent: AgentSpec, gateway: GatewayAgents) -> AgentHost:
        link = self._bus_links.get(agent.name) or gateway.get_transport(agent.name)
        session = build_session(agent, self._setup, link)
        more_ticks = SnapshotPolicy.of(self._setup).extra_retained_ticks
        return AgentHost(session, self._bus, lambda got: self._put(keys.observation(agent.name), got), more_ticks)

    # In the same words as sensing does when it goes on, which is a repetition.
    def _brief_agents(self) -> None:
        for kind in list_services(self._setup.scenario):
            if kind.build_briefings is not None:
                for agent, briefing in kind.build_briefings(self._setup).items():
                    self._agent_hosts[agent].brief(codec.encode(briefing))

    @override
    def _observe(self, agent: str, payload: bytes) -> None:
        self._agent_hosts[agent].observe(payload)

    # Services are queried only for a client of the status; on any thread.
    @override
    def _look(self) -> list[ParticipantStatus]:
        answers: queue.SimpleQueue[bytes] = queue.SimpleQueue()
        asked = [name for name in self._services if name not in self._watchdog.final_reports]
        for name in asked:
            self._bus.ask(protocol.build_inspection_key(name), b"", lambda _, payload: answers.put(payload))
        came: dict[str, ParticipantStatus] = {}
        deadline_s = time.monotonic() + INSPECTION_TIMEOUT_S
        with suppress(queue.Empty):
            while len(came) < len(asked):
                payload = answers.get(timeout=max(0.0, deadline_s - time.monotonic()))
                inspection = protocol.ParticipantInspection.from_bytes(payload)
                came[inspection.name] = ParticipantStatus(**dict(inspection))
        services = [came.get(name) or self._describe_silent(name) for name in self._services]
        return services + self._sessions.look()

    # A service is silent only where it answers neither of two questions.
    def _look_twice(self) -> list[ParticipantStatus]:
        first = self._look()
        if not any(participant.state == "silent" for participant in first):
            return first
        return [then if now.state == "silent" else now for then, now in zip(first, self._look(), strict=True)]

    def _describe_silent(self, name: str) -> ParticipantStatus:
        state: ParticipantState = "done" if name in self._watchdog.final_reports else "silent"
        return ParticipantStatus(name=name, state=state, tick=self._watchdog.tick_of(name))

    # ------------------------------------------------------------ events

    @override
    def _handle(self, event: SupervisorEvent) -> None:
        match event:
            case MessageReceived(key, payload):
                self._on_message(key, payload)
            case LivelinessChanged(key, is_alive):
                self._on_liveliness(key, is_alive=is_alive)
            case ProcessEnded(name, how, is_by_itself):
                if is_by_itself and self._watchdog.watches_process(name):
                    self._take_last_messages()
                self._on_end_of(name, how)
            case ProcessStopped(name) if not self._restarts.covers(name):
                self._on_end_of(name, describe_stop())
            case Interrupted() | ProcessStopped():
                return
            case _:
                super()._handle(event)

    # A service that ends by itself reports the reason, but its end may be detected before the report has come.
    def _take_last_messages(self) -> None:
        deadline_s = time.monotonic() + LOST_CONTACT_GRACE_S
        while (left_s := deadline_s - time.monotonic()) > 0:
            with suppress(queue.Empty):
                self._handle(self._sessions.events.get(timeout=left_s))

    # A name that is none of the run's comes from a hostile host; it has no handler.
    def _on_message(self, key: str, payload: bytes) -> None:
        if key.startswith(protocol.BUNDLE_PREFIX):
            for port, message in protocol.unpack_bundle(payload):
                if handler := self._handlers.get(port):
                    handler(message)
        elif handler := self._handlers.get(key):
            handler(payload)

    def _build_handlers(self) -> dict[str, Callable[[bytes], None]]:
        handlers: dict[str, Callable[[bytes], None]] = {
            keys.VERDICT: self._on_verdict,
            protocol.FAULT_KEY: self._on_fault,
        }
        for name, host in self._agent_hosts.items():
            handlers[keys.briefing(name)] = host.brief
            handlers[keys.observation(name)] = host.observe
        for name in self._services:
            handlers[protocol.build_progress_key(name)] = lambda payload, name=name: self._watchdog.record_progress(
                name, protocol.TickReport.from_bytes(payload), time.monotonic()
            )
            handlers[protocol.build_final_report_key(name)] = self._on_final_report
            handlers[protocol.build_description_key(name)] = self._on_description
        return handlers

    def _on_fault(self, payload: bytes) -> None:
        report = protocol.FaultReport.from_bytes(payload)
        if self._restarts.absorbs_fault(report):
            return
        fault = ServiceFault(participant=report.participant, tick=report.tick, text=report.text.strip())
        if not self.has_begun:
            raise RunEndedError(fault)
        if self._fault is None or (fault.tick, fault.participant) < (self._fault.tick, self._fault.participant):
            self._fault = fault
            self._send_stop()

    def _on_liveliness(self, key: str, *, is_alive: bool) -> None:
        name = key.split("/")[1]
        if key == protocol.build_agent_liveliness_key(name):
            if name not in self._bus_links:
                return
            if is_alive:
                self._sessions[name].handle(AgentJoined(agent=name))
            else:
                # The end of its process, which explains more, may come within a moment.
                self._departed_at_s.setdefault(name, time.monotonic())
        elif name not in self._watchdog:
            return
        elif is_alive:
            self._watchdog.record_contact_regained(name)
            self._ask_for_description(name)
        elif not self._restarts.is_under_way(name):
            self._watchdog.record_contact_lost(name, time.monotonic())

    def _ask_for_description(self, name: str) -> None:
        question = protocol.build_description_key(name)
        self._bus.ask(question, b"", lambda _, answer: self._put(question, answer))

    def _on_description(self, payload: bytes) -> None:
        description = protocol.ParticipantDescription.from_bytes(payload)
        if text := description.difference:
            raise RunEndedError(self._watchdog.fault(description.name, text))
        self._described.add(description.name)
        if self._restarts.mark_reconnected(description.name):
            self._bus.publish(protocol.START_KEY, b"", urgent=True)
            self._send_stop()

    def _on_verdict(self, payload: bytes) -> None:
        self._verdict = codec.decode_trusted(Verdict, payload)
        self._send_stop()

    def _send_stop(self) -> None:
        if ends := [end.tick for end in (self._verdict, self._fault) if end is not None]:
            self._bus.publish(protocol.STOP_KEY, protocol.TickReport(tick=min(ends)).to_bytes(), urgent=True)

    def _on_final_report(self, payload: bytes) -> None:
        report = protocol.FinalReport.from_bytes(payload)
        self._watchdog.record_final_report(report, time.monotonic())
        # The report is repeated until the end of the run, and the question with it.
        for overdue in self._list_overdue():
            if overdue.writer == report.name:
                question = protocol.ResendRequest(port=overdue.port, tick=overdue.tick).to_bytes()
                self._bus.ask(
                    protocol.build_resend_key(report.name),
                    question,
                    lambda _, answer, port=overdue.port: self._put(port, answer),
                )

    # Messages that finished services have written and that have not come: each subscription has a thread of its own, so
    # that a final report may overtake them.
    def _list_overdue(self) -> list[MissingMessage]:
        reports, verdict = self._watchdog.final_reports, self._verdict
        if verdict is None:
            ticks = [reports["referee"].last_tick] if "referee" in reports else []
            # Before a fault it ends without one.
            ticks = [tick for tick in ticks if self._fault is None or tick < self._fault.tick]
            return [MissingMessage(port=keys.VERDICT, tick=tick, writer="referee", last_tick=-1) for tick in ticks]
        last_ticks = {name: session.last_tick for name, session in self._sessions.items()}
        return [
            MissingMessage(port=keys.observation(name), tick=tick + 1, writer="sensing", last_tick=tick)
            for name, tick in last_ticks.items()
            if "sensing" in reports and tick < verdict.tick
        ]

    def _on_end_of(self, name: str, how: str) -> None:
        if name == FORK_SERVER:
            text = f"{how}; the services are its forks and end with it."
            raise RunEndedError(ServiceFault(participant=name, tick=self._watchdog.finished_tick, text=text))
        if self._watchdog.watches_process(name):
            if self._watchdog.is_restarted(name, time.monotonic(), lambda at: self._restarts.begin(name, how, at)):
                return
            raise RunEndedError(self._watchdog.fault(name, self._restarts.reason(name, how)))
        for agent in self._setup.scenario.agents:
            if get_agent_participant(agent.process) == name:
                reason = f"the agent's process {how} before the end of the run."
                self._sessions[agent.name].mark_lost(reason)

    # ------------------------------------------------------------ time

    @override
    def _list_awaited(self) -> list[str]:
        return [name for name in self._services if name not in self._described] + super()._list_awaited()

    @override
    def _give_up(self, name: str) -> None:
        if name not in self._sessions:
            raise RunEndedError(self._watchdog.fault(name, describe_absence(), ExitCode.TIMEOUT))
        super()._give_up(name)

    @override
    def _check_joining(self) -> None:
        now_s = time.monotonic()
        if (fault := self._watchdog.find_lost(now_s)) is not None:
            raise RunEndedError(fault)
        # A service whose answer was lost would be waited for until the run times out.
        if now_s - self._asked_at_s >= SIGNAL_PERIOD_S:
            self._asked_at_s = now_s
            for name in self._services:
                if name not in self._described:
                    self._ask_for_description(name)

    @override
    def _renew_deadlines(self) -> float:
        missed_s = super()._renew_deadlines()
        if missed_s > 0:
            self._watchdog.extend_deadlines(missed_s, time.monotonic())
        return missed_s

    @override
    def _check_time(self) -> None:
        super()._check_time()
        now_s = time.monotonic()
        for name, since_s in list(self._departed_at_s.items()):
            if now_s - since_s > LOST_CONTACT_GRACE_S:
                del self._departed_at_s[name]
                self._sessions[name].mark_lost(f"the agent left the run before its end.{self._watchdog.pause_text}")
        if self._sessions.are_pending:
            # An agent that owes an answer is not a stall of the run; it has its own deadline.
            self._watchdog.moved(now_s)
        is_judged, overdue = self._verdict is not None or self._fault is not None, self._list_overdue()
        fault = self._watchdog.check(now_s, is_judged=is_judged, look=self._look_twice, overdue=overdue)
        if fault is not None:
            raise RunEndedError(fault)
