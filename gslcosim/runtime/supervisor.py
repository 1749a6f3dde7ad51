"""A run as independent processes: starts them around a router, watches them, and names the culprit when one fails."""

import queue
import shutil
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path

from gslcosim.bus.port import Join
from gslcosim.bus.zenoh_bus import SERVICE_USER, AgentUser, ZenohBus, new_password
from gslcosim.contract import codec, keys
from gslcosim.contract.messages import Command, Ending, Observation, Verdict
from gslcosim.contract.schema import contract_hash
from gslcosim.errors import ExitCode
from gslcosim.runtime import control
from gslcosim.runtime.agents.door import MAX_COMMAND_BYTES, door_name, door_of, faults_of
from gslcosim.runtime.agents.guests import COMMAND, GONE, READY, REFUSED, Guests
from gslcosim.runtime.agents.inlet import CommandQueue
from gslcosim.runtime.agents.seat import Seat
from gslcosim.runtime.agents.starting import start_command
from gslcosim.runtime.assembly import dataflow_of, service_names
from gslcosim.runtime.digest import RunDigest, Trail
from gslcosim.runtime.host import PROGRESS_EVERY_TICKS
from gslcosim.runtime.interruption import Interruption
from gslcosim.runtime.joining import JOIN_LIMIT_S, Network
from gslcosim.runtime.outcome import Outcome, ServiceFault, ending_of
from gslcosim.runtime.privacy import keep_memory_private
from gslcosim.runtime.processes import EXIT_LIMIT_S, Children, exit_text, python_command
from gslcosim.runtime.setup import Setup
from gslcosim.runtime.status import FlightStatus
from gslcosim.runtime.stepper import Sent
from gslcosim.ticks import seconds_from_ticks

STALL_LIMIT_S = 30.0
GOODBYE_LIMIT_S = 120.0
REPEAT_AFTER_S = 1.0
LOST_CONTACT_GRACE_S = 0.3
STATUS_EVERY_S = 0.1
# Between two looks at the clock, however many messages an agent sends.
MAX_EVENTS_AT_ONCE = 256
_Event = tuple[str, str, bytes]


class _EndedError(Exception):
    """The flight is over before its verdict; carries the fault."""

    def __init__(self, fault: ServiceFault) -> None:
        super().__init__(fault.text)
        self.fault = fault


class Supervisor:
    """Flies one scenario as separate processes."""

    def __init__(self, setup: Setup, directory: Path, network: Network, report: Callable[[FlightStatus], None]) -> None:
        self._setup = setup
        self._directory = directory
        self._network = network
        self._report = report
        self._dataflow = dataflow_of(setup.scenario)
        self._services = service_names(setup.scenario)
        self._events: queue.SimpleQueue[_Event] = queue.SimpleQueue()
        self._seats = {
            agent.name: Seat(agent, door_of(agent, setup.scenario), CommandQueue(agent.name, self._put_event))
            for agent in setup.scenario.agents
        }
        # Who flies whom: a process has the name of the agent that it was started for.
        self._crews = setup.scenario.agents_by_process()
        self._observed_by = {keys.observation(name): seat for name, seat in self._seats.items()}
        self._guests = Guests(setup, directory, network, self._put_event)
        self._ready: set[str] = set()
        self._described: set[str] = set()
        self._progress: dict[str, int] = dict.fromkeys(self._services, -1)
        self._waiting: dict[str, control.WaitingNote] = {}
        self._byes: dict[str, control.Bye] = {}
        self._verdict: Verdict | None = None
        self._moved_at = time.monotonic()
        self._told_at = 0.0
        self._started_at = 0.0
        self._suspects: dict[str, float] = {}
        self._departed: dict[str, float] = {}
        self._is_dismissing = False

    def fly(self) -> Outcome:
        """Fly until the verdict, a fault or an interruption; no process is left when this returns."""
        keep_memory_private()
        outcome = Outcome()
        began = time.perf_counter()
        socket_dir = Path(tempfile.mkdtemp(prefix="gslcosim-"))
        try:
            with (
                Interruption(lambda: self._events.put(("interrupted", "", b""))) as interruption,
                Children(self._on_child_exit) as children,
                self._open_router(socket_dir) as bus,
            ):
                try:
                    self._listen(bus)
                    self._start_all(children)
                    self._guests.start(children, socket_dir)
                    self._await_all_ready(bus, interruption)
                    outcome.start_up_s = time.perf_counter() - began
                    self._fly(bus, interruption)
                except _EndedError as ended:
                    outcome.fault = ended.fault
                outcome.is_interrupted = interruption.is_set() and outcome.fault is None
                outcome.flight_wall_s = time.perf_counter() - self._started_at if self._started_at else 0.0
                self._dismiss(bus, children)
        finally:
            self._guests.close()
            shutil.rmtree(socket_dir, ignore_errors=True)
        self._complete(outcome)
        return outcome

    def _put_event(self, kind: str, name: str, payload: bytes) -> None:
        self._events.put((kind, name, payload))

    # ------------------------------------------------------------ start

    def _open_router(self, socket_dir: Path) -> ZenohBus:
        self._endpoint = f"unixsock-stream/{socket_dir}/router.sock"
        self._namespace = f"gsl/{self._setup.run_dir.run_id}"
        self._service_password = new_password()
        self._accounts = {
            process: AgentUser(
                agent=process, password=new_password(), others=tuple(name for name in agents if name != process)
            )
            for process, agents in self._crews.items()
            if process not in self._guests
        }
        return ZenohBus.open_router(
            endpoints=[self._endpoint, *self._network.listen],
            namespace=self._namespace,
            service_password=self._service_password,
            agents=self._accounts.values(),
            secrets_dir=socket_dir,
            tls=self._network.tls,
        )

    def _listen(self, bus: ZenohBus) -> None:
        def put(kind: str) -> Callable[[str, bytes], None]:
            return lambda key, payload: self._events.put((kind, key.rsplit("/", 1)[-1], payload))

        def put_agent(kind: str) -> Callable[[str, bytes], None]:
            return lambda key, payload: self._events.put((kind, key.split("/")[1], payload))

        for name, seat in self._seats.items():
            bus.subscribe(keys.briefing(name), put_agent("briefing"))
            inlet = seat.inlet
            bus.subscribe(
                keys.raw_command(name), inlet.on_command, max_bytes=MAX_COMMAND_BYTES, on_longer=inlet.on_longer
            )
            bus.answer(control.resend(door_name(name)), seat.kept.answer)
        for name in ("sensing", "referee"):
            bus.subscribe(control.bundle(name), put("bundle"))
        bus.subscribe(control.FAULT, put("fault"))
        for kind in ("progress", "waiting", "bye"):
            bus.subscribe(f"ctl/{kind}/*", put(kind))
        bus.watch_alive("alive/*", self._on_alive("service"))
        bus.watch_alive("agents/*/alive", self._on_alive("agent"))

    def _on_alive(self, kind: str) -> Callable[[str, bool], None]:
        def on_alive(key: str, is_alive: bool) -> None:  # noqa: FBT001 - the interface of the bus
            self._events.put((f"{kind} {'appeared' if is_alive else 'vanished'}", key.split("/")[1], b""))

        return on_alive

    def _start_all(self, children: Children) -> None:
        run_dir = self._setup.run_dir
        for name in self._services:
            join = self._join(name, SERVICE_USER, self._service_password, run_dir=str(run_dir.path.resolve()))
            if self._network.starts_services:
                command = python_command("-m", "gslcosim_services", name)
                children.start(name, command, join=join, log=run_dir.log(name))
            else:
                self._network.write_join("services", join, run_dir.path)
        for process, account in self._accounts.items():
            join = self._join(process, account.user, account.password, agents=self._crews[process])
            command = start_command(self._seats[process].spec, self._directory)
            if command is None:
                self._network.write_join("agents", join, run_dir.path)
            else:
                log = run_dir.log(door_name(process))
                children.start(door_name(process), command, join=join, log=log, cwd=self._directory)

    def _join(
        self, name: str, user: str, password: str, *, run_dir: str | None = None, agents: tuple[str, ...] = ()
    ) -> Join:
        return Join(
            name=name,
            endpoint=self._endpoint,
            namespace=self._namespace,
            user=user,
            password=password,
            run_dir=run_dir,
            agents=agents if len(agents) > 1 else None,
        )

    def _await_all_ready(self, bus: ZenohBus, interruption: Interruption) -> None:
        deadline = time.monotonic() + JOIN_LIMIT_S
        while lacking := self._not_ready():
            if interruption.is_set():
                return
            if time.monotonic() > deadline:
                self._give_up_on(bus, lacking)
            self._tell(f"waiting for {', '.join(lacking)}", "starting")
            self._handle_next(bus)

    def _give_up_on(self, bus: ZenohBus, lacking: list[str]) -> None:
        for name in lacking:
            text = self._guests.absence_text(name)
            if name not in self._seats:
                raise _EndedError(self._fault(name, text, ExitCode.TIMEOUT))
            self._lose(bus, self._seats[name], text)

    def _not_ready(self) -> list[str]:
        services = [name for name in self._services if name not in self._described]
        return services + [name for name, seat in self._seats.items() if not (seat.is_ready or seat.door.faults)]

    # ------------------------------------------------------------ flight

    def _fly(self, bus: ZenohBus, interruption: Interruption) -> None:
        if interruption.is_set():
            return
        self._started_at = time.perf_counter()
        self._moved_at = time.monotonic()
        bus.publish(control.START, b"", urgent=True)
        while len(self._byes) < len(self._services) and not interruption.is_set():
            self._handle_next(bus)
            self._check_time(bus)
            self._tell("", "flying" if self._verdict is None else "closing")

    def _handle_next(self, bus: ZenohBus) -> None:
        try:
            kind, name, payload = self._events.get(timeout=0.1)
        except queue.Empty:
            return
        self._handle(bus, kind, name, payload)
        for _ in range(MAX_EVENTS_AT_ONCE):
            if self._events.empty():
                return
            self._handle(bus, *self._events.get())

    def _handle(self, bus: ZenohBus, kind: str, name: str, payload: bytes) -> None:
        if kind == "bundle":
            self._on_bundle(bus, payload)
        elif kind == "command":
            self._pass(bus, self._seats[name], self._seats[name].door.received(payload))
            self._seats[name].inlet.handled(payload)
        elif kind == "command refused":
            self._pass(bus, self._seats[name], self._seats[name].door.refused(payload.decode()))
        elif kind == "progress":
            self._on_progress(name, payload)
        elif kind == "waiting":
            self._waiting[name] = control.WaitingNote.from_bytes(payload)
        elif kind == "bye":
            self._on_bye(bus, control.Bye.from_bytes(payload))
        elif kind == "verdict":
            self._on_verdict(bus, payload)
        elif kind == "briefing":
            self._seats[name].briefing = payload
            if name in self._guests:
                self._guests.brief(name, payload)
        elif kind == "observation":
            self._on_observation(bus, self._seats[name], payload)
        elif kind.startswith("guest"):
            self._handle_guest(bus, kind, self._seats[name], payload)
        else:
            self._handle_life(bus, kind, name, payload)

    def _handle_guest(self, bus: ZenohBus, kind: str, seat: Seat, payload: bytes) -> None:
        if kind == READY:
            seat.is_ready = True
        elif kind == GONE and not self._is_dismissing:
            self._lose(bus, seat, payload.decode())
        elif kind == COMMAND:
            self._pass(bus, seat, seat.door.received(payload))
            self._guests.handled(seat.spec.name)
        elif kind == REFUSED:
            self._pass(bus, seat, seat.door.refused(payload.decode()))
            self._guests.handled(seat.spec.name)

    def _handle_life(self, bus: ZenohBus, kind: str, name: str, payload: bytes) -> None:
        if kind == "service appeared" and name in self._progress:
            self._ready.add(name)
            bus.ask(control.describe(name), b"", lambda _, answer: self._events.put(("described", name, answer)))
        elif kind == "described":
            self._on_described(control.Description.from_bytes(payload))
        elif kind == "agent appeared" and name in self._seats:
            self._seats[name].is_ready = True
        elif kind == "fault":
            note = control.FaultNote.from_bytes(payload)
            raise _EndedError(ServiceFault(participant=note.participant, tick=note.tick, text=note.text.strip()))
        elif kind == "exit":
            self._on_exit(bus, name, int(payload))
        elif kind.endswith("vanished"):
            self._on_vanished(kind.split()[0], name)

    def _on_described(self, description: control.Description) -> None:
        if description.contract_hash != contract_hash():
            text = (
                f"expected contract {contract_hash()}, was {description.contract_hash} "
                f"(gslcosim {description.version} on {description.host}). Install the same version everywhere."
            )
            raise _EndedError(self._fault(description.name, text))
        self._described.add(description.name)

    def _on_progress(self, name: str, payload: bytes) -> None:
        tick = control.TickNote.from_bytes(payload).tick
        if tick > self._progress.get(name, tick):
            self._progress[name] = tick
            self._moved_at = time.monotonic()
            self._waiting.pop(name, None)

    def _on_bundle(self, bus: ZenohBus, payload: bytes) -> None:
        for port, message in control.unpack_bundle(payload):
            seat = self._observed_by.get(port)
            if seat is not None:
                self._on_observation(bus, seat, message)
            elif port == keys.VERDICT:
                self._on_verdict(bus, message)

    def _on_verdict(self, bus: ZenohBus, payload: bytes) -> None:
        self._verdict = codec.decode(Verdict, payload)
        bus.publish(control.STOP, control.TickNote(tick=self._verdict.tick).to_bytes(), urgent=True)

    def _on_bye(self, bus: ZenohBus, bye: control.Bye) -> None:
        if bye.name not in self._byes:
            self._byes[bye.name] = bye
            self._moved_at = time.monotonic()
        if bye.name == "referee" and self._verdict is None:
            # It has ended the run, so its verdict got lost on the way.
            question = control.ResendRequest(port=keys.VERDICT, tick=bye.last_tick).to_bytes()
            bus.ask(control.resend("referee"), question, lambda _, payload: self._events.put(("verdict", "", payload)))

    def _on_observation(self, bus: ZenohBus, seat: Seat, payload: bytes) -> None:
        for message in seat.in_order.take(codec.peek_tick(payload), payload):
            self._observe(bus, seat, message)
        name = seat.spec.name
        if (tick := seat.in_order.lost()) is not None:
            question = control.ResendRequest(port=keys.observation(name), tick=tick).to_bytes()
            bus.ask(control.resend("sensing"), question, lambda _, got: self._events.put(("observation", name, got)))

    def _observe(self, bus: ZenohBus, seat: Seat, payload: bytes) -> None:
        observation = codec.decode(Observation, payload)
        commands = seat.door.observed(observation)
        if observation.tick - seat.told_tick >= PROGRESS_EVERY_TICKS or observation.awaiting_command:
            seat.told_tick = observation.tick
            note = control.TickNote(tick=observation.tick).to_bytes()
            bus.publish(control.progress(door_name(seat.spec.name)), note)
        if observation.awaiting_command:
            seat.observation = payload
            if seat.asked_at is None:
                seat.asked_at = seat.repeated_at = time.monotonic()
        if seat.spec.name in self._guests:
            self._guests.observe(seat.spec.name, payload, is_question=observation.awaiting_command)
        self._pass(bus, seat, commands)

    def _pass(self, bus: ZenohBus, seat: Seat, commands: Sequence[Command]) -> None:
        for command in commands:
            payload = codec.encode(command)
            port = keys.command(seat.spec.name)
            seat.trail.append(command.tick, payload)
            seat.kept.keep(Sent(port, command, payload))
            bus.publish(port, payload, encoding=codec.encoding_of(Command), urgent=True)
            self._setup.run_dir.log_command(seat.spec.name, command)
        if commands:
            now = time.monotonic()
            seat.asked_at = now if seat.door.pending else None
            seat.repeated_at = now

    # ------------------------------------------------------------ faults

    # On the thread that waits for the process.
    def _on_child_exit(self, name: str, code: int) -> None:
        if not self._guests.exited(name, code):
            self._events.put(("exit", name, str(code).encode()))

    def _on_exit(self, bus: ZenohBus, name: str, code: int) -> None:
        if self._is_dismissing:
            return
        if name in self._progress:
            raise _EndedError(self._fault(name, f"{exit_text(code)}; the run is not valid without it."))
        for seat in self._seats.values():
            if door_name(seat.spec.process) == name:
                self._lose(bus, seat, f"the agent's process {exit_text(code)} before the end of the run.")

    def _on_vanished(self, kind: str, name: str) -> None:
        if self._is_dismissing:
            return
        # Its process may have ended too; that says more, and comes within a moment.
        if kind == "service" and name in self._progress:
            self._suspects.setdefault(name, time.monotonic())
        elif name in self._seats:
            self._departed.setdefault(name, time.monotonic())

    def _lose(self, bus: ZenohBus, seat: Seat, reason: str) -> None:
        tail = self._setup.run_dir.last_words(door_name(seat.spec.process))
        self._pass(bus, seat, seat.door.lost(f"{reason} Its last words: {tail}" if tail else reason))

    def _check_time(self, bus: ZenohBus) -> None:
        now = time.monotonic()
        for name, since in self._suspects.items():
            if now - since > LOST_CONTACT_GRACE_S:
                raise _EndedError(self._fault(name, "contact was lost: it hangs, or its link is down."))
        for name, since in list(self._departed.items()):
            if now - since > LOST_CONTACT_GRACE_S:
                del self._departed[name]
                self._lose(bus, self._seats[name], "the agent left the run before its end.")
        for seat in self._seats.values():
            if seat.asked_at is None:
                continue
            # An agent that owes an answer is not a stall of the run; it has its own deadline.
            self._moved_at = now
            if now - seat.asked_at > seat.spec.answer_within_s:
                self._lose(bus, seat, f"the agent did not answer within {seat.spec.answer_within_s:g} s.")
            elif now - seat.repeated_at > REPEAT_AFTER_S:
                self._repeat(bus, seat, now)
        limit_s = STALL_LIMIT_S if self._verdict is None else GOODBYE_LIMIT_S
        if now - self._moved_at > limit_s:
            raise _EndedError(self._stall_fault(limit_s))

    # A question may have been lost on its way; repeating it is harmless.
    def _repeat(self, bus: ZenohBus, seat: Seat, now: float) -> None:
        seat.repeated_at = now
        if seat.spec.name in self._guests:
            return
        if seat.briefing is not None:
            bus.publish(keys.briefing(seat.spec.name), seat.briefing)
        if seat.observation:
            bus.publish(keys.observation(seat.spec.name), seat.observation, urgent=True)

    def _stall_fault(self, limit_s: float) -> ServiceFault:
        silent = [name for name in self._services if name not in self._waiting and name not in self._byes]
        culprit = silent[0] if silent else min(self._progress, key=lambda name: self._progress[name])
        lines = [f"nothing moved for {limit_s:g} s; it is at tick {self._progress[culprit] + 1}."]
        for name, note in self._waiting.items():
            needs = [f"{port} at tick {tick}" for port, tick in note.missing]
            needs += [f"{reader} to catch up" for reader in note.lacking_credit]
            lines.append(f"  {name} waits at tick {note.tick} for {', '.join(needs)}")
        return self._fault(culprit, "\n".join(lines), ExitCode.TIMEOUT)

    def _fault(self, name: str, text: str, exit_code: ExitCode = ExitCode.FAULT) -> ServiceFault:
        log = self._setup.run_dir.log(name)
        tail = self._setup.run_dir.last_words(name)
        text = f"{text}\nLast lines of its log:\n{tail}" if tail else text
        tick = max(self._progress.get(name, 0), 0)
        return ServiceFault(participant=name, tick=tick, text=f"{text}\nLog: {log}", exit_code=exit_code)

    # ------------------------------------------------------------ end

    def _dismiss(self, bus: ZenohBus, children: Children) -> None:
        self._is_dismissing = True
        ending = codec.encode(ending_of(self._verdict))
        for name in self._seats:
            bus.publish(keys.ending(name), ending, encoding=codec.encoding_of(Ending), urgent=True)
        self._guests.end(ending)
        bus.publish(control.CLOSE, b"", urgent=True)
        children.wait(EXIT_LIMIT_S)

    def _complete(self, outcome: Outcome) -> None:
        outcome.verdict = self._verdict
        outcome.agent_faults = faults_of(seat.door for seat in self._seats.values())
        outcome.timing = {name: bye.timing for name, bye in sorted(self._byes.items())}
        outcome.ticks_flown = self._verdict.tick if self._verdict else max(min(self._progress.values()), 0)
        if self._verdict is not None and len(self._byes) == len(self._services):
            outcome.digest = self._digest(self._verdict.tick)

    def _digest(self, final_tick: int) -> RunDigest:
        trails: dict[str, Trail] = {}
        for bye in self._byes.values():
            trails |= {port: Trail.from_fields(fields) for port, fields in bye.trails.items()}
        for seat in self._seats.values():
            trails[keys.command(seat.spec.name)] = seat.trail
        writers = {port: self._dataflow.writer_of[port] for port in trails}
        return RunDigest(final_tick, writers, {port: trail.until(final_tick) for port, trail in trails.items()})

    def _tell(self, text: str, state: str) -> None:
        now = time.monotonic()
        if now - self._told_at < STATUS_EVERY_S:
            return
        self._told_at = now
        judged = self._progress.get("referee", -1)
        sim_time_s = seconds_from_ticks(max(judged, 0), self._setup.scenario.tick_ns)
        wall_s = time.perf_counter() - self._started_at if self._started_at else 0.0
        factor = sim_time_s / wall_s if wall_s > 0 else 0.0
        self._report(FlightStatus(state=state, text=text, sim_time_s=sim_time_s, real_time_factor=factor))
