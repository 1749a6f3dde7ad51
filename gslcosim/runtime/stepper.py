"""One participant as the runtime sees it: a core behind its gate, checked, timed and digested."""

import time
from collections import deque
from collections.abc import Mapping, Set
from dataclasses import dataclass, field
from typing import Any

from gslcosim.contract import codec
from gslcosim.contract.messages import Message
from gslcosim.contract.participant import Core, Episode, Inbox, Outbox, ParticipantSpec, Snapshots
from gslcosim.errors import ModelError, SnapshotError
from gslcosim.runtime.dataflow import ONCE, Dataflow
from gslcosim.runtime.digest import Trail
from gslcosim.runtime.gate import Gate
from gslcosim.runtime.snapshots.keeping import keeper_of
from gslcosim.runtime.snapshots.parts import SnapshotPart, maker_of


@dataclass(frozen=True)
class Sent:
    """An output with its canonical bytes."""

    port: str
    message: Message
    payload: bytes


@dataclass
class Timing:
    """Where a participant's wall time went [ns]; it has no influence on results."""

    stepping_ns: int = 0
    encoding_ns: int = 0
    receiving_ns: int = 0
    waiting_ns: int = 0
    n_steps: int = 0
    n_resends: int = 0

    def as_fields(self) -> dict[str, int]:
        """Return the figures as a message can carry them."""
        return dict(vars(self))


@dataclass
class Stepper:
    """Steps a core whenever its gate allows, and checks that it keeps its own declaration."""

    core: Core
    dataflow: Dataflow
    is_kept: bool = False
    trails: dict[str, Trail] = field(init=False)
    timing: Timing = field(default_factory=Timing)
    gate: Gate = field(init=False)
    _due_always: frozenset[str] | None = field(init=False, repr=False)
    _keeper: Snapshots | None = field(init=False, repr=False)
    recent: deque[Sent] = field(default_factory=deque[Sent], init=False, repr=False)

    def __post_init__(self) -> None:
        self.spec: ParticipantSpec = self.core.spec
        self.gate = Gate(self.dataflow, self.spec.name)
        self.trails = {write.port: Trail() for write in self.spec.writes}
        # What it writes at every tick, and nothing else, if that is so.
        is_plain = all(write.announced_in is None and write.period_ticks == 1 for write in self.spec.writes)
        self._due_always = frozenset(write.port for write in self.spec.writes) if is_plain else None
        self._keeper = keeper_of(self.core) if self.is_kept else None
        readers = self.dataflow.readers_of(self.spec.name)
        reads = [read for reader in readers for read in reader.reads if read.port in self.trails]
        self._longest_delay = max((read.delay_ticks for read in reads), default=0)
        self._longest_window = max((reader.window_ticks for reader in readers), default=0)

    def reset(self, episode: Episode) -> list[Sent]:
        """Reset the core and return what it writes once."""
        outbox = self.core.reset(episode)
        expected = {write.port for write in self.spec.writes if write.announced_in == ONCE}
        self._check(outbox, expected, 0, "reset")
        if self._keeper is not None:
            # What cannot be kept is told now, and not when the first snapshot is due.
            self._state_of(self._keeper)
        return [self._send(port, message) for port, message in outbox.items()]

    def step(self) -> list[Sent]:
        """Step the core once (its gate must allow it) and return what it wrote."""
        started = time.perf_counter_ns()
        tick, inbox = self.gate.take()
        outbox = self.core.step(tick, inbox)
        stepped = time.perf_counter_ns()
        self._check(outbox, self._due(tick, inbox, outbox), tick, "step")
        sent = [self._send(port, message) for port, message in outbox.items()]
        timing = self.timing
        timing.stepping_ns += stepped - started
        timing.encoding_ns += time.perf_counter_ns() - stepped
        timing.n_steps += 1
        return sent

    def _send(self, port: str, message: Message) -> Sent:
        payload = codec.encode_finite(message)
        self.trails[port].append(message.tick, payload)
        self.gate.wrote(port, message)
        sent = Sent(port, message, payload)
        if self._keeper is not None:
            self._remember(sent)
        return sent

    def part(self) -> SnapshotPart:
        """Return what this participant needs to go on from here elsewhere.

        Raises:
            SnapshotError: something in its core cannot be kept.
        """
        assert self._keeper is not None
        gate = self.gate
        # What some reader may not have, and what readers with a delay have not stepped.
        after_tick = min(gate.least_credit, gate.next_tick - 1 - self._longest_delay)
        return SnapshotPart(
            participant=self.spec.name,
            tick=gate.next_tick,
            state=self._state_of(self._keeper),
            memory=gate.memory(),
            trails={port: trail.as_fields() for port, trail in self.trails.items()},
            outputs=[(sent.port, sent.payload) for sent in self.recent if sent.message.tick > after_tick],
            made_by=maker_of(self.core),
        )

    def go_on(self, part: SnapshotPart) -> None:
        """Go on from a part, after `reset`.

        Raises:
            SnapshotError: the part is of another core.
        """
        assert self._keeper is not None
        if part.made_by != maker_of(self.core):
            raise SnapshotError(f"{self.spec.name}: expected a snapshot of its own code, was one of other code.")
        try:
            self._keeper.bring_back(part.state)
        except SnapshotError as error:
            raise SnapshotError(f"{self.spec.name}{error}") from error
        for write in self.spec.writes:
            # What is written once has been written by `reset`.
            if write.announced_in != ONCE:
                self.trails[write.port] = Trail.from_fields(part.trails[write.port])
        self.gate.go_on(part.tick, part.memory)
        types = self.dataflow.message_types
        self.recent.extend(
            Sent(port, codec.decode_trusted(types[port], payload), payload) for port, payload in part.outputs
        )

    def _state_of(self, keeper: Snapshots) -> Mapping[str, Any]:
        try:
            return keeper.state()
        except SnapshotError as error:
            remedy = "Leave out snapshots, or let its core tell its state itself (docs/snapshots.md)."
            raise SnapshotError(f"{self.spec.name}{error} {remedy}") from error

    def _remember(self, sent: Sent) -> None:
        recent = self.recent
        recent.append(sent)
        while recent[0].message.tick < sent.message.tick - self._longest_delay - self._longest_window:
            recent.popleft()

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
