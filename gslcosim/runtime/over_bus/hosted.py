"""One participant of a process: its stepper, what it has sent, and what it has told of its progress."""

import itertools
import os
import socket
import threading
import time
from collections import OrderedDict
from collections.abc import Callable, Collection
from dataclasses import dataclass, field
from typing import Any

import gslcosim
from gslcosim.bus.port import Bus
from gslcosim.contract import codec
from gslcosim.contract.messages import Verdict
from gslcosim.contract.participant import Accounts, Closes, Core, Episode, WorksAhead
from gslcosim.contract.schema import contract_hash
from gslcosim.errors import ContractError
from gslcosim.runtime.clock_pace import ClockPace
from gslcosim.runtime.dataflow import Dataflow
from gslcosim.runtime.gate import Missing
from gslcosim.runtime.over_bus import control
from gslcosim.runtime.snapshots.taking import Keeping
from gslcosim.runtime.stepper import Sent, Stepper
from gslcosim.runtime.watching.own_process import cpu_s, memory_bytes

# And far less than the window of credit, so that nobody ever waits for a note that is not sent yet.
PROGRESS_EVERY_TICKS = 64
_PROGRESS_WINDOW_SHARE = 4
# A slow run shows that it moves.
PROGRESS_EVERY_S = 1.0
BUNDLE_TICKS = 64
KEPT_TICKS = 1024
RESENT_AT_ONCE = 32


@dataclass
class Kept:
    """The messages of each port in its last ticks, for readers that missed one; shared between two threads."""

    n_ticks: int = KEPT_TICKS
    _payloads: dict[str, OrderedDict[int, bytes]] = field(default_factory=dict[str, OrderedDict[int, bytes]])
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def keep(self, sent: Sent) -> None:
        """Remember a message and forget those that are too old for anybody to ask for."""
        tick = sent.message.tick
        with self._lock:
            payloads = self._payloads.setdefault(sent.port, OrderedDict())
            payloads[tick] = sent.payload
            while next(iter(payloads)) <= tick - self.n_ticks:
                payloads.popitem(last=False)

    def answer(self, question: bytes) -> list[bytes]:
        """Return the message asked for and those after it, none when it is not here (any more, or yet).

        Messages travel in bundles, so what follows a lost one was most likely lost with it.
        """
        try:
            request = control.ResendRequest.from_bytes(question)
        except ContractError:
            return []
        with self._lock:
            payloads = self._payloads.get(request.port, OrderedDict[int, bytes]())
            if request.tick not in payloads:
                return []
            later = (payload for tick, payload in payloads.items() if tick >= request.tick)
            return list(itertools.islice(later, RESENT_AT_ONCE))


class Hosted:
    """A participant behind a bus that it may share with others of its process.

    Args:
        bus: The process's connection.
        core: The participant.
        dataflow: Of the whole run.
        neighbours: The participants of its process; what only they read does not travel.
        pace: Holds its ticks back, if anything does.
        keeping: What is kept of the run's state; absent: nothing.
    """

    def __init__(
        self,
        bus: Bus,
        core: Core,
        dataflow: Dataflow,
        neighbours: Collection[str],
        pace: ClockPace | None = None,
        keeping: Keeping | None = None,
    ) -> None:
        self._bus = bus
        self._core = core
        self._works_ahead = core if isinstance(core, WorksAhead) else None
        self._pace = pace
        self._keeping = keeping
        self.stepper = Stepper(core, dataflow) if keeping is None else keeping.stepper(core, dataflow)
        self.gate = self.stepper.gate
        self.name = self.stepper.spec.name
        reads = self.stepper.spec.reads
        self.ports_read = {read.port for read in reads}
        self.outer_ports_read = {port for port in self.ports_read if dataflow.writer_of[port] not in neighbours}
        self._neighbours_read = {reader.name for reader in dataflow.readers_of(self.name) if reader.name in neighbours}
        self.outer_readers = {reader.name for reader in dataflow.readers_of(self.name)} - self._neighbours_read
        self._bundle_key = control.bundle(self.name, self.outer_readers)
        self._ports_that_leave = {
            write.port
            for write in self.stepper.spec.writes
            if control.is_for_all(write.port)
            or any(
                read.port == write.port
                for reader in dataflow.readers_of(self.name)
                if reader.name in self.outer_readers
                for read in reader.reads
            )
        }
        readers = dataflow.readers_of(self.name)
        # Who misses a message is a window behind at most, and asks for it before its writer is another one ahead.
        more_ticks = 0 if keeping is None else keeping.more_ticks
        self.kept = Kept(more_ticks + max([KEPT_TICKS, *(2 * reader.window_ticks for reader in readers)]))
        self._bundle: list[Sent] = []
        self._bundled_from = 0
        window_ticks = dataflow.by_name[self.name].window_ticks
        self._progress_every_ticks = max(1, min(PROGRESS_EVERY_TICKS, window_ticks // _PROGRESS_WINDOW_SHARE))
        self._told_tick, self._told_at_s = -1, time.monotonic()

    @property
    def is_awaited(self) -> bool:
        """Whether anybody may wait for what it writes."""
        return bool(self.stepper.spec.writes)

    @property
    def last_tick(self) -> int:
        """The last tick that it has finished, -1 before the first."""
        return self.gate.next_tick - 1

    def reset(self, episode: Episode) -> list[Sent]:
        """Reset the core and return what it writes once."""
        return self.stepper.reset(episode)

    def may_step(self) -> bool:
        """Return whether the next step may happen now: its inputs are here, and its time has come."""
        return self.gate.may_step() and not self.early_s

    @property
    def early_s(self) -> float:
        """How long the next step has to wait for its time [s]; 0 where it need not, or has no time of its own."""
        return 0.0 if self._pace is None else self._pace.wait_s(self.gate.next_tick, time.monotonic())

    def go_on(self) -> None:
        """Keep, for readers that have missed them, the messages with which it goes on."""
        for sent in self.stepper.recent:
            if sent.port in self._ports_that_leave:
                self.kept.keep(sent)

    def step(self) -> list[Sent]:
        """Step the core once and return what it wrote; the verdict ends the run for the one who writes it too."""
        if self._pace is not None:
            self._pace.begins(self.gate.next_tick, time.monotonic())
        outputs = self.stepper.step()
        for sent in outputs:
            if isinstance(sent.message, Verdict):
                self.gate.final_tick = sent.message.tick
        return outputs

    def take_part_if_due(self) -> None:
        """Write what is kept of the state, after what was sent before."""
        if self._keeping is not None and self._keeping.is_due(self.stepper):
            self.flush()
            self._keeping.take_due([self.stepper])

    def work_ahead(self) -> bool:
        """Let the core do what it can without its inputs; return whether there was anything to do."""
        return self._works_ahead is not None and self._works_ahead.work_ahead()

    def missing_from_outside(self) -> list[Missing]:
        """Return what the next step needs from other processes."""
        return [missing for missing in self.gate.missing() if missing.port in self.outer_ports_read]

    # While a participant runs ahead its outputs travel in bundles; before it waits for anything they are on their way.
    def publish(self, outputs: list[Sent]) -> None:
        """Send messages to other processes, at the latest with the next `flush`."""
        leaving = [sent for sent in outputs if sent.port in self._ports_that_leave]
        for sent in leaving:
            self.kept.keep(sent)
        self._bundle += leaving
        if self.gate.next_tick - self._bundled_from >= BUNDLE_TICKS:
            self.flush()

    def flush(self) -> None:
        """Send what waits."""
        bundled = [(sent.port, sent.payload) for sent in self._bundle if control.fits_in_bundle(sent)]
        if bundled:
            self._bus.publish(self._bundle_key, control.pack_bundle(bundled))
        for sent in self._bundle:
            if control.travels_alone(sent):
                self._publish_alone(sent)
        self._bundle.clear()
        self._bundled_from = self.gate.next_tick

    # To nobody where nobody listens: Zenoh sends nothing that has no reader.
    def _publish_alone(self, sent: Sent) -> None:
        encoding, is_question = codec.encoding_of(type(sent.message)), sent.message.is_question
        self._bus.publish(sent.port, sent.payload, encoding=encoding, urgent=is_question)
        if is_question:
            self._bus.publish(control.question_key(sent.port), sent.payload, encoding=encoding, urgent=True)

    def tell_progress_if_due(self) -> None:
        """Tell now and then which tick is finished: writers count on it, and the supervisor."""
        n_ticks = self.last_tick - self._told_tick
        if n_ticks >= self._progress_every_ticks or time.monotonic() - self._told_at_s > PROGRESS_EVERY_S:
            self.tell_progress()

    def tell_progress(self) -> None:
        """Tell which tick is finished, unless that is known."""
        if self.last_tick > self._told_tick:
            self._told_tick, self._told_at_s = self.last_tick, time.monotonic()
            self._bus.publish(control.progress(self.name), control.TickNote(tick=self.last_tick).to_bytes())

    def tell_waiting(self) -> None:
        """Tell what it waits for."""
        note = control.WaitingNote(
            tick=self.gate.next_tick,
            missing=[(missing.port, missing.tick) for missing in self.gate.missing()],
            lacking_credit=self.gate.lacking_credit(),
        )
        self._bus.publish(control.waiting(self.name), note.to_bytes())

    # Who has missed how far its readers are, or did not live yet when they told it, would wait for ever.
    def ask_readers(self, put: Callable[[bytes], None]) -> None:
        """Ask those whose credit it lacks how far they are; `put` is told, on any thread."""
        for reader in self.gate.lacking_credit():
            if reader in self.outer_readers:
                self._bus.ask(control.finished(reader), b"", lambda _, payload: put(payload))

    def description(self) -> bytes:
        """Return what it is; may be called on any thread."""
        return control.Description(
            name=self.name,
            version=gslcosim.__version__,
            contract_hash=contract_hash(),
            pid=os.getpid(),
            host=socket.gethostname(),
        ).to_bytes()

    def finished(self) -> bytes:
        """Return the last tick it has finished, for a writer that has missed it; may be called on any thread."""
        return control.ReaderNote(name=self.name, tick=self.last_tick).to_bytes()

    def inspection(self) -> bytes:
        """Return how it goes, for somebody who looks; may be called on any thread."""
        return control.Inspection(
            name=self.name,
            tick=self.last_tick,
            is_finished=self.gate.is_finished,
            waits_for=list(self.gate.waits_for),
            queued_ticks=self.gate.n_queued_ticks,
            pid=os.getpid(),
            cpu_s=cpu_s(),
            memory_bytes=memory_bytes(),
            n_resends=self.stepper.timing.n_resends,
        ).to_bytes()

    def close(self) -> None:
        """Let the core write what it holds."""
        if isinstance(self._core, Closes):
            self._core.close()

    def say_goodbye(self) -> None:
        """Hand over the digests; said again until the supervisor has heard it."""
        bye = control.Bye(
            name=self.name,
            last_tick=self.last_tick,
            trails={port: trail.as_fields() for port, trail in self.stepper.trails.items()},
            timing=self.stepper.timing.as_fields(),
            account=self._account(),
        )
        self._bus.publish(control.bye(self.name), bye.to_bytes(), urgent=True)

    def _account(self) -> dict[str, Any]:
        own = dict(self._core.account()) if isinstance(self._core, Accounts) else {}
        return own | (self._pace.account() if self._pace else {})
