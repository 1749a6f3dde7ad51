"""A run as independent processes: starts them around a router, watches them, and names the culprit when one fails."""

import queue
import time
from collections.abc import Callable, Sequence
from itertools import takewhile

from gslcosim.bus.zenoh_bus import ZenohBus
from gslcosim.contract import codec, keys
from gslcosim.contract.messages import Verdict
from gslcosim.errors import ExitCode
from gslcosim.interruption import Interruption
from gslcosim.runtime.agents.bus_link import BusLink
from gslcosim.runtime.agents.desk import desk_of
from gslcosim.runtime.agents.door import door_name
from gslcosim.runtime.agents.events import AgentGone, AgentJoined
from gslcosim.runtime.agents.guests import Guests, absence_text
from gslcosim.runtime.assembly import dataflow_of, service_names
from gslcosim.runtime.grouping import Group
from gslcosim.runtime.joining import JOIN_LIMIT_S
from gslcosim.runtime.outcome import Outcome, ServiceFault, ending_of
from gslcosim.runtime.over_bus import control
from gslcosim.runtime.over_bus.bringing_in import bring_in
from gslcosim.runtime.over_bus.door_host import DoorHost
from gslcosim.runtime.over_bus.forks import FORK_SERVER
from gslcosim.runtime.over_bus.inspecting import Inspector
from gslcosim.runtime.over_bus.notices import (
    AgentVanished,
    BriefingCame,
    BundleCame,
    ByeSaid,
    FaultTold,
    Interrupted,
    Notice,
    ObservationCame,
    ProcessEnded,
    ProcessStopped,
    ProgressTold,
    ServiceAppeared,
    ServiceDescribed,
    ServiceVanished,
    VerdictCame,
    WaitingTold,
)
from gslcosim.runtime.over_bus.past_telling import tell_past
from gslcosim.runtime.over_bus.restarts import Restarts
from gslcosim.runtime.over_bus.telling import Teller
from gslcosim.runtime.over_bus.watchdog import LOST_CONTACT_GRACE_S, Watchdog
from gslcosim.runtime.pauses import Pauses
from gslcosim.runtime.setup import Setup
from gslcosim.runtime.snapshots.taking import Keeping
from gslcosim.runtime.status import FlightStatus
from gslcosim.runtime.stops import stop_text

LOOK_EVERY_S = 0.1
# Between two looks at the clock, however many messages an agent sends.
MAX_NOTICES_AT_ONCE = 256


class RunEndedError(Exception):
    """The run is over before its verdict; carries the fault."""

    def __init__(self, fault: ServiceFault) -> None:
        super().__init__(fault.text)
        self.fault = fault


class Supervisor:
    """Watches one run: lets agents' commands pass at their doors, and ends the run with the culprit's name.

    What it hears comes as notices from many threads and is handled on the one that calls `fly`.
    """

    def __init__(
        self,
        setup: Setup,
        bus: ZenohBus,
        guests: Guests,
        notices: "queue.SimpleQueue[Notice]",
        report: Callable[[FlightStatus], None],
        groups: Sequence[Group],
        restarts: Restarts,
    ) -> None:
        self._setup = setup
        self._bus = bus
        self._guests = guests
        self._notices = notices
        self._dataflow = dataflow_of(setup.scenario)
        self._services = service_names(setup.scenario)
        self._watchdog = Watchdog(groups, setup.run_dir)
        self._restarts = restarts
        self._bus_links = {
            agent.name: BusLink(agent.name, bus, notices.put)
            for agent in setup.scenario.agents
            if agent.name not in guests
        }
        self._doors = {agent.name: self._door_host(agent.name) for agent in setup.scenario.agents}
        desks = {name: door.desk for name, door in self._doors.items()}
        inspector = Inspector(bus, self._services, self._watchdog, desks)
        self._teller = Teller(report, setup.scenario.tick_ns, inspector.look)
        self._observed_by = {keys.observation(name): door for name, door in self._doors.items()}
        self._described: set[str] = set()
        self._departed_at_s: dict[str, float] = {}
        self._verdict: Verdict | None = None
        self._pauses = Pauses()
        self._started_at_s: float | None = None
        self._ended_at_s: float | None = None

    @property
    def has_begun(self) -> bool:
        """Whether simulated time has begun."""
        return self._started_at_s is not None

    def listen(self) -> None:
        """Hear services and agents from now on."""
        bus, put = self._bus, self._notices.put
        for name, door in self._doors.items():
            bus.subscribe(keys.briefing(name), lambda _, payload, name=name: put(BriefingCame(name, payload)))
            door.listen()
        for link in self._bus_links.values():
            link.listen()
        for name in ("sensing", "referee"):
            bus.subscribe(control.bundles_of(name), lambda _, payload: put(BundleCame(payload)))
        bus.subscribe(control.FAULT, lambda _, payload: put(FaultTold("", payload)))
        for key, notice in (
            (control.progress("*"), ProgressTold),
            (control.waiting("*"), WaitingTold),
            (control.bye("*"), ByeSaid),
        ):
            bus.subscribe(key, lambda at, payload, notice=notice: put(notice(at.rsplit("/", 1)[-1], payload)))
        bus.watch_alive(control.alive("*"), self._on_service_alive)
        bus.watch_alive("agents/*/alive", self._on_agent_alive)

    def await_all_ready(self, interruption: Interruption) -> None:
        """Wait until all services and agents are there, or interruption.

        Raises:
            RunEndedError: a service has not come in time, or has failed.
        """
        began_s = time.monotonic()
        while lacking := self._not_ready():
            if interruption.is_set():
                return
            began_s += self._renew()
            waited_s = time.monotonic() - began_s
            if waited_s > JOIN_LIMIT_S:
                self._give_up_on(lacking)
            self._teller.tell_awaited(lacking, waited_s)
            self._handle_next()

    def fly(self, interruption: Interruption) -> None:
        """Let simulated time begin, and watch until all services are done, or interruption.

        Raises:
            RunEndedError: a service has failed, or nothing moves any more.
        """
        if interruption.is_set():
            return
        self._started_at_s = time.perf_counter()
        self._watchdog.moved(time.monotonic())
        for _ in takewhile(lambda _: not interruption.is_set(), tell_past(self._setup, self._doors, self._bus_links)):
            self._handle_next()
            self._check_time()
        self._bus.publish(control.START, b"", urgent=True)
        while not self._watchdog.are_done and not interruption.is_set():
            self._handle_next()
            self._check_time()
            self._tell_flight()

    def fault(self, text: str) -> ServiceFault:
        """Return a fault of the supervisor's own, at the tick that all services have reached."""
        return ServiceFault(participant="supervisor", tick=self._watchdog.finished_tick, text=text)

    def dismiss(self) -> None:
        """Tell agents and services that the run is over."""
        self._ended_at_s = time.perf_counter()
        for door in self._doors.values():
            door.desk.end(ending_of(self._verdict))
        self._bus.publish(control.CLOSE, b"", urgent=True)

    def complete(self, outcome: Outcome) -> None:
        """Add to the outcome what the run has brought in."""
        if self._started_at_s is not None and self._ended_at_s is not None:
            outcome.flight_wall_s = self._ended_at_s - self._started_at_s
        bring_in(outcome, self._watchdog, self._doors, self._verdict, self._dataflow, self._restarts)

    def _door_host(self, name: str) -> DoorHost:
        agent = next(agent for agent in self._setup.scenario.agents if agent.name == name)
        link = self._bus_links.get(name) or self._guests.link_of(name)
        put = self._notices.put
        desk, more_ticks = desk_of(agent, self._setup, link), Keeping.of(self._setup).more_ticks
        return DoorHost(desk, self._bus, lambda got: put(ObservationCame(name, got)), more_ticks)

    # ------------------------------------------------------------ what it hears

    def _on_service_alive(self, key: str, is_alive: bool) -> None:  # noqa: FBT001 - the interface of the bus
        name = key.split("/")[1]
        if name in self._watchdog:
            self._notices.put(ServiceAppeared(name) if is_alive else ServiceVanished(name))

    def _on_agent_alive(self, key: str, is_alive: bool) -> None:  # noqa: FBT001 - as above
        name = key.split("/")[1]
        if name in self._bus_links:
            self._notices.put(AgentJoined(agent=name) if is_alive else AgentVanished(name))

    def _handle_next(self) -> None:
        try:
            self._handle(self._notices.get(timeout=LOOK_EVERY_S))
        except queue.Empty:
            return
        for _ in range(MAX_NOTICES_AT_ONCE):
            if self._notices.empty():
                return
            self._handle(self._notices.get())

    def _handle(self, notice: Notice) -> None:
        match notice:
            case BundleCame(payload):
                self._on_bundle(payload)
            case ProgressTold(name, payload):
                self._watchdog.progressed(name, control.TickNote.from_bytes(payload), time.monotonic())
            case WaitingTold(name, payload):
                self._watchdog.waits(name, control.WaitingNote.from_bytes(payload))
            case ByeSaid(_, payload):
                self._on_bye(control.Bye.from_bytes(payload))
            case VerdictCame(payload):
                self._on_verdict(payload)
            case BriefingCame(agent, payload):
                self._doors[agent].brief(payload)
            case ObservationCame(agent, payload):
                self._doors[agent].observe(payload)
            case FaultTold() | ServiceAppeared() | ServiceDescribed() | ServiceVanished():
                self._on_life(notice)
            case ProcessEnded(name, _, how):
                self._on_end_of(name, how)
            case ProcessStopped(name) if not self._restarts.covers(name):
                self._on_end_of(name, stop_text())
            case AgentVanished(agent):
                # Its process may have ended too; that says more, and comes within a moment.
                self._departed_at_s.setdefault(agent, time.monotonic())
            case Interrupted() | ProcessStopped():
                return
            case _:
                self._doors[notice.agent].handle(notice)

    def _on_life(self, notice: FaultTold | ServiceAppeared | ServiceDescribed | ServiceVanished) -> None:
        match notice:
            case FaultTold(payload=payload):
                note = control.FaultNote.from_bytes(payload)
                if self._restarts.takes_fault(note):
                    return
                raise RunEndedError(ServiceFault(participant=note.participant, tick=note.tick, text=note.text.strip()))
            case ServiceAppeared(name):
                put = self._notices.put
                self._watchdog.regained_contact(name)
                self._bus.ask(control.describe(name), b"", lambda _, answer: put(ServiceDescribed(answer)))
            case ServiceDescribed(payload):
                self._on_described(control.Description.from_bytes(payload))
            case ServiceVanished(name):
                if not self._restarts.is_under_way(name):
                    self._watchdog.lost_contact(name, time.monotonic())

    def _on_described(self, description: control.Description) -> None:
        if text := description.difference:
            raise RunEndedError(self._watchdog.fault(description.name, text))
        self._described.add(description.name)
        if self._restarts.has_come(description.name):
            self._bus.publish(control.START, b"", urgent=True)
            self._tell_stop()

    def _on_bundle(self, payload: bytes) -> None:
        for port, message in control.unpack_bundle(payload):
            door = self._observed_by.get(port)
            if door is not None:
                door.observe(message)
            elif port == keys.VERDICT:
                self._on_verdict(message)

    def _on_verdict(self, payload: bytes) -> None:
        self._verdict = codec.decode_trusted(Verdict, payload)
        self._tell_stop()

    def _tell_stop(self) -> None:
        if self._verdict is not None:
            self._bus.publish(control.STOP, control.TickNote(tick=self._verdict.tick).to_bytes(), urgent=True)

    def _on_bye(self, bye: control.Bye) -> None:
        self._watchdog.said_goodbye(bye, time.monotonic())
        if bye.name == "referee" and self._verdict is None:
            # It has ended the run, so its verdict got lost on the way.
            question = control.ResendRequest(port=keys.VERDICT, tick=bye.last_tick).to_bytes()
            put = self._notices.put
            self._bus.ask(control.resend("referee"), question, lambda _, payload: put(VerdictCame(payload)))

    def _on_end_of(self, name: str, how: str) -> None:
        if name == FORK_SERVER:
            text = f"{how}; the services are its forks and end with it."
            raise RunEndedError(ServiceFault(participant=name, tick=self._watchdog.finished_tick, text=text))
        if self._watchdog.watches_process(name):
            if self._watchdog.is_restarted(name, time.monotonic(), lambda at: self._restarts.begin(name, how, at)):
                return
            raise RunEndedError(self._watchdog.fault(name, self._restarts.reason(name, how)))
        for agent in self._setup.scenario.agents:
            if door_name(agent.process) == name:
                reason = f"the agent's process {how} before the end of the run."
                self._doors[agent.name].handle(AgentGone(agent=agent.name, reason=reason))

    # ------------------------------------------------------------ time

    def _not_ready(self) -> list[str]:
        services = [name for name in self._services if name not in self._described]
        return services + [name for name, door in self._doors.items() if door.desk.is_awaited]

    def _give_up_on(self, lacking: list[str]) -> None:
        for name in lacking:
            if name not in self._doors:
                raise RunEndedError(self._watchdog.fault(name, absence_text(), ExitCode.TIMEOUT))
            self._doors[name].lose(self._guests.absence_text(name))

    # While this process stood still nobody was late.
    def _renew(self) -> float:
        now_s = time.monotonic()
        missed_s = self._pauses.missed_s(now_s)
        if missed_s > 0:
            self._watchdog.postpone(missed_s, now_s)
            # An agent's deadlines are those of its desk; one that has left has left.
            for door in self._doors.values():
                door.desk.postpone(missed_s)
        return missed_s

    def _check_time(self) -> None:
        self._renew()
        now_s = time.monotonic()
        for name, since_s in list(self._departed_at_s.items()):
            if now_s - since_s > LOST_CONTACT_GRACE_S:
                del self._departed_at_s[name]
                self._doors[name].lose(f"the agent left the run before its end.{self._watchdog.pause_text}")
        for door in self._doors.values():
            if door.desk.owes_answer:
                # An agent that owes an answer is not a stall of the run; it has its own deadline.
                self._watchdog.moved(now_s)
                door.check_time()
        fault = self._watchdog.check(now_s, is_judged=self._verdict is not None)
        if fault is not None:
            raise RunEndedError(fault)

    def _tell_flight(self) -> None:
        wall_s = time.perf_counter() - self._started_at_s if self._started_at_s is not None else 0.0
        state = "flying" if self._verdict is None else "closing"
        self._teller.tell_flight(state, self._watchdog.tick_of("referee"), wall_s, self._restarts.text)
