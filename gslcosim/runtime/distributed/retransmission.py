"""Retransmission of lost messages: a writer's buffer of its last ticks, a reader's that restores their order."""

from dataclasses import dataclass, field
from typing import Generic, TypeVar

Item = TypeVar("Item")

REQUEST_PERIOD = 16


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
