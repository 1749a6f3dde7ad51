"""Stepping: a gate for a participant's inputs, a stepper that checks and digests, the clock's pace, and the loop."""

import os
import time
from collections import deque
from collections.abc import Collection, Iterator, Mapping, Sequence, Set
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

from gslcosim.base.errors import ModelError, SnapshotError
from gslcosim.base.ticks import NS_PER_S, ticks_from_seconds
from gslcosim.contract import codec
from gslcosim.contract.messages import Message, Verdict
from gslcosim.contract.participant import (
    Core,
    Episode,
    Inbox,
    Outbox,
    ParticipantSpec,
    SupportsClose,
    SupportsPrefetch,
    SupportsSnapshots,
    SupportsSummary,
)
from gslcosim.runtime.dataflow import ONCE, Dataflow
from gslcosim.runtime.digest import HashChain
from gslcosim.runtime.participant_status import MissingMessage, ParticipantStatus
from gslcosim.runtime.processes.current_process import read_memory_bytes
from gslcosim.runtime.replay.snapshot import (
    Snapshot,
    SnapshotPart,
    build_state_adapter,
    find_latest_parts,
    hash_external_core,
    save_part,
)
from gslcosim.runtime.run_dir import RunDir
from gslcosim.runtime.setup import RunSetup

NO_TICK_LIMIT = 2**62
# The participant that all others wait for: holding it back holds the run.
PACED_PARTICIPANT = "world"
# A longer delay is not made up for: a spectator could not follow.
MAX_CAUGHT_UP_S = 1.0


@dataclass(frozen=True)
class MissingInput:
    """An input that is not here yet: the message of a port at a tick."""

    port: str
    tick: int


class Gate:
    """Holder of a participant's inputs, which decides when its next step may happen.

    A step of tick k needs, for each read, the message of tick k - delay if one exists. One exists at the ticks of the
    port's period, or at announced ticks, and never after a message that closes the port. A writer may be at most
    `window_ticks` ahead of each reader (the reader's window).

    Duplicates and inputs of the past are ignored; messages may be delivered in any order.
    """

    def __init__(self, dataflow: Dataflow, name: str) -> None:
        self.next_tick = 0
        self.final_tick: int | None = None
        reads, writes = dataflow.by_name[name].reads, dataflow.writes
        self._reads = tuple((read.port, read.delay_ticks, writes[read.port]) for read in reads)
        self._delays = {read.port: read.delay_ticks for read in reads}
        self._longest_delay = max((read.delay_ticks for read in reads), default=0)
        self._held: dict[str, dict[int, Message]] = {read.port: {} for read in reads}
        self._last_ticks: dict[str, int] = {}
        announcers = {write.announced_in for _, _, write in self._reads if write.announced_in not in (None, ONCE)}
        self._announced: dict[str, dict[int, frozenset[str]]] = {port: {} for port in announcers if port}
        self._closed: dict[str, int] = {}
        self._windows = {reader.name: reader.window_ticks for reader in dataflow.readers_of[name]}
        self._credit = dict.fromkeys(self._windows, -1)
        self._credit_until = self._last_tick_in_credit()

    def deliver(self, port: str, message: Message) -> bool:
        """Take an input and return whether it was new; one that is known, past or not read is ignored."""
        delay = self._delays.get(port)
        if delay is None or message.tick < self.next_tick - delay or message.tick in self._held[port]:
            return False
        self._held[port][message.tick] = message
        self._last_ticks[port] = message.tick
        self.note(port, message)
        return True

    def note(self, port: str, message: Message) -> None:
        """Take note of what an input, or an output of the participant itself, announces and closes."""
        if port in self._announced:
            self._announced[port].setdefault(message.tick, message.announced_ports())
        if message.closes_port:
            self._closed[port] = min(message.tick, self._closed.get(port, message.tick))

    def grant(self, reader: str, tick: int) -> None:
        """Take note that a reader has finished a tick."""
        if tick > self._credit.get(reader, tick):
            self._credit[reader] = tick
            self._credit_until = self._last_tick_in_credit()

    def missing(self) -> list[MissingInput]:
        """Return the inputs that the next step still needs; for an unknown announcement, the announcement."""
        needed: list[MissingInput] = []
        for port, delay, write in self._reads:
            tick = self.next_tick - delay
            if tick < 0 or tick in self._held[port]:
                continue
            if self._closed.get(port, tick) < tick:
                continue
            if write.announced_in is None:
                if tick % write.period_ticks == 0:
                    needed.append(MissingInput(port, tick))
            elif write.announced_in != ONCE:
                announced = self._announced[write.announced_in].get(tick)
                if announced is None:
                    needed.append(MissingInput(write.announced_in, tick))
                elif port in announced:
                    needed.append(MissingInput(port, tick))
        return needed

    def lacking_credit(self) -> list[str]:
        """Return the readers that the next step would leave too far behind."""
        return [name for name, window in self._windows.items() if self.next_tick > self._credit[name] + window]

    @property
    def is_finished(self) -> bool:
        """True when the run's last tick has been stepped."""
        return self.final_tick is not None and self.next_tick > self.final_tick

    def can_step(self) -> bool:
        """Return whether the next step may happen now."""
        tick = self.next_tick
        return tick <= self._credit_until and not self.is_finished and not self.missing()

    def take(self) -> tuple[int, dict[str, Message]]:
        """Return the tick to step and its inputs, and move on to the next tick; `may_step` must hold."""
        tick = self.next_tick
        inbox: dict[str, Message] = {}
        for port, delay, _ in self._reads:
            message = self._held[port].pop(tick - delay, None)
            if message is not None:
                inbox[port] = message
        for announced in self._announced.values():
            announced.pop(tick - self._longest_delay, None)
        self.next_tick = tick + 1
        return tick, inbox

    def memory(self) -> dict[str, Any]:
        """Return the state that is in no later message: announcements, and closed ports."""
        announced = {
            port: [[tick, sorted(ports)] for tick, ports in ticks.items() if tick < self.next_tick]
            for port, ticks in self._announced.items()
        }
        closed = {port: tick for port, tick in self._closed.items() if tick < self.next_tick}
        return {"announced": announced, "closed": closed}

    def go_on(self, tick: int, memory: Mapping[str, Any]) -> None:
        """Resume at a tick with the state of `memory`; inputs are to be delivered again."""
        self.next_tick = tick
        for port, ticks in memory.get("announced", {}).items():
            self._announced[port] = {then: frozenset(ports) for then, ports in ticks}
        self._closed = dict(memory.get("closed", {}))

    @property
    def least_credit(self) -> int:
        """The last tick that all readers have finished; `NO_TICK_LIMIT` without readers."""
        return min(self._credit.values(), default=NO_TICK_LIMIT)

    @property
    def has_waiting_inputs(self) -> bool:
        """True when inputs wait here for others."""
        return any(self._held.values())

    @property
    def n_queued_ticks(self) -> int:
        """Number of ticks that wait in the fullest input."""
        return max((len(held) for held in self._held.values()), default=0)

    def last_tick(self, port: str) -> int:
        """Return the tick of the message that came last on a port, -1 before the first."""
        return self._last_ticks.get(port, -1)

    def has_later(self, missing: MissingInput) -> bool:
        """Return whether a later message of a port is here, so that a missing one must have been lost."""
        held = self._held.get(missing.port, {})
        return any(tick > missing.tick for tick in held)

    def _last_tick_in_credit(self) -> int:
        return min((self._credit[name] + window for name, window in self._windows.items()), default=NO_TICK_LIMIT)


class SentMessage(NamedTuple):
    """An output with its canonical bytes."""

    port: str
    message: Message
    payload: bytes


@dataclass
class Timing:
    """Breakdown of a participant's wall time [ns]; it has no influence on results."""

    stepping_ns: int = 0
    encoding_ns: int = 0
    receiving_ns: int = 0
    waiting_ns: int = 0
    n_steps: int = 0
    n_resends: int = 0


class Stepper:
    """Stepper of one core, which checks that the core keeps its own declaration."""

    def __init__(self, core: Core, dataflow: Dataflow, *, is_kept: bool = False) -> None:
        self.core = core
        self.dataflow = dataflow
        self.spec: ParticipantSpec = core.spec
        self.gate = Gate(dataflow, self.spec.name)
        self.trails = {write.port: HashChain() for write in self.spec.writes}
        self.timing = Timing()
        self._step_began_ns: int | None = None
        # The ports of a participant that writes all of them at every tick, but for those that it writes once.
        dated = [write for write in self.spec.writes if write.announced_in != ONCE]
        is_plain = all(write.announced_in is None and write.period_ticks == 1 for write in dated)
        self._due_always = frozenset(write.port for write in dated) if is_plain else None
        # A participant that writes nothing holds up no step of another.
        self.is_kept = is_kept and bool(self.spec.writes)
        self._state_adapter = build_state_adapter(core) if self.is_kept else None
        self.recent: deque[SentMessage] = deque()
        readers = dataflow.readers_of[self.spec.name]
        reads = [read for reader in readers for read in reader.reads if read.port in self.trails]
        self._longest_delay = max((read.delay_ticks for read in reads), default=0)
        self._longest_window = max((reader.window_ticks for reader in readers), default=0)

    def reset(self, episode: Episode) -> list[SentMessage]:
        """Reset the core and return what it writes once."""
        outbox = self.core.reset(episode)
        expected = {write.port for write in self.spec.writes if write.announced_in == ONCE}
        self._check(outbox, expected, 0, "reset")
        if self._state_adapter is not None:
            # A state that cannot be kept is reported now, not at the first snapshot.
            self._state_of(self._state_adapter)
        return [self._send(port, message) for port, message in outbox.items()]

    def step(self) -> list[SentMessage]:
        """Step the core once (its gate must allow it) and return what it wrote."""
        self._step_began_ns = started = time.perf_counter_ns()
        tick, inbox = self.gate.take()
        outbox = self.core.step(tick, inbox)
        stepped = time.perf_counter_ns()
        self._step_began_ns = None
        self._check(outbox, self._due(tick, inbox, outbox), tick, "step")
        sent = [self._send(port, message) for port, message in outbox.items()]
        timing = self.timing
        timing.stepping_ns += stepped - started
        timing.encoding_ns += time.perf_counter_ns() - stepped
        timing.n_steps += 1
        return sent

    def look(self) -> ParticipantStatus:
        """Return one moment of the participant, with the usage of this process; may be called on any thread."""
        gate, began_ns = self.gate, self._step_began_ns
        name, in_step, writer_of = self.spec.name, began_ns is not None, self.dataflow.writer_of
        can_wait = not in_step and not gate.is_finished
        missing = gate.missing() if can_wait else []
        lacking_credit = gate.lacking_credit() if can_wait else []
        return ParticipantStatus(
            name=name,
            state="done" if gate.is_finished and not in_step else "waiting" if missing or lacking_credit else "working",
            tick=gate.next_tick - (2 if in_step else 1),
            missing=tuple(
                MissingMessage(**vars(each), writer=writer_of[each.port], last_tick=gate.last_tick(each.port))
                for each in missing
            ),
            lacking_credit=tuple(lacking_credit),
            occupied_s=None if began_ns is None else (time.perf_counter_ns() - began_ns) / NS_PER_S,
            queued_ticks=gate.n_queued_ticks,
            pid=os.getpid(),
            cpu_s=time.process_time(),
            memory_bytes=read_memory_bytes(),
            n_resends=self.timing.n_resends,
        )

    def _send(self, port: str, message: Message) -> SentMessage:
        payload = codec.encode_finite(message)
        self.trails[port].append(message.tick, payload)
        self.gate.note(port, message)
        sent = SentMessage(port, message, payload)
        if self._state_adapter is not None:
            self.recent.append(sent)
            while self.recent[0].message.tick < message.tick - self._longest_delay - self._longest_window:
                self.recent.popleft()
        return sent

    def part(self) -> SnapshotPart:
        """Return the part of a snapshot with which this participant can resume."""
        assert self._state_adapter is not None
        gate = self.gate
        # Messages that a reader may lack, or has not stepped because of its delay.
        after_tick = min(gate.least_credit, gate.next_tick - 1 - self._longest_delay)
        return SnapshotPart(
            participant=self.spec.name,
            tick=gate.next_tick,
            state=self._state_of(self._state_adapter),
            memory=gate.memory(),
            trails={port: trail.as_fields() for port, trail in self.trails.items()},
            outputs=[(sent.port, sent.payload) for sent in self.recent if sent.message.tick > after_tick],
            made_by=hash_external_core(self.core),
        )

    def go_on(self, part: SnapshotPart) -> None:
        """Go on from a part, after `reset`."""
        assert self._state_adapter is not None
        if part.made_by != hash_external_core(self.core):
            raise SnapshotError(f"{self.spec.name}: expected a snapshot of its own code, was one of other code.")
        try:
            self._state_adapter.restore(part.state)
        except SnapshotError as error:
            place = f"{self.spec.name}{'' if str(error).startswith(('.', '[')) else ': '}"
            raise SnapshotError(f"{place}{error}") from error
        for write in self.spec.writes:
            # `reset` has written the ports that are written once.
            if write.announced_in != ONCE:
                self.trails[write.port] = HashChain.from_fields(part.trails[write.port])
        self.gate.go_on(part.tick, part.memory)
        types = self.dataflow.message_types
        self.recent.extend(
            SentMessage(port, codec.decode_trusted(types[port], payload), payload) for port, payload in part.outputs
        )

    def _state_of(self, adapter: SupportsSnapshots) -> Mapping[str, Any]:
        try:
            return adapter.state()
        except SnapshotError as error:
            remedy = "Leave out snapshots, or let its core tell its state itself (docs/snapshots.md)."
            raise SnapshotError(f"{self.spec.name}{error} {remedy}") from error

    def _due(self, tick: int, inbox: Inbox, outbox: Outbox) -> Set[str]:
        if self._due_always is not None:
            return self._due_always
        due: set[str] = set()
        for write in self.spec.writes:
            if write.announced_in is None:
                if tick % write.period_ticks == 0:
                    due.add(write.port)
            elif write.announced_in != ONCE:
                announcer = outbox.get(write.announced_in) or inbox.get(write.announced_in)
                if announcer is not None and write.port in announcer.announced_ports():
                    due.add(write.port)
        return due

    def _check(self, outbox: Mapping[str, Message], expected: Set[str], tick: int, method: str) -> None:
        if outbox.keys() != expected:
            raise ModelError(
                f"{self.spec.name}.{method} at tick {tick}: expected messages on {sorted(expected)}, "
                f"was {sorted(outbox)}."
            )
        for port, message in outbox.items():
            if message.tick != tick or type(message) is not self.dataflow.message_types[port]:
                expected_type = self.dataflow.message_types[port].__name__
                raise ModelError(
                    f"{self.spec.name}.{method} at tick {tick}: expected a {expected_type} of this tick on {port}, "
                    f"was a {type(message).__name__} of tick {message.tick}."
                )


class ClockPace:
    """Clock that holds ticks back until their time. It has no influence on their content.

    Tick k may begin k ticks after the first one, by the clock on the wall divided by the pace. A tick that begins later
    than that by more than its own length counts as late. Small delays are made up for; one of more than
    `MAX_CAUGHT_UP_S` is lost: from there time goes on at the pace.

    All times are those of the monotonic clock [s]. `pace` is in simulated seconds in a second; ticks before `from_tick`
    are not held back.
    """

    def __init__(self, pace: float, tick_ns: int, *, from_tick: int = 0) -> None:
        self._pace = pace
        self._tick_s = tick_ns / NS_PER_S / pace
        self._from_tick = from_tick
        self._origin_s: float | None = None
        self._worst_lag_s = 0.0
        self._lost_s = 0.0
        self._n_late = 0
        self._n_ticks = 0

    def wait_s(self, tick: int, now_s: float) -> float:
        """Return the time until a tick may begin [s]; 0 where it may."""
        if tick < self._from_tick:
            return 0.0
        return max(0.0, self._due_s(tick, now_s) - now_s)

    def begins(self, tick: int, now_s: float) -> None:
        """Take note that a tick begins."""
        if tick < self._from_tick:
            return
        lag_s = max(0.0, now_s - self._due_s(tick, now_s))
        self._n_ticks += 1
        self._n_late += lag_s > self._tick_s
        self._worst_lag_s = max(self._worst_lag_s, lag_s)
        if lag_s > MAX_CAUGHT_UP_S and self._origin_s is not None:
            self._origin_s += lag_s
            self._lost_s += lag_s

    def summary(self) -> dict[str, Any]:
        """Return the entry in `result.json`."""
        return {
            "pace": {
                "factor": self._pace,
                "worst_lag_s": round(self._worst_lag_s, 3),
                "late_share": round(self._n_late / max(self._n_ticks, 1), 4),
                "lost_s": round(self._lost_s, 3),
            }
        }

    def _due_s(self, tick: int, now_s: float) -> float:
        if self._origin_s is None:
            self._origin_s = now_s - (tick - self._from_tick) * self._tick_s
        return self._origin_s + (tick - self._from_tick) * self._tick_s


def build_clock_pace(setup: RunSetup) -> ClockPace | None:
    """Return the pace of a run; None where its time follows no clock."""
    pace = setup.scenario.pace
    if pace is None or setup.paced_from_tick is None:
        return None
    return ClockPace(pace, setup.scenario.tick_ns, from_tick=setup.paced_from_tick)


@dataclass(frozen=True, kw_only=True)
class SnapshotPolicy:
    """Policy of a run's snapshots: every so many ticks (None: never), and the snapshot at which it resumes."""

    run_dir: RunDir
    every_ticks: int | None
    snapshot: Snapshot | None
    is_restarting: bool = False

    @classmethod
    def of(cls, setup: RunSetup) -> "SnapshotPolicy":
        """Return the policy of a run's scenario."""
        spec, tick_ns = setup.scenario.snapshots, setup.scenario.tick_ns
        every_ticks = None if spec is None else max(1, ticks_from_seconds(spec.every_s, tick_ns))
        return cls(
            run_dir=setup.run_dir,
            every_ticks=every_ticks,
            snapshot=setup.snapshot,
            is_restarting=setup.scenario.restart is not None,
        )

    @property
    def extra_retained_ticks(self) -> int:
        """Further ticks for which messages are kept: a restarted service needs those since its snapshot."""
        return self.every_ticks or 0 if self.is_restarting else 0

    def is_due(self, stepper: Stepper) -> bool:
        """Return whether a participant is to write its part of a snapshot before its next step."""
        tick, every = stepper.gate.next_tick, self.every_ticks
        return every is not None and stepper.is_kept and tick > 0 and tick % every == 0

    def go_on(self, steppers: Collection[Stepper], dataflow: Dataflow) -> None:
        """Let the participants of this process, which have been reset, go on at the run's snapshot, if it has one."""
        if self._go_on_where_it_was(steppers):
            return
        snapshot = self.snapshot
        if snapshot is None:
            return
        for stepper in steppers:
            if stepper.is_kept:
                stepper.go_on(snapshot.part(stepper.spec.name))
            else:
                stepper.gate.go_on(snapshot.tick, {})
            # All others resume there too.
            for reader in dataflow.readers_of[stepper.spec.name]:
                stepper.gate.grant(reader.name, snapshot.tick - 1)
        for port, message in snapshot.messages(dataflow):
            for stepper in steppers:
                stepper.gate.deliver(port, message)

    # Only a restarted process finds its own parts in the run's folder; it requests whatever else it needs.
    def _go_on_where_it_was(self, steppers: Collection[Stepper]) -> bool:
        if not self.is_restarting or not all(stepper.is_kept for stepper in steppers):
            return False
        parts = find_latest_parts(self.run_dir, [stepper.spec.name for stepper in steppers])
        for stepper, part in zip(steppers, parts, strict=False):
            stepper.go_on(part)
        return bool(parts)


class StepListener(Protocol):
    """Listener of a step loop, called at each step."""

    def on_outputs(self, stepper: Stepper, outputs: list[SentMessage]) -> None:
        """Take a participant's outputs; its readers in this process have them."""
        ...

    def before_snapshot(self, stepper: Stepper) -> None:
        """Send what waits before a participant's state is written."""

    def after_step(self, stepper: Stepper) -> None:
        """Take note that a participant has finished a tick."""


class StepLoop:
    """Loop over the participants of one process: all of a run, a group of them, or one.

    Their messages for each other are handed over as they are. The holder of the loop delivers those from elsewhere.

    Attributes:
        steppers: From upstream to downstream.
        acting: The participant that is at fault where something goes wrong now.
    """

    def __init__(
        self,
        cores: Sequence[Core],
        dataflow: Dataflow,
        listener: StepListener,
        *,
        is_whole_run: bool,
        pace: ClockPace | None = None,
        policy: SnapshotPolicy | None = None,
    ) -> None:
        """Prepare to step cores, from upstream to downstream.

        Args:
            is_whole_run: True where all readers are here; then none runs ahead, and no credit is counted.
            pace: Holds the ticks of `PACED_PARTICIPANT` back, if anything does.
        """
        self._dataflow = dataflow
        self._listener = listener
        self._pace = pace
        self._policy = policy
        self._is_whole_run = is_whole_run
        self._turn = 0
        is_kept = policy is not None and (policy.every_ticks is not None or policy.snapshot is not None)
        self.steppers = tuple(Stepper(core, dataflow, is_kept=is_kept) for core in cores)
        # Looked up once: every wait needs them, and the look-up takes longer than a step's bookkeeping.
        self._prefetchers = tuple(
            (stepper, stepper.core.prefetch) for stepper in self.steppers if isinstance(stepper.core, SupportsPrefetch)
        )
        self.acting = self.steppers[0]
        self._readers = {
            port: [stepper for stepper in self.steppers if any(read.port == port for read in stepper.spec.reads)]
            for port in dataflow.writer_of
        }
        self._creditors: dict[str, list[Stepper]] = {stepper.spec.name: [] for stepper in self.steppers}
        for stepper in self.steppers:
            for reader in dataflow.readers_of[stepper.spec.name]:
                if is_whole_run:
                    stepper.gate.grant(reader.name, NO_TICK_LIMIT)
                elif reader.name in self._creditors:
                    self._creditors[reader.name].append(stepper)

    @property
    def is_paced(self) -> bool:
        """True when ticks of this process are held back by the clock."""
        return self._pace is not None

    @property
    def last_tick(self) -> int:
        """The last tick that all have finished, -1 before the first."""
        return min(stepper.gate.next_tick for stepper in self.steppers) - 1

    @property
    def is_between_ticks(self) -> bool:
        """True when no participant has begun a tick that others have not; only where the whole run is here."""
        return self._turn == 0

    @property
    def is_finished(self) -> bool:
        """True when all have stepped the run's last tick."""
        return all(stepper.gate.is_finished for stepper in self.steppers)

    def reads(self, port: str) -> bool:
        """Return whether one of them reads a port."""
        return bool(self._readers.get(port))

    def reset(self, episode: Episode) -> Iterator[tuple[Stepper, list[SentMessage]]]:
        """Reset all, one after another, and yield each with what it writes once; hand that over with `pass_on`."""
        for stepper in self.steppers:
            self.acting = stepper
            yield stepper, stepper.reset(episode)

    def start(self, episode: Episode) -> None:
        """Reset all, hand over what each writes once, and let them go on at the snapshot, if the run has one."""
        for stepper, outputs in self.reset(episode):
            self.pass_on(stepper, outputs)
        self.resume()

    def resume(self) -> None:
        """Let all that have been reset go on at the snapshot, if the run has one to go on at."""
        if self._policy is not None:
            self._policy.go_on(self.steppers, self._dataflow)

    def step(self) -> bool:
        """Step each one that can, once, so that what one writes is still warm when the next reads it.

        A whole run goes tick by tick: no participant begins a tick before all have finished the one before, so that
        nothing is computed, and no agent observes anything, past the verdict.

        Returns whether any has stepped.
        """
        has_stepped = False
        for stepper in self.steppers[self._turn :]:
            if self.can_step(stepper):
                self.step_one(stepper)
                has_stepped = True
            elif self._is_whole_run and not stepper.gate.is_finished:
                return has_stepped
            if self._is_whole_run:
                self._turn += 1
        self._turn = 0
        return has_stepped

    def can_step(self, stepper: Stepper) -> bool:
        """Return whether the next step of a participant may happen now: its inputs are here, and its time has come."""
        return stepper.gate.can_step() and (self._pace is None or not self._wait_s(stepper))

    def can_any_step(self) -> bool:
        """Return whether any may step now."""
        return any(map(self.can_step, self.steppers))

    @property
    def pace_wait_s(self) -> float:
        """Time for which the clock alone holds a participant back [s]; all others wait for that one."""
        if not self.is_paced:
            return 0.0
        return max((self._wait_s(stepper) for stepper in self.steppers if stepper.gate.can_step()), default=0.0)

    def step_one(self, stepper: Stepper) -> None:
        """Step a participant that can, hand over what it writes, and write its state where that is due."""
        self.acting = stepper
        if (pace := self._pace_of(stepper)) is not None:
            pace.begins(stepper.gate.next_tick, time.monotonic())
        self.pass_on(stepper, stepper.step())
        if self._policy is not None and self._policy.is_due(stepper):
            self._listener.before_snapshot(stepper)
            save_part(self._policy.run_dir, stepper.part())
        self._listener.after_step(stepper)

    def pass_on(self, stepper: Stepper, outputs: list[SentMessage]) -> None:
        """Hand what a participant has written to its readers; a verdict ends the run."""
        for sent in outputs:
            self.deliver(sent.port, sent.message)
            if isinstance(sent.message, Verdict):
                self.end_at(sent.message.tick)
        for writer in self._creditors[stepper.spec.name]:
            writer.gate.grant(stepper.spec.name, stepper.gate.next_tick - 1)
        self._listener.on_outputs(stepper, outputs)

    def deliver(self, port: str, message: Message) -> bool:
        """Hand a message to all that read its port, and return whether it was new to any."""
        is_new = False
        for reader in self._readers.get(port, ()):
            is_new |= reader.gate.deliver(port, message)
        return is_new

    def grant(self, reader: str, tick: int) -> None:
        """Take note that a reader elsewhere has finished a tick."""
        for stepper in self.steppers:
            stepper.gate.grant(reader, tick)

    def end_at(self, tick: int | None) -> None:
        """Let a tick be the last one of all, where none before it is; None: no tick is."""
        for gate in (stepper.gate for stepper in self.steppers):
            if tick is None or gate.final_tick is None or tick < gate.final_tick:
                gate.final_tick = tick

    def prefetch(self) -> bool:
        """Let one of the cores compute ahead without its inputs; return whether there was anything to do."""
        for stepper, prefetch in self._prefetchers:
            self.acting = stepper
            if prefetch():
                return True
        return False

    def close(self, stepper: Stepper) -> None:
        """Let a participant's core write what it holds."""
        self.acting = stepper
        if isinstance(stepper.core, SupportsClose):
            stepper.core.close()

    def summarize(self, stepper: Stepper) -> dict[str, Any]:
        """Return the entry of a participant in `result.json`."""
        own = dict(stepper.core.summary()) if isinstance(stepper.core, SupportsSummary) else {}
        pace = self._pace_of(stepper)
        return own if pace is None else own | pace.summary()

    def _pace_of(self, stepper: Stepper) -> ClockPace | None:
        return self._pace if stepper.spec.name == PACED_PARTICIPANT else None

    def _wait_s(self, stepper: Stepper) -> float:
        pace = self._pace_of(stepper)
        return 0.0 if pace is None else pace.wait_s(stepper.gate.next_tick, time.monotonic())
