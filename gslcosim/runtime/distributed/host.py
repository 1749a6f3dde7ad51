"""Host of the cores of a process behind a bus: collects inputs, steps when allowed, publishes, repairs losses."""

import contextlib
import os
import queue
import socket
import time
import traceback
from collections.abc import Callable, Collection, Sequence
from dataclasses import asdict
from functools import partial
from typing import Any

import gslcosim
from gslcosim.base.errors import RunTimeoutError, format_fault
from gslcosim.bus.interface import Bus
from gslcosim.contract import codec, keys
from gslcosim.contract.messages import Message
from gslcosim.contract.participant import Core, Episode
from gslcosim.contract.version import CONTRACT_HASH
from gslcosim.runtime.dataflow import Dataflow
from gslcosim.runtime.distributed import protocol
from gslcosim.runtime.distributed.retransmission import RETRANSMIT_TICKS, RetransmitBuffer
from gslcosim.runtime.stepper import ClockPace, MissingInput, SentMessage, SnapshotPolicy, StepLoop, Stepper

# Links between services may come up later than those to the router. A reader that comes after that requests the
# messages that it has missed.
SUBSCRIBER_TIMEOUT_S = 5.0
# Far less than the window of credit, so that no writer waits for a report that is not sent yet.
PROGRESS_PERIOD_TICKS = 64
_PROGRESS_WINDOW_DIVISOR = 4
# A slow run shows that it moves.
PROGRESS_PERIOD_S = 1.0
BUNDLE_TICKS = 64
MIN_RESEND_AFTER_S = 0.2
MAX_RESEND_AFTER_S = 2.0
FINAL_REPORT_PERIOD_S = 0.5
_LINK_LOST = "link lost"
_READER_REPORTED = "reader told"
_READER_CONNECTED = "reader came"


def report_fault(bus: Bus, participant: str, error: Exception, *, tick: int) -> None:
    """Report to the supervisor the error that has ended a participant."""
    text = format_fault(error, "".join(traceback.format_exception(error)))
    note = protocol.FaultReport(participant=participant, tick=tick, text=text[-protocol.MAX_TEXT :])
    bus.publish(protocol.FAULT_KEY, note.to_bytes(), urgent=True)


class ParticipantLink:
    """Link of one participant to the bus: its outputs, and its answers to the others' queries.

    Args:
        neighbours: The participants of its process; messages that only they read do not travel.
        extra_ticks: Further ticks for which messages are kept for readers that missed them.
    """

    def __init__(
        self,
        bus: Bus,
        stepper: Stepper,
        dataflow: Dataflow,
        neighbours: Collection[str],
        extra_ticks: int,
        summarize: Callable[[], dict[str, Any]],
    ) -> None:
        self._bus = bus
        self._summarize = summarize
        self.stepper = stepper
        self.gate = stepper.gate
        spec, self.name = stepper.spec, stepper.spec.name
        self.outer_ports_read = {read.port for read in spec.reads if dataflow.writer_of[read.port] not in neighbours}
        readers = dataflow.readers_of[self.name]
        outer_readers = [reader for reader in readers if reader.name not in neighbours]
        self.outer_readers = {reader.name for reader in outer_readers}
        self._bundle_key = protocol.build_bundle_key(self.name, self.outer_readers)
        # Agents and the supervisor read theirs from every process.
        read_outside = {keys.VERDICT, *(read.port for reader in outer_readers for read in reader.reads)}
        self._ports_that_leave = {
            write.port for write in spec.writes if protocol.is_read_by_agents(write.port) or write.port in read_outside
        }
        # A reader that misses a message is at most a window behind, and requests it before its writer is another ahead.
        self.kept = RetransmitBuffer(
            extra_ticks + max([RETRANSMIT_TICKS, *(2 * reader.window_ticks for reader in readers)])
        )
        self._bundle: list[SentMessage] = []
        self._bundled_from = 0
        window_ticks = dataflow.by_name[self.name].window_ticks
        self._progress_every_ticks = max(1, min(PROGRESS_PERIOD_TICKS, window_ticks // _PROGRESS_WINDOW_DIVISOR))
        self._reported_tick, self._reported_at_s = -1, time.monotonic()

    @property
    def is_awaited(self) -> bool:
        """True when a participant may wait for its outputs."""
        return bool(self.stepper.spec.writes)

    @property
    def last_tick(self) -> int:
        """The last tick that it has finished, -1 before the first."""
        return self.gate.next_tick - 1

    def go_on(self) -> None:
        """Keep, for readers that have missed them, the messages with which it goes on."""
        for sent in self.stepper.recent:
            if sent.port in self._ports_that_leave:
                self.kept.keep(sent)

    # While a participant runs ahead its outputs travel in bundles; before it waits for anything they are on their way.
    def publish(self, outputs: list[SentMessage]) -> None:
        """Send messages to other processes, at the latest with the next `flush`."""
        leaving = [sent for sent in outputs if sent.port in self._ports_that_leave]
        for sent in leaving:
            self.kept.keep(sent)
        self._bundle += leaving
        if self.gate.next_tick - self._bundled_from >= BUNDLE_TICKS:
            self.flush()

    def flush(self) -> None:
        """Send what waits."""
        # A large message travels on its own key, as do those to agents: a bundle also goes to others than its readers.
        bundled: list[tuple[str, bytes]] = []
        alone: list[SentMessage] = []
        for sent in self._bundle:
            is_large, is_to_agent = len(sent.payload) > protocol.LARGE_BYTES, protocol.is_read_by_agents(sent.port)
            if is_to_agent or not is_large:
                bundled.append((sent.port, sent.payload))
            if is_to_agent or is_large:
                alone.append(sent)
        if bundled:
            self._bus.publish(self._bundle_key, protocol.pack_bundle(bundled))
        for sent in alone:
            # Zenoh sends nothing that has no reader.
            encoding, is_question = codec.get_encoding(type(sent.message)), sent.message.is_question
            self._bus.publish(sent.port, sent.payload, encoding=encoding, urgent=is_question)
            if is_question:
                key = keys.question(sent.port.split("/")[1])
                self._bus.publish(key, sent.payload, encoding=encoding, urgent=True)
        self._bundle.clear()
        self._bundled_from = self.gate.next_tick

    def report_progress_if_due(self) -> None:
        """Report the finished tick now and then, on which writers and the supervisor rely."""
        n_ticks = self.last_tick - self._reported_tick
        if n_ticks >= self._progress_every_ticks or time.monotonic() - self._reported_at_s > PROGRESS_PERIOD_S:
            self.report_progress()

    def report_progress(self) -> None:
        """Report which tick is finished, unless that is known."""
        if self.last_tick > self._reported_tick:
            self._reported_tick, self._reported_at_s = self.last_tick, time.monotonic()
            self._bus.publish(
                protocol.build_progress_key(self.name), protocol.TickReport(tick=self.last_tick).to_bytes()
            )

    # A writer that has missed its readers' reports, or began after them, would wait for ever.
    def query_readers(self, put: Callable[[bytes], None]) -> None:
        """Query the readers whose credit it lacks for their tick; `put` is called, on any thread."""
        for reader in self.gate.lacking_credit():
            if reader in self.outer_readers:
                self._bus.ask(protocol.build_finished_key(reader), b"", lambda _, payload: put(payload))

    def description(self) -> bytes:
        """Return the participant's description; may be called on any thread."""
        return protocol.ParticipantDescription(
            name=self.name,
            version=gslcosim.__version__,
            contract_hash=CONTRACT_HASH,
            pid=os.getpid(),
            host=socket.gethostname(),
        ).to_bytes()

    def finished(self) -> bytes:
        """Return the last tick it has finished, for a writer that has missed it; may be called on any thread."""
        return protocol.ReaderReport(name=self.name, tick=self.last_tick).to_bytes()

    def inspection(self) -> bytes:
        """Return the participant's status; may be called on any thread."""
        return protocol.ParticipantInspection(**asdict(self.stepper.look())).to_bytes()

    def send_final_report(self) -> None:
        """Send the final report with the digests; sent again until the supervisor has it."""
        report = protocol.FinalReport(
            name=self.name,
            last_tick=self.last_tick,
            trails={port: trail.as_fields() for port, trail in self.stepper.trails.items()},
            timing=vars(self.stepper.timing),
            summary=self._summarize(),
        )
        self._bus.publish(protocol.build_final_report_key(self.name), report.to_bytes(), urgent=True)


class Host:
    """Host of the participants of a process on a bus, from joining to the final report: mostly one, or a group.

    Their messages for each other are handed over as they are; the rest travels. `run` returns when the supervisor has
    dismissed them. It raises what a core raises, after reporting to the supervisor, and `RunTimeoutError` when the
    link to the router is lost.
    """

    def __init__(
        self,
        bus: Bus,
        cores: Sequence[Core],
        dataflow: Dataflow,
        episode: Episode,
        pace: ClockPace | None = None,
        policy: SnapshotPolicy | None = None,
    ) -> None:
        """Prepare to host cores, from upstream to downstream, each of a participant of its own; see `StepLoop`."""
        self._bus = bus
        self._dataflow = dataflow
        self._episode = episode
        names = {core.spec.name for core in cores}
        self._loop = StepLoop(cores, dataflow, self, is_whole_run=False, pace=pace, policy=policy)
        extra_ticks = 0 if policy is None else policy.extra_retained_ticks
        self._links = [
            ParticipantLink(bus, stepper, dataflow, names, extra_ticks, partial(self._loop.summarize, stepper))
            for stepper in self._loop.steppers
        ]
        self._link_of = {link.name: link for link in self._links}
        # A process of one participant is woken by what it waits for most, without a callback between.
        self._events = bus.mailbox(
            protocol.build_incoming_bundles_key(self._links[0].name) if len(names) == 1 else None
        )
        self._once: list[tuple[Stepper, list[SentMessage]]] = []
        # Receiving and waiting are the process's: they are counted for its first participant.
        self._timing = self._links[0].stepper.timing
        self._handlers: dict[str, Callable[[bytes], object]] = {
            protocol.START_KEY: self._on_start,
            protocol.STOP_KEY: lambda payload: self._loop.end_at(protocol.TickReport.from_bytes(payload).tick),
            protocol.CLOSE_KEY: self._on_close,
            _LINK_LOST: self._on_lost_link,
            _READER_REPORTED: self._on_reader_report,
            _READER_CONNECTED: lambda payload: self._absent.discard(payload.decode()),
        }
        self._outer_readers = set[str]().union(*(link.outer_readers for link in self._links))
        # Readers that are not connected yet; agents get messages from their sessions, which are there already.
        self._absent = {
            name
            for name in self._outer_readers
            if not all(protocol.is_read_by_agents(read.port) for read in dataflow.by_name[name].reads)
        }
        self._is_started = False
        self._is_dismissed = False
        self._has_said_goodbye = False
        self._was_resent = False
        self._asked: set[MissingInput] = set()
        self._is_restarted = policy is not None and policy.is_restarting
        self._failure: Exception | None = None
        self._failed_after_tick = 0

    def join(self) -> None:
        """Reset the cores, listen to everything they read from elsewhere, and show that they are ready.

        Participants that only read are reset last: no other waits for them, and messages wait for them. Beside one that
        others wait for, every reset has to come before the first tick.
        """
        is_awaited = any(link.is_awaited for link in self._links)
        if is_awaited:
            self._reset()
        ports = sorted(set[str]().union(*(link.outer_ports_read for link in self._links)))
        for port in ports:
            if not protocol.is_read_by_agents(port):
                self._listen(port, lambda payload, port=port: self._on_input(port, payload))
        for writer in sorted({self._dataflow.writer_of[port] for port in ports if len(self._links) > 1}):
            self._bus.subscribe(protocol.build_outgoing_bundles_key(writer), self._events.put)
        for reader in sorted(self._outer_readers):
            self._listen(
                protocol.build_progress_key(reader),
                lambda payload, name=reader: self._loop.grant(name, protocol.TickReport.from_bytes(payload).tick),
            )
        for name in sorted(self._absent):
            self._bus.watch_alive(protocol.build_liveliness_key(name), partial(self._on_liveliness, name))
        for key in (protocol.START_KEY, protocol.STOP_KEY, protocol.CLOSE_KEY):
            self._listen(key, self._handlers[key])
        for link in self._links:
            self._bus.answer(protocol.build_resend_key(link.name), link.kept.answer)
            self._bus.answer(protocol.build_description_key(link.name), lambda _, link=link: [link.description()])
            self._bus.answer(protocol.build_finished_key(link.name), lambda _, link=link: [link.finished()])
            self._bus.answer(protocol.build_inspection_key(link.name), lambda _, link=link: [link.inspection()])
        for link in self._links:
            self._bus.declare_alive(protocol.build_liveliness_key(link.name))
        if not is_awaited:
            self._reset()

    # On any thread.
    def _on_liveliness(self, reader: str, _: str, is_alive: bool) -> None:  # noqa: FBT001 - the interface of the bus
        if is_alive:
            self._events.put(_READER_CONNECTED, reader.encode())

    def on_link_lost(self) -> None:
        """Notify the host, from any thread, that the link to the router is gone."""
        self._events.put(_LINK_LOST, b"")

    def run(self) -> None:
        """Take part in the run from the start signal to the final report."""
        try:
            while not self._is_started and not self._is_dismissed:
                self._handle(self._events.get())
            deadline_s = time.monotonic() + SUBSCRIBER_TIMEOUT_S
            while not self._is_dismissed and self._absent and (left_s := deadline_s - time.monotonic()) > 0:
                with contextlib.suppress(queue.Empty):
                    self._handle(self._events.get(left_s))
            if self._is_started:
                for stepper, outputs in self._once:
                    self._loop.pass_on(stepper, outputs)
                self._fly()
                self._flush()
            self._shut_down()
        except Exception as error:
            self._report(error)
            raise
        # A verdict before that is the end of the run.
        if self._failure is not None and self._links[0].gate.final_tick == self._failed_after_tick:
            raise self._failure

    def _reset(self) -> None:
        try:
            self._once = list(self._loop.reset(self._episode))
            self._loop.resume()
            for link in self._links:
                link.go_on()
        except Exception as error:
            self._report(error)
            raise

    @property
    def last_tick(self) -> int:
        """The last tick that all its participants have finished, -1 before the first."""
        return self._loop.last_tick

    @property
    def is_whole(self) -> bool:
        """True when all its participants have come to the end of the run."""
        return self._loop.is_finished

    @property
    def n_resends(self) -> int:
        """Number of messages it had to ask for again."""
        return self._timing.n_resends

    @property
    def _are_finished(self) -> bool:
        return self._is_dismissed or self._loop.is_finished

    def _fly(self) -> None:
        while not self._are_finished:
            started = time.perf_counter_ns()
            while (event := self._events.get_nowait()) is not None:
                self._handle(event)
            self._timing.receiving_ns += time.perf_counter_ns() - started
            if not self._step():
                self._flush()
                self._wait_for_input()

    # Others may be behind the one that fails, and all ticks before that are part of the run.
    def _step(self) -> bool:
        try:
            return self._loop.step()
        except Exception as error:
            last_tick = self._loop.acting.gate.next_tick - 2
            if self._is_restarted or last_tick < 0:
                raise
            self._failure, self._failed_after_tick = error, last_tick
            self._report(error)
            self._loop.end_at(last_tick)
            return True

    def on_outputs(self, stepper: Stepper, outputs: list[SentMessage]) -> None:
        """Send what leaves the process, at the latest with the next flush; see `StepListener`."""
        self._link_of[stepper.spec.name].publish(outputs)

    def before_snapshot(self, stepper: Stepper) -> None:
        """Send what waits; see `StepListener`."""
        self._link_of[stepper.spec.name].flush()

    def after_step(self, stepper: Stepper) -> None:
        """Report now and then how far the participant is; see `StepListener`."""
        self._link_of[stepper.spec.name].report_progress_if_due()

    def _flush(self) -> None:
        for link in self._links:
            link.flush()

    def _wait_for_input(self) -> None:
        started = time.perf_counter_ns()
        patience_s = MIN_RESEND_AFTER_S
        ask_at_s = time.monotonic() + patience_s
        self._asked.clear()
        if self._was_resent:
            # After one missing message the next most likely is missing, too, while a participant catches up.
            self._was_resent = False
            for link in self._links:
                self._ask_again(link, only_lost=False)
        # None could step just now; where only the clock held one back, that may have changed.
        is_known_to_wait = not self._loop.is_paced
        while not self._are_finished and (is_known_to_wait or not self._loop.can_any_step()):
            is_known_to_wait = False
            # However much else arrives meanwhile: it may be about anything but what is missing.
            if time.monotonic() >= ask_at_s and not self._loop.pace_wait_s:
                self._ask_for_all_missing()
                patience_s = min(2 * patience_s, MAX_RESEND_AFTER_S)
                ask_at_s = time.monotonic() + patience_s
            for link in self._links:
                if link.gate.has_waiting_inputs:
                    self._ask_again(link, only_lost=True)
            event = self._events.get_nowait()
            while event is None and self._loop.prefetch():
                event = self._events.get_nowait()
            if event is None:
                with contextlib.suppress(queue.Empty):
                    event = self._events.get(self._loop.pace_wait_s or patience_s)
            if event is not None:
                self._handle(event)
        self._timing.waiting_ns += time.perf_counter_ns() - started

    def _ask_for_all_missing(self) -> None:
        self._asked.clear()
        for link in self._links:
            link.report_progress()
            self._ask_again(link, only_lost=False)
            link.query_readers(lambda payload: self._events.put(_READER_REPORTED, payload))

    # A message that later ones of its port have overtaken is lost for sure; after a while any may be.
    def _ask_again(self, link: ParticipantLink, *, only_lost: bool) -> None:
        # Messages of other processes.
        for missing in (each for each in link.gate.missing() if each.port in link.outer_ports_read):
            if missing in self._asked or (only_lost and not link.gate.has_later(missing)):
                continue
            # Once in a while: each answer brings many messages, and each of them would ask again.
            self._asked.add(missing)
            writer = self._dataflow.writer_of[missing.port]
            question = protocol.ResendRequest(port=missing.port, tick=missing.tick).to_bytes()
            self._bus.ask(
                protocol.build_resend_key(writer),
                question,
                lambda _, payload, port=missing.port: self._events.put(f"resent:{port}", payload),
            )

    def _on_reader_report(self, payload: bytes) -> None:
        report = protocol.ReaderReport.from_bytes(payload)
        self._loop.grant(report.name, report.tick)

    def _report(self, error: Exception) -> None:
        acting = self._loop.acting
        # Its gate is beyond the tick that it was in.
        report_fault(self._bus, acting.spec.name, error, tick=max(0, acting.gate.next_tick - 2))

    def _shut_down(self) -> None:
        for link in self._links:
            try:
                self._loop.close(link.stepper)
            except Exception:
                if self._failure is None:
                    raise
            link.report_progress()
        while not self._is_dismissed:
            for link in self._links:
                link.send_final_report()
            self._has_said_goodbye = True
            resend_at = time.monotonic() + FINAL_REPORT_PERIOD_S
            while not self._is_dismissed and (left_s := resend_at - time.monotonic()) > 0:
                try:
                    self._handle(self._events.get(left_s))
                except queue.Empty:
                    break

    def _listen(self, key: str, handler: Callable[[bytes], object]) -> None:
        self._handlers[key] = handler
        self._bus.subscribe(key, self._events.put)

    def _handle(self, event: tuple[str, bytes]) -> None:
        key, payload = event
        if key.startswith("resent:"):
            is_new = self._on_input(key.removeprefix("resent:"), payload)
            self._timing.n_resends += is_new
            self._was_resent = self._was_resent or is_new
        elif key.startswith(protocol.BUNDLE_PREFIX):
            for port, message in protocol.unpack_bundle(payload):
                if self._loop.reads(port):
                    self._on_input(port, message)
        else:
            self._handlers[key](payload)

    def _on_input(self, port: str, payload: bytes) -> bool:
        message: Message = codec.decode_trusted(self._dataflow.message_types[port], payload)
        return self._loop.deliver(port, message)

    def _on_lost_link(self, _: bytes) -> None:
        if self._has_said_goodbye:
            # On a bad link the dismissal may be lost; no other process needs this one any more.
            self._is_dismissed = True
            return
        raise RunTimeoutError(
            f"{self._loop.acting.spec.name}: the link to the run's router was lost; the supervisor may have ended."
        )

    def _on_start(self, _: bytes) -> None:
        self._is_started = True

    def _on_close(self, _: bytes) -> None:
        self._is_dismissed = True
