"""Hosts the cores of a process behind a bus: collects inputs, steps when allowed, publishes, repairs losses."""

import contextlib
import queue
import time
from collections.abc import Callable, Sequence

from gslcosim.bus.port import Bus
from gslcosim.contract import codec
from gslcosim.contract.messages import Message
from gslcosim.contract.participant import Core, Episode
from gslcosim.errors import RunTimeoutError
from gslcosim.runtime.clock_pace import PACED, ClockPace
from gslcosim.runtime.dataflow import Dataflow
from gslcosim.runtime.gate import Missing
from gslcosim.runtime.over_bus import control
from gslcosim.runtime.over_bus.absent_readers import AbsentReaders
from gslcosim.runtime.over_bus.fault_telling import tell_fault
from gslcosim.runtime.over_bus.hosted import Hosted
from gslcosim.runtime.snapshots.taking import Keeping
from gslcosim.runtime.stepper import Sent

FIRST_RESEND_AFTER_S = 0.2
LONGEST_RESEND_AFTER_S = 2.0
BYE_EVERY_S = 0.5
_LOST_LINK = "link lost"
_READER_TOLD = "reader told"
_READER_CAME = "reader came"


class Host:
    """Runs the participants of a process over a bus from joining to goodbye: mostly one, or a group.

    What they write for each other is handed over as it is; the rest travels. `run` returns when the supervisor has
    dismissed them. It raises what a core raises, after telling the supervisor, and `RunTimeoutError` when the link to
    the router is lost.
    """

    def __init__(
        self,
        bus: Bus,
        cores: Sequence[Core],
        dataflow: Dataflow,
        episode: Episode,
        pace: ClockPace | None = None,
        keeping: Keeping | None = None,
    ) -> None:
        """Prepare to host cores, each of a participant of its own.

        Args:
            bus: The process's connection.
            cores: From upstream to downstream.
            dataflow: Of the whole run.
            episode: What is flown.
            pace: Holds the ticks of `PACED` back, if anything does.
            keeping: What is kept of the run's state; absent: nothing.
        """
        self._bus = bus
        self._dataflow = dataflow
        self._episode = episode
        names = {core.spec.name for core in cores}
        self._hosted = [
            Hosted(bus, core, dataflow, names, pace if core.spec.name == PACED else None, keeping) for core in cores
        ]
        self._is_paced = pace is not None
        self._keeping = keeping
        self._readers = {
            port: [hosted for hosted in self._hosted if port in hosted.ports_read] for port in dataflow.writer_of
        }
        # A process of one participant is woken by what it waits for most, without a callback between.
        self._events = bus.mailbox(control.bundles_for(self._hosted[0].name) if len(names) == 1 else None)
        self._once: list[tuple[Hosted, list[Sent]]] = []
        # Who is at fault where something goes wrong now.
        self._acting = self._hosted[0]
        # Receiving and waiting are the process's: they are counted for its first participant.
        self._timing = self._hosted[0].stepper.timing
        self._handlers: dict[str, Callable[[bytes], object]] = {
            control.START: lambda _: self._set_started(),
            control.STOP: self._on_stop,
            control.CLOSE: lambda _: self._set_dismissed(),
            _LOST_LINK: lambda _: self._on_lost_link(),
            _READER_TOLD: self._on_reader_told,
            _READER_CAME: lambda payload: self._absent.came(payload.decode()),
        }
        self._outer_readers = set[str]().union(*(hosted.outer_readers for hosted in self._hosted))
        self._absent = AbsentReaders(self._outer_readers, dataflow)
        self._is_started = False
        self._is_dismissed = False
        self._has_end = False
        self._has_said_goodbye = False
        self._was_resent = False
        self._asked: set[Missing] = set()

    def join(self) -> None:
        """Reset the cores, listen to everything they read from elsewhere, and show that they are ready.

        Those that only read are reset last: nobody waits for what they write, and messages wait for them.
        """
        awaited = [hosted for hosted in self._hosted if hosted.is_awaited]
        self._reset(awaited)
        ports = sorted(set[str]().union(*(hosted.outer_ports_read for hosted in self._hosted)))
        for port in ports:
            if not control.is_for_agents(port):
                self._listen(port, lambda payload, port=port: self._on_input(port, payload))
        for writer in sorted({self._dataflow.writer_of[port] for port in ports if len(self._hosted) > 1}):
            self._bus.subscribe(control.bundles_of(writer), self._events.put)
        for reader in sorted(self._outer_readers):
            self._listen(control.progress(reader), lambda payload, name=reader: self._on_progress(name, payload))
        self._absent.watch(self._bus, lambda name: self._events.put(_READER_CAME, name.encode()))
        for key in (control.START, control.STOP, control.CLOSE):
            self._listen(key, self._handlers[key])
        for hosted in self._hosted:
            self._bus.answer(control.resend(hosted.name), hosted.kept.answer)
            self._bus.answer(control.describe(hosted.name), lambda _, hosted=hosted: [hosted.description()])
            self._bus.answer(control.finished(hosted.name), lambda _, hosted=hosted: [hosted.finished()])
            self._bus.answer(control.inspect(hosted.name), lambda _, hosted=hosted: [hosted.inspection()])
        for hosted in self._hosted:
            self._bus.declare_alive(control.alive(hosted.name))
        self._reset([hosted for hosted in self._hosted if hosted not in awaited])

    def link_lost(self) -> None:
        """Tell the host, from any thread, that the link to the router is gone."""
        self._events.put(_LOST_LINK, b"")

    def run(self) -> None:
        """Take part in the run from the start signal to the goodbye."""
        try:
            while not self._is_started and not self._is_dismissed:
                self._handle(self._events.get())
            while not self._is_dismissed and (left_s := self._absent.left_s(time.monotonic())) > 0:
                with contextlib.suppress(queue.Empty):
                    self._handle(self._events.get(left_s))
            if self._is_started:
                for hosted, outputs in self._once:
                    self._pass_on(hosted, outputs)
                self._fly()
                self._flush()
            self._say_goodbye()
        except Exception as error:
            self._report(error)
            raise

    def _reset(self, several: Sequence[Hosted]) -> None:
        try:
            for hosted in several:
                self._acting = hosted
                self._once.append((hosted, hosted.reset(self._episode)))
            if self._keeping is not None:
                self._keeping.go_on([hosted.stepper for hosted in several], self._dataflow)
                for hosted in several:
                    hosted.go_on()
        except Exception as error:
            self._report(error)
            raise

    @property
    def last_tick(self) -> int:
        """The last tick that all its participants have finished, -1 before the first."""
        return min(hosted.last_tick for hosted in self._hosted)

    @property
    def is_whole(self) -> bool:
        """Whether all its participants have come to the end of the run."""
        return self._has_end and all(hosted.gate.is_finished for hosted in self._hosted)

    @property
    def n_resends(self) -> int:
        """How many messages it had to ask for again."""
        return self._timing.n_resends

    @property
    def _are_finished(self) -> bool:
        return self._is_dismissed or (self._has_end and all(hosted.gate.is_finished for hosted in self._hosted))

    def _fly(self) -> None:
        while not self._are_finished:
            self._drain()
            if not self._step_those_that_may():
                self._flush()
                self._wait_for_input()

    # A tick each, in the order of the dataflow, so that what one writes is still warm when the next reads it.
    def _step_those_that_may(self) -> bool:
        has_stepped = False
        for hosted in self._hosted:
            if hosted.may_step():
                self._acting = hosted
                self._pass_on(hosted, hosted.step())
                hosted.take_part_if_due()
                hosted.tell_progress_if_due()
                has_stepped = True
        return has_stepped

    def _pass_on(self, hosted: Hosted, outputs: list[Sent]) -> None:
        for sent in outputs:
            for reader in self._readers[sent.port]:
                reader.gate.deliver(sent.port, sent.message)
        for other in self._hosted:
            if other is not hosted:
                other.gate.grant(hosted.name, hosted.last_tick)
                if hosted.gate.final_tick is not None:
                    other.gate.final_tick = hosted.gate.final_tick
        self._has_end = self._has_end or hosted.gate.final_tick is not None
        hosted.publish(outputs)

    def _drain(self) -> None:
        started = time.perf_counter_ns()
        while (event := self._events.get_nowait()) is not None:
            self._handle(event)
        self._timing.receiving_ns += time.perf_counter_ns() - started

    def _flush(self) -> None:
        for hosted in self._hosted:
            hosted.flush()

    def _wait_for_input(self) -> None:
        started = time.perf_counter_ns()
        patience_s = FIRST_RESEND_AFTER_S
        self._asked.clear()
        if self._was_resent:
            # Where one was missing the next most likely is, too: whoever catches up waits for nothing else.
            self._was_resent = False
            for hosted in self._hosted:
                self._ask_again(hosted, only_lost=False)
        # Nobody could step just now; where time alone is waited for, that may have changed.
        is_known_to_wait = not self._is_paced
        while not self._are_finished and (is_known_to_wait or not any(hosted.may_step() for hosted in self._hosted)):
            is_known_to_wait = False
            for hosted in self._hosted:
                if hosted.gate.holds_any:
                    self._ask_again(hosted, only_lost=True)
            event = self._events.get_nowait()
            while event is None and self._work_ahead():
                event = self._events.get_nowait()
            early_s = self._early_s() if self._is_paced else 0.0
            try:
                self._handle(event or self._events.get(early_s or patience_s))
            except queue.Empty:
                if early_s:
                    continue
                self._asked.clear()
                for hosted in self._hosted:
                    hosted.tell_progress()
                    self._ask_again(hosted, only_lost=False)
                    hosted.ask_readers(lambda payload: self._events.put(_READER_TOLD, payload))
                    hosted.tell_waiting()
                patience_s = min(2 * patience_s, LONGEST_RESEND_AFTER_S)
        self._timing.waiting_ns += time.perf_counter_ns() - started

    # Whose inputs are here waits for its time alone, and everybody for it.
    def _early_s(self) -> float:
        return max((hosted.early_s for hosted in self._hosted if hosted.gate.may_step()), default=0.0)

    def _work_ahead(self) -> bool:
        for hosted in self._hosted:
            self._acting = hosted
            if hosted.work_ahead():
                return True
        return False

    # What later messages of the same port have overtaken is lost for sure; after a while anything may be.
    def _ask_again(self, hosted: Hosted, *, only_lost: bool) -> None:
        for missing in hosted.missing_from_outside():
            if missing in self._asked or (only_lost and not hosted.gate.has_later(missing)):
                continue
            # Once in a while: each answer brings many messages, and each of them would ask again.
            self._asked.add(missing)
            writer = self._dataflow.writer_of[missing.port]
            question = control.ResendRequest(port=missing.port, tick=missing.tick).to_bytes()
            self._bus.ask(
                control.resend(writer), question, lambda _, payload, port=missing.port: self._on_resent(port, payload)
            )

    def _on_reader_told(self, payload: bytes) -> None:
        note = control.ReaderNote.from_bytes(payload)
        for hosted in self._hosted:
            hosted.gate.grant(note.name, note.tick)

    def _on_resent(self, port: str, payload: bytes) -> None:
        self._events.put(f"resent:{port}", payload)

    def _report(self, error: Exception) -> None:
        tell_fault(self._bus, self._acting.name, error, tick=self._acting.last_tick)

    def _say_goodbye(self) -> None:
        for hosted in self._hosted:
            self._acting = hosted
            hosted.close()
            hosted.tell_progress()
        while not self._is_dismissed:
            for hosted in self._hosted:
                hosted.say_goodbye()
            self._has_said_goodbye = True
            resend_at = time.monotonic() + BYE_EVERY_S
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
        elif key.startswith(control.BUNDLES):
            self._on_bundle(payload)
        else:
            self._handlers[key](payload)

    def _on_input(self, port: str, payload: bytes) -> bool:
        message: Message = codec.decode_trusted(self._dataflow.message_types[port], payload)
        is_new = [reader.gate.deliver(port, message) for reader in self._readers[port]]
        return any(is_new)

    def _on_bundle(self, payload: bytes) -> None:
        for port, message in control.unpack_bundle(payload):
            if self._readers.get(port):
                self._on_input(port, message)

    def _on_progress(self, reader: str, payload: bytes) -> None:
        tick = control.TickNote.from_bytes(payload).tick
        for hosted in self._hosted:
            hosted.gate.grant(reader, tick)

    def _on_stop(self, payload: bytes) -> None:
        tick = control.TickNote.from_bytes(payload).tick
        for hosted in self._hosted:
            hosted.gate.final_tick = tick
        self._has_end = True

    def _on_lost_link(self) -> None:
        if self._has_said_goodbye:
            # On a bad link the last word may come too late; nobody needs us any more.
            self._set_dismissed()
            return
        raise RunTimeoutError(
            f"{self._acting.name}: the link to the run's router was lost; the supervisor may have ended."
        )

    def _set_started(self) -> None:
        self._is_started = True

    def _set_dismissed(self) -> None:
        self._is_dismissed = True
