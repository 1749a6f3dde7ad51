"""Bus within one process, for tests: it can lose messages, drawn from a seeded stream."""

import threading
from collections.abc import Callable
from fnmatch import fnmatchcase
from typing import Self

import numpy as np

from gslcosim.bus.interface import MessageHandler, QueryHandler, QueueMailbox


class InMemoryHub:
    """Hub that in-memory buses share; `loss_frac` of all messages vanish, drawn from a seeded stream."""

    def __init__(self, *, loss_frac: float = 0.0, seed: int = 0) -> None:
        self._lock = threading.RLock()
        self._subscribers: list[tuple[str, MessageHandler]] = []
        self._answerers: dict[str, QueryHandler] = {}
        self._alive: set[str] = set()
        self._watchers: list[tuple[str, Callable[[str, bool], None]]] = []
        self._loss_frac = loss_frac
        self._rng = np.random.default_rng(seed)
        self.n_lost = 0

    def open(self) -> "InMemoryBus":
        """Return a new member's connection."""
        return InMemoryBus(self)

    def deliver(self, key: str, payload: bytes) -> None:
        """Hand a message to all matching subscribers, or lose it; keys under `ctl/` are never lost."""
        with self._lock:
            if not key.startswith("ctl/") and self._loss_frac and self._rng.random() < self._loss_frac:
                self.n_lost += 1
                return
            for pattern, handler in self._subscribers:
                if matches(pattern, key):
                    handler(key, payload)

    def add_subscriber(self, key: str, handler: MessageHandler) -> None:
        """Register a subscriber."""
        with self._lock:
            self._subscribers.append((key, handler))

    def add_answerer(self, key: str, answerer: QueryHandler) -> None:
        """Register who answers questions on a key."""
        with self._lock:
            self._answerers[key] = answerer

    def ask(self, pattern: str, payload: bytes, handler: MessageHandler) -> None:
        """Answer a question from all that match."""
        with self._lock:
            for key, answerer in self._answerers.items():
                if matches(pattern, key):
                    for answer in answerer(payload):
                        handler(key, answer)

    def set_alive(self, key: str, *, is_alive: bool) -> None:
        """Add or remove a liveliness token and notify the watchers."""
        with self._lock:
            (self._alive.add if is_alive else self._alive.discard)(key)
            for pattern, handler in self._watchers:
                if matches(pattern, key):
                    handler(key, is_alive)

    def watch_alive(self, pattern: str, handler: Callable[[str, bool], None]) -> None:
        """Notify a watcher of all tokens, present and future."""
        with self._lock:
            self._watchers.append((pattern, handler))
            for key in sorted(self._alive):
                if matches(pattern, key):
                    handler(key, True)


class InMemoryBus:
    """One member's connection to an `InMemoryHub`; see `Bus`."""

    def __init__(self, hub: InMemoryHub) -> None:
        self._hub = hub
        self._tokens: list[str] = []

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def publish(self, key: str, payload: bytes, *, encoding: str = "", urgent: bool = False) -> None:
        """Send bytes to all subscribers of a key."""
        del encoding, urgent
        self._hub.deliver(key, payload)

    def subscribe(self, key: str, handler: MessageHandler) -> None:
        """Call `handler(key, payload)` for each message whose key matches."""
        self._hub.add_subscriber(key, handler)

    def mailbox(self, key: str | None = None) -> QueueMailbox:
        """Return a mailbox that gets each message whose key matches."""
        mailbox = QueueMailbox()
        if key is not None:
            self.subscribe(key, mailbox.put)
        return mailbox

    def answer(self, key: str, answerer: QueryHandler) -> None:
        """Answer each question put to a key."""
        self._hub.add_answerer(key, answerer)

    def ask(self, key: str, payload: bytes, handler: MessageHandler) -> None:
        """Put a question to a key."""
        self._hub.ask(key, payload, handler)

    def declare_alive(self, key: str) -> None:
        """Show a liveliness token until it is withdrawn or this connection ends."""
        self._tokens.append(key)
        self._hub.set_alive(key, is_alive=True)

    def withdraw_alive(self, key: str) -> None:
        """Take back a liveliness token of this connection."""
        self._tokens.remove(key)
        self._hub.set_alive(key, is_alive=False)

    def watch_alive(self, key: str, handler: Callable[[str, bool], None]) -> None:
        """Call `handler(key, is_alive)` for each token that is there, appears or vanishes."""
        self._hub.watch_alive(key, handler)

    def close(self) -> None:
        """Withdraw this member's tokens."""
        for key in self._tokens:
            self._hub.set_alive(key, is_alive=False)
        self._tokens.clear()


def matches(pattern: str, key: str) -> bool:
    """Return whether a key expression (`*` one segment, `**` any number, `$*` a part of one) includes a key."""
    return _matches(pattern.split("/"), key.split("/"))


def _matches(pattern: list[str], key: list[str]) -> bool:
    if not pattern:
        return not key
    if pattern[0] == "**":
        return any(_matches(pattern[1:], key[i:]) for i in range(len(key) + 1))
    is_same = bool(key) and (pattern[0] in ("*", key[0]) or fnmatchcase(key[0], pattern[0].replace("$*", "*")))
    return is_same and _matches(pattern[1:], key[1:])
