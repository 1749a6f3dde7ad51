"""Where an agent's commands come in from the bus: enqueued at once, in bounded memory, whatever the agent sends."""

from collections.abc import Callable

from gslcosim.runtime.agents.door import MAX_COMMAND_BYTES

MAX_WAITING_BYTES = 32 * 1024 * 1024
_EVENT_BYTES = 256  # what even an empty message costs while it waits
COMMAND, REFUSED = "command", "command refused"


class CommandQueue:
    """Puts each command as an event `COMMAND`, or `REFUSED` with the reason why it was not kept.

    The bus calls `on_command` and `on_longer` on one thread; whoever handles a `COMMAND` calls `handled` on another.
    What an agent sends faster than it can be judged is dropped beyond `MAX_WAITING_BYTES`, and told once.
    """

    def __init__(self, agent: str, put: Callable[[str, str, bytes], None]) -> None:
        self._agent = agent
        self._put = put
        self._received_bytes = 0
        self._handled_bytes = 0
        self._has_told = False

    def on_command(self, key: str, payload: bytes) -> None:
        """Take a command from the bus."""
        del key
        if self._received_bytes - self._handled_bytes < MAX_WAITING_BYTES:
            self._received_bytes += len(payload) + _EVENT_BYTES
            self._put(COMMAND, self._agent, payload)
        elif not self._has_told:
            self._has_told = True
            text = "expected one command for each observation that awaits one, was a flood; some of it was dropped."
            self._put(REFUSED, self._agent, text.encode())

    def on_longer(self, key: str, n_bytes: int) -> None:
        """Take note of a command that is too long to be fetched."""
        del key
        self._put(REFUSED, self._agent, f"expected at most {MAX_COMMAND_BYTES} bytes, was {n_bytes}.".encode())

    def handled(self, payload: bytes) -> None:
        """Take note that a command has been judged."""
        self._handled_bytes += len(payload) + _EVENT_BYTES
