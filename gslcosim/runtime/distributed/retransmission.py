"""Retransmission of lost messages: a writer's buffer of its last ticks, a reader's that restores their order."""

import itertools
import threading
from collections import OrderedDict
from dataclasses import dataclass, field
from typing import Generic, TypeVar

from gslcosim.base.errors import ContractError
from gslcosim.runtime.distributed import protocol
from gslcosim.runtime.stepper import SentMessage

Item = TypeVar("Item")

REQUEST_PERIOD = 16
RETRANSMIT_TICKS = 1024
MAX_RETRANSMITTED_AT_ONCE = 32


@dataclass
class RetransmitBuffer:
    """Buffer of each port's messages in its last ticks, for readers that missed one; shared between two threads."""

    n_ticks: int = RETRANSMIT_TICKS
    _payloads: dict[str, OrderedDict[int, bytes]] = field(default_factory=dict[str, OrderedDict[int, bytes]])
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def keep(self, sent: SentMessage) -> None:
        """Keep a message and drop those that are too old to be requested."""
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
            request = protocol.ResendRequest.from_bytes(question)
        except ContractError:
            return []
        with self._lock:
            payloads = self._payloads.get(request.port, OrderedDict[int, bytes]())
            if request.tick not in payloads:
                return []
            later = (payload for tick, payload in payloads.items() if tick >= request.tick)
            return list(itertools.islice(later, MAX_RETRANSMITTED_AT_ONCE))


@dataclass
class ReorderBuffer(Generic[Item]):
    """Buffer that hands out a port's messages in the order of their ticks."""

    next_tick: int = 0
    _held: dict[int, Item] = field(default_factory=dict[int, Item])

    def take(self, tick: int, item: Item) -> list[Item]:
        """Take a message of a tick; return those that are next, in order. One that came before is ignored."""
        if tick >= self.next_tick:
            self._held[tick] = item
        ready: list[Item] = []
        while (held := self._held.pop(self.next_tick, None)) is not None:
            ready.append(held)
            self.next_tick += 1
        return ready

    def lost(self) -> int | None:
        """Return the tick to ask for again: now and then, while later messages are held back for it."""
        return self.next_tick if len(self._held) % REQUEST_PERIOD == 1 else None
