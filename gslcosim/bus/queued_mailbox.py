"""A mailbox that is a queue in this process."""

import queue


class QueuedMailbox:
    """See `Mailbox`."""

    def __init__(self) -> None:
        self._messages: queue.SimpleQueue[tuple[str, bytes]] = queue.SimpleQueue()

    def put(self, key: str, payload: bytes) -> None:
        """Add a message."""
        self._messages.put((key, payload))

    def get(self, timeout_s: float | None = None) -> tuple[str, bytes]:
        """Return the next message, and wait for it."""
        return self._messages.get(timeout=timeout_s)

    def get_nowait(self) -> tuple[str, bytes] | None:
        """Return the next message, or None where there is none."""
        try:
            return self._messages.get_nowait()
        except queue.Empty:
            return None
