"""A mailbox on a channel of Zenoh: who waits for a message is woken by the network's own thread, without a callback."""
# Zenoh's stubs leave many types open.
# pyright: reportUnknownMemberType=false, reportUnknownArgumentType=false, reportUnknownVariableType=false

import queue
import threading
import time
from typing import Any

import zenoh
import zenoh.handlers

# More than readers may ever lag behind: a full channel would stop all that the session receives.
CAPACITY = 1 << 16
# Who waits for longer is woken by a thread that looks so often [s]; shorter waits poll.
LOOK_EVERY_S = 0.05
POLL_EVERY_S = 0.0005


class ZenohMailbox:
    """See `Mailbox`. Messages of the channel and those that are put have no order among each other.

    Args:
        session: The member's session.
        prefix: The namespace with its slash, which keys are told without.
        key: What the channel subscribes to.
        wake_key: A key that `key` matches and nobody else uses.
    """

    def __init__(self, session: zenoh.Session, prefix: str, key: str, wake_key: str) -> None:
        self._prefix = prefix
        self._wake_key = wake_key
        self._put: queue.SimpleQueue[tuple[str, bytes]] = queue.SimpleQueue()
        channel: Any = zenoh.handlers.FifoChannel(CAPACITY)
        self._channel: Any = session.declare_subscriber(key, channel)
        self._waker: Any = session.declare_publisher(wake_key, allowed_destination=zenoh.Locality.SESSION_LOCAL)
        self._is_waiting = False
        self._deadline_s: float | None = None
        self._watch: threading.Thread | None = None

    def put(self, key: str, payload: bytes) -> None:
        """Add a message."""
        self._put.put((key, payload))
        # Whoever begins to wait says so before it looks here.
        if self._is_waiting:
            self._waker.put(b"")

    def get(self, timeout_s: float | None = None) -> tuple[str, bytes]:
        """Return the next message, and wait for it."""
        if timeout_s is not None and timeout_s < LOOK_EVERY_S:
            return self._polled(timeout_s)
        deadline_s = None if timeout_s is None else time.monotonic() + timeout_s
        self._is_waiting = True
        try:
            while (found := self.get_nowait()) is None:
                if deadline_s is not None and time.monotonic() >= deadline_s:
                    raise queue.Empty
                self._wake_at(deadline_s)
                if (found := self._of(self._channel.recv())) is not None:
                    break
            return found
        finally:
            self._is_waiting = False
            self._deadline_s = None

    def get_nowait(self) -> tuple[str, bytes] | None:
        """Return the next message, or None where there is none."""
        if not self._put.empty():
            return self._put.get()
        while (sample := self._channel.try_recv()) is not None:
            if (found := self._of(sample)) is not None:
                return found
        return None

    def _polled(self, timeout_s: float) -> tuple[str, bytes]:
        deadline_s = time.monotonic() + timeout_s
        while (found := self.get_nowait()) is None:
            left_s = deadline_s - time.monotonic()
            if left_s <= 0:
                raise queue.Empty
            time.sleep(min(left_s, POLL_EVERY_S))
        return found

    def _of(self, sample: zenoh.Sample) -> tuple[str, bytes] | None:
        key = str(sample.key_expr).removeprefix(self._prefix)
        return None if key == self._wake_key else (key, sample.payload.to_bytes())

    def _wake_at(self, deadline_s: float | None) -> None:
        self._deadline_s = deadline_s
        if deadline_s is not None and self._watch is None:
            self._watch = threading.Thread(target=self._look, daemon=True)
            self._watch.start()

    def _look(self) -> None:
        while True:
            time.sleep(LOOK_EVERY_S)
            deadline_s = self._deadline_s
            if deadline_s is not None and time.monotonic() >= deadline_s:
                try:
                    self._waker.put(b"")
                except zenoh.ZError:
                    return
