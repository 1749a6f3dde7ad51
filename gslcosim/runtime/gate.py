"""Who may step: the pure state machine of one participant. Arrival order carries no meaning."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from gslcosim.contract.messages import Message
from gslcosim.runtime.dataflow import ONCE, Dataflow

NO_LIMIT = 2**62


@dataclass(frozen=True)
class Missing:
    """An input that is not here yet: the message of a port at a tick."""

    port: str
    tick: int


@dataclass
class Gate:
    """Holds a participant's inputs and decides when its next step may happen.

    A step of tick k needs, for each read, the message of tick k - delay where one exists. It exists at the ticks of
    the port's period, or where its announcement says so, and never after a message that closes the port. A writer may
    be at most `window_ticks` ahead of each reader (the reader's window).

    Duplicates and inputs of the past are ignored; messages may be delivered in any order.
    """

    dataflow: Dataflow
    name: str
    next_tick: int = 0
    final_tick: int | None = None
    _held: dict[str, dict[int, Message]] = field(init=False, repr=False)
    _announced: dict[str, dict[int, frozenset[str]]] = field(init=False, repr=False)
    _closed: dict[str, int] = field(default_factory=dict[str, int], init=False, repr=False)
    _credit: dict[str, int] = field(init=False, repr=False)
    _credit_until: int = field(init=False, repr=False)

    def __post_init__(self) -> None:
        spec = self.dataflow.by_name[self.name]
        writes = self.dataflow.writes
        self._reads = tuple((read.port, read.delay_ticks, writes[read.port]) for read in spec.reads)
        self._delays = {read.port: read.delay_ticks for read in spec.reads}
        self._held = {read.port: {} for read in spec.reads}
        announcers = {write.announced_in for _, _, write in self._reads if write.announced_in not in (None, ONCE)}
        self._announced = {port: {} for port in announcers if port}
        self._longest_delay = max((read.delay_ticks for read in spec.reads), default=0)
        readers = self.dataflow.readers_of(self.name)
        self._windows = {reader.name: reader.window_ticks for reader in readers}
        self._credit = dict.fromkeys(self._windows, -1)
        self._credit_until = self._last_tick_in_credit()

    def deliver(self, port: str, message: Message) -> bool:
        """Take an input and return whether it was new; one that is known, past or not read is ignored."""
        delay = self._delays.get(port)
        if delay is None or message.tick < self.next_tick - delay or message.tick in self._held[port]:
            return False
        self._held[port][message.tick] = message
        self._note(port, message)
        return True

    def wrote(self, port: str, message: Message) -> None:
        """Take note of an output of the participant itself, which may announce something it reads."""
        self._note(port, message)

    def grant(self, reader: str, tick: int) -> None:
        """Take note that a reader has finished a tick."""
        if tick > self._credit.get(reader, tick):
            self._credit[reader] = tick
            self._credit_until = self._last_tick_in_credit()

    def missing(self) -> list[Missing]:
        """Return the inputs that the next step still needs; for an unknown announcement, the announcement."""
        needed: list[Missing] = []
        for port, delay, write in self._reads:
            tick = self.next_tick - delay
            if tick < 0 or tick in self._held[port]:
                continue
            if self._closed.get(port, tick) < tick:
                continue
            if write.announced_in is None:
                if tick % write.period_ticks == 0:
                    needed.append(Missing(port, tick))
            elif write.announced_in != ONCE:
                announced = self._announced[write.announced_in].get(tick)
                if announced is None:
                    needed.append(Missing(write.announced_in, tick))
                elif port in announced:
                    needed.append(Missing(port, tick))
        return needed

    def lacking_credit(self) -> list[str]:
        """Return the readers that the next step would leave too far behind."""
        return [name for name, window in self._windows.items() if self.next_tick > self._credit[name] + window]

    @property
    def is_finished(self) -> bool:
        """Whether the run's last tick has been stepped."""
        return self.final_tick is not None and self.next_tick > self.final_tick

    def may_step(self) -> bool:
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
        """Return what the next steps depend on and no later message tells: announcements, and ports that are closed."""
        announced = {
            port: [[tick, sorted(ports)] for tick, ports in ticks.items() if tick < self.next_tick]
            for port, ticks in self._announced.items()
        }
        closed = {port: tick for port, tick in self._closed.items() if tick < self.next_tick}
        return {"announced": announced, "closed": closed}

    def go_on(self, tick: int, memory: Mapping[str, Any]) -> None:
        """Let the next step be that of a tick, with what `memory` has told; inputs are to be delivered again."""
        self.next_tick = tick
        for port, ticks in memory.get("announced", {}).items():
            self._announced[port] = {then: frozenset(ports) for then, ports in ticks}
        self._closed = dict(memory.get("closed", {}))

    @property
    def least_credit(self) -> int:
        """The last tick that all readers have finished; `NO_LIMIT` where nobody reads."""
        return min(self._credit.values(), default=NO_LIMIT)

    @property
    def holds_any(self) -> bool:
        """Whether inputs wait here for others."""
        return any(self._held.values())

    @property
    def n_queued_ticks(self) -> int:
        """The ticks of the fullest input that wait here."""
        return max((len(held) for held in self._held.values()), default=0)

    @property
    def waits_for(self) -> tuple[str, ...]:
        """What the next step lacks: ports, and readers that have to catch up; empty where it may happen."""
        lacking = [*(missing.port for missing in self.missing()), *self.lacking_credit()]
        return tuple(dict.fromkeys(lacking))

    def has_later(self, missing: Missing) -> bool:
        """Return whether a later message of a port is here, so that a missing one must have been lost."""
        held = self._held.get(missing.port, {})
        return any(tick > missing.tick for tick in held)

    def _last_tick_in_credit(self) -> int:
        return min((self._credit[name] + window for name, window in self._windows.items()), default=NO_LIMIT)

    def _note(self, port: str, message: Message) -> None:
        if port in self._announced:
            self._announced[port].setdefault(message.tick, message.announced_ports())
        if message.closes_port:
            self._closed[port] = min(message.tick, self._closed.get(port, message.tick))
