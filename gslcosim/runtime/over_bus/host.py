"""Hosts one core behind a bus: collects inputs, steps when allowed, publishes, repairs losses, says goodbye."""

import itertools
import os
import queue
import socket
import threading
import time
import traceback
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass, field

import gslcosim
from gslcosim.bus.port import Bus
from gslcosim.contract import codec
from gslcosim.contract.messages import Verdict
from gslcosim.contract.participant import Closes, Core, Episode
from gslcosim.contract.schema import contract_hash
from gslcosim.errors import ContractError, GslCosimError, RunTimeoutError
from gslcosim.runtime.dataflow import Dataflow
from gslcosim.runtime.gate import Missing
from gslcosim.runtime.over_bus import control
from gslcosim.runtime.stepper import Sent, Stepper

# And far less than the window of credit, so that nobody ever waits for a note that is not sent yet.
PROGRESS_EVERY_TICKS = 16
_PROGRESS_WINDOW_SHARE = 4
# A slow run shows that it moves.
PROGRESS_EVERY_S = 1.0
BUNDLE_TICKS = 16
KEPT_TICKS = 1024
RESENT_AT_ONCE = 32
FIRST_RESEND_AFTER_S = 0.2
LONGEST_RESEND_AFTER_S = 2.0
BYE_EVERY_S = 0.5
_Event = tuple[str, bytes]
_LOST_LINK = "link lost"


@dataclass
class Kept:
    """The last messages of each port, for readers that missed one; shared between two threads."""

    n_ticks: int = KEPT_TICKS
    _payloads: dict[str, OrderedDict[int, bytes]] = field(default_factory=dict[str, OrderedDict[int, bytes]])
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def keep(self, sent: Sent) -> None:
        """Remember a message and forget the oldest."""
        with self._lock:
            payloads = self._payloads.setdefault(sent.port, OrderedDict())
            payloads[sent.message.tick] = sent.payload
            if len(payloads) > self.n_ticks:
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


class ParticipantHost:
    """Runs one participant over a bus from joining to goodbye.

    `run` returns when the supervisor has dismissed the participant. It raises what the core raises, after telling the
    supervisor, and `RunTimeoutError` when the link to the router is lost.
    """

    def __init__(self, bus: Bus, core: Core, dataflow: Dataflow, episode: Episode) -> None:
        self._bus = bus
        self._core = core
        self._dataflow = dataflow
        self._episode = episode
        self._stepper = Stepper(core, dataflow)
        self._gate = self._stepper.gate
        self._name = self._stepper.spec.name
        self._ports_read = {read.port for read in self._stepper.spec.reads}
        self._events: queue.SimpleQueue[_Event] = queue.SimpleQueue()
        self._kept = Kept()
        window_ticks = self._stepper.spec.window_ticks
        self._progress_every_ticks = max(1, min(PROGRESS_EVERY_TICKS, window_ticks // _PROGRESS_WINDOW_SHARE))
        self._told_tick, self._told_at_s = -1, time.monotonic()
        self._once: list[Sent] = []
        self._bundle: list[Sent] = []
        self._bundled_from = 0
        self._handlers: dict[str, Callable[[bytes], object]] = {
            control.START: lambda _: self._set_started(),
            control.STOP: self._on_stop,
            control.CLOSE: lambda _: self._set_dismissed(),
            _LOST_LINK: lambda _: self._on_lost_link(),
        }
        self._is_started = False
        self._is_dismissed = False

    def join(self) -> None:
        """Reset the core, listen to everything it reads, and show that it is ready (last)."""
        self._once = self._stepper.reset(self._episode)
        for read in self._stepper.spec.reads:
            if control.is_for_agents(read.port):
                continue
            self._listen(read.port, lambda payload, port=read.port: self._on_input(port, payload))
        for writer in {self._dataflow.writer_of[read.port] for read in self._stepper.spec.reads}:
            self._listen(control.bundle(writer), self._on_bundle)
        for reader in self._dataflow.readers_of(self._name):
            self._listen(
                control.progress(reader.name), lambda payload, name=reader.name: self._on_progress(name, payload)
            )
        for key in (control.START, control.STOP, control.CLOSE):
            self._listen(key, self._handlers[key])
        self._bus.answer(control.resend(self._name), self._kept.answer)
        self._bus.answer(control.describe(self._name), lambda _: [self._description()])
        self._bus.declare_alive(control.alive(self._name))

    def link_lost(self) -> None:
        """Tell the host, from any thread, that the link to the router is gone."""
        self._events.put((_LOST_LINK, b""))

    def run(self) -> None:
        """Take part in the run from the start signal to the goodbye."""
        try:
            while not self._is_started and not self._is_dismissed:
                self._handle(self._events.get())
            if self._is_started:
                self._publish(self._once)
                self._fly()
                self._flush()
        except Exception as error:
            self._report(error)
            raise
        self._say_goodbye()

    def _fly(self) -> None:
        while not (self._gate.is_finished or self._is_dismissed):
            self._drain()
            if self._gate.may_step():
                self._publish(self._step())
                if self._is_progress_due():
                    self._tell_progress()
            else:
                self._flush()
                self._wait_for_input()

    # The verdict ends the run for the one who writes it too, whether or not the supervisor has it yet.
    def _step(self) -> list[Sent]:
        outputs = self._stepper.step()
        for sent in outputs:
            if isinstance(sent.message, Verdict):
                self._gate.final_tick = sent.message.tick
        return outputs

    def _drain(self) -> None:
        started = time.perf_counter_ns()
        while not self._events.empty():
            self._handle(self._events.get())
        self._stepper.timing.receiving_ns += time.perf_counter_ns() - started

    def _wait_for_input(self) -> None:
        started = time.perf_counter_ns()
        patience_s = FIRST_RESEND_AFTER_S
        while not (self._gate.may_step() or self._gate.is_finished or self._is_dismissed):
            lost = [missing for missing in self._gate.missing() if self._gate.has_later(missing)]
            if lost:
                self._ask_again(lost)
            try:
                self._handle(self._events.get(timeout=patience_s))
            except queue.Empty:
                self._tell_progress()
                self._ask_again(self._gate.missing())
                self._tell_waiting()
                patience_s = min(2 * patience_s, LONGEST_RESEND_AFTER_S)
        self._stepper.timing.waiting_ns += time.perf_counter_ns() - started

    def _ask_again(self, lost: list[Missing]) -> None:
        for missing in lost:
            writer = self._dataflow.writer_of[missing.port]
            question = control.ResendRequest(port=missing.port, tick=missing.tick).to_bytes()
            self._bus.ask(
                control.resend(writer), question, lambda _, payload, port=missing.port: self._on_resent(port, payload)
            )

    def _on_resent(self, port: str, payload: bytes) -> None:
        self._events.put((f"resent:{port}", payload))

    # While a participant runs ahead its outputs travel in bundles; before it waits for anything they are on their way.
    def _publish(self, outputs: list[Sent]) -> None:
        for sent in outputs:
            self._kept.keep(sent)
        self._bundle += outputs
        if self._gate.next_tick - self._bundled_from >= BUNDLE_TICKS:
            self._flush()

    def _flush(self) -> None:
        bundled = [(sent.port, sent.payload) for sent in self._bundle if control.fits_in_bundle(sent)]
        if bundled:
            self._bus.publish(control.bundle(self._name), control.pack_bundle(bundled))
        for sent in self._bundle:
            if control.travels_alone(sent):
                self._publish_alone(sent)
        self._bundle.clear()
        self._bundled_from = self._gate.next_tick

    # To nobody where nobody listens: Zenoh sends nothing that has no reader.
    def _publish_alone(self, sent: Sent) -> None:
        encoding, is_question = codec.encoding_of(type(sent.message)), sent.message.is_question
        self._bus.publish(sent.port, sent.payload, encoding=encoding, urgent=is_question)
        if is_question:
            self._bus.publish(control.question_key(sent.port), sent.payload, encoding=encoding, urgent=True)

    def _is_progress_due(self) -> bool:
        n_ticks = self._gate.next_tick - 1 - self._told_tick
        return n_ticks >= self._progress_every_ticks or time.monotonic() - self._told_at_s > PROGRESS_EVERY_S

    def _tell_progress(self) -> None:
        tick = self._gate.next_tick - 1
        if tick > self._told_tick:
            self._told_tick, self._told_at_s = tick, time.monotonic()
            self._bus.publish(control.progress(self._name), control.TickNote(tick=tick).to_bytes())

    def _tell_waiting(self) -> None:
        note = control.WaitingNote(
            tick=self._gate.next_tick,
            missing=[(missing.port, missing.tick) for missing in self._gate.missing()],
            lacking_credit=self._gate.lacking_credit(),
        )
        self._bus.publish(control.waiting(self._name), note.to_bytes())

    def _report(self, error: Exception) -> None:
        text = str(error) if isinstance(error, GslCosimError) else "".join(traceback.format_exception(error))
        note = control.FaultNote(participant=self._name, tick=self._gate.next_tick - 1, text=text)
        self._bus.publish(control.FAULT, note.to_bytes(), urgent=True)

    def _say_goodbye(self) -> None:
        if isinstance(self._core, Closes):
            self._core.close()
        self._tell_progress()
        trails = {port: trail.as_fields() for port, trail in self._stepper.trails.items()}
        bye = control.Bye(
            name=self._name,
            last_tick=self._gate.next_tick - 1,
            trails=trails,
            timing=self._stepper.timing.as_fields(),
        ).to_bytes()
        while not self._is_dismissed:
            self._bus.publish(control.bye(self._name), bye, urgent=True)
            resend_at = time.monotonic() + BYE_EVERY_S
            while not self._is_dismissed and (left_s := resend_at - time.monotonic()) > 0:
                try:
                    self._handle(self._events.get(timeout=left_s))
                except queue.Empty:
                    break

    def _listen(self, key: str, handler: Callable[[bytes], object]) -> None:
        self._handlers[key] = handler
        self._bus.subscribe(key, lambda at, payload: self._events.put((at, payload)))

    def _handle(self, event: _Event) -> None:
        key, payload = event
        if key.startswith("resent:"):
            port = key.removeprefix("resent:")
            self._stepper.timing.n_resends += self._on_input(port, payload)
        else:
            self._handlers[key](payload)

    def _on_input(self, port: str, payload: bytes) -> bool:
        message = codec.decode(self._dataflow.message_types[port], payload)
        return self._gate.deliver(port, message)

    def _on_bundle(self, payload: bytes) -> None:
        for port, message in control.unpack_bundle(payload):
            if port in self._ports_read:
                self._on_input(port, message)

    def _on_progress(self, reader: str, payload: bytes) -> None:
        self._gate.grant(reader, control.TickNote.from_bytes(payload).tick)

    def _on_stop(self, payload: bytes) -> None:
        self._gate.final_tick = control.TickNote.from_bytes(payload).tick

    def _on_lost_link(self) -> None:
        raise RunTimeoutError(f"{self._name}: the link to the run's router was lost; the supervisor may have ended.")

    def _set_started(self) -> None:
        self._is_started = True

    def _set_dismissed(self) -> None:
        self._is_dismissed = True

    def _description(self) -> bytes:
        return control.Description(
            name=self._name,
            version=gslcosim.__version__,
            contract_hash=contract_hash(),
            pid=os.getpid(),
            host=socket.gethostname(),
        ).to_bytes()
