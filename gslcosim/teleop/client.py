"""Client of a person in a run: attached like any agent, through the gateway, with a terminal in place of a method."""

import _thread
import contextlib
import json
import select
import socket
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgpack  # pyright: ignore[reportMissingTypeStubs]

from gslcosim.contract import codec
from gslcosim.contract.messages import Briefing, Command, Ending, Observation
from gslcosim.teleop.controls import KeyControls
from gslcosim.teleop.terminal import Dashboard, Terminal

DRAW_PERIOD_S = 0.05
POLL_PERIOD_S = 0.1
_LENGTH_BYTES = 4
# Without type stubs, so its functions are Any.
_msgpack: Any = msgpack


class TeleopClient(threading.Thread):
    """Thread that flies an agent by hand, from the moment its join file is there until the run ends.

    Args:
        keyboard: The terminal.
        waits_for_questions: Whether commands are given only where the agent is asked.
        step_m: How long a step is.
        progress: Says what the run does before it flies.
    """

    def __init__(
        self, keyboard: Terminal, *, waits_for_questions: bool, step_m: float, progress: Callable[[], str]
    ) -> None:
        super().__init__(daemon=True)
        self._keyboard = keyboard
        self._waits_for_questions = waits_for_questions
        self._step_m = step_m
        self._progress = progress
        self._join_file: Path | None = None
        self._is_over = threading.Event()
        self._connection: socket.socket | None = None
        self._buffer = bytearray()
        self._controls: KeyControls | None = None
        self._dashboard: Dashboard | None = None
        self._drawn_at_s = 0.0
        self.failure: Exception | None = None

    def attach(self, join_file: Path) -> None:
        """Say where the join data will be; on any thread."""
        self._join_file = join_file

    def leave(self) -> None:
        """End the thread, whatever the run does, and wait for it."""
        self._is_over.set()
        self.join(timeout=5.0)

    def run(self) -> None:
        """Wait for the run, then fly until it ends or the person gives up."""
        try:
            self._connection = self._connected()
            if self._connection is not None:
                with self._connection:
                    self._fly(self._connection)
        except Exception as error:  # reported by the caller that has started the thread and may be waiting
            self.failure = error
            _thread.interrupt_main()

    def _connected(self) -> socket.socket | None:
        while not self._is_over.is_set():
            self._draw_text(self._progress())
            if self._join_file is not None and self._join_file.is_file():
                join = json.loads(self._join_file.read_text())
                connection = socket.socket(socket.AF_UNIX)
                connection.connect(join["gateway"].partition(":")[2])
                connection.sendall(_encode_frame(_msgpack.packb({"token": join["token"]})))
                return connection
            # Keys that are pressed now mean nothing.
            if select.select([self._keyboard.number], [], [], POLL_PERIOD_S)[0]:
                self._keyboard.read()
        return None

    def _fly(self, connection: socket.socket) -> None:
        while not self._is_over.is_set():
            ready, _, _ = select.select([connection, self._keyboard.number], [], [], POLL_PERIOD_S)
            if connection in ready and not self._receive(connection):
                return
            if self._keyboard.number in ready:
                for key in self._keyboard.read():
                    if not self._press(key, connection):
                        return
            self._draw()

    # False at the end of the run.
    def _receive(self, connection: socket.socket) -> bool:
        try:
            data = connection.recv(1 << 20)
        except OSError:
            return False
        if not data:
            return False
        self._buffer += data
        while len(self._buffer) >= _LENGTH_BYTES:
            end = _LENGTH_BYTES + int.from_bytes(self._buffer[:_LENGTH_BYTES], "big")
            if len(self._buffer) < end:
                break
            fields: dict[str, Any] = _msgpack.unpackb(bytes(self._buffer[_LENGTH_BYTES:end]), use_list=False)
            del self._buffer[:end]
            if not self._take(str(fields.pop("message")), fields):
                return False
        return True

    def _take(self, message: str, fields: dict[str, Any]) -> bool:
        if message == Briefing.__name__:
            briefing = codec.build_message(Briefing, fields)
            self._controls = KeyControls(briefing, waits_for_questions=self._waits_for_questions, step_m=self._step_m)
            self._dashboard = Dashboard(briefing)
        elif message == Observation.__name__ and self._controls is not None and self._dashboard is not None:
            observation = codec.build_message(Observation, fields)
            self._controls.see(observation)
            self._dashboard.see(observation)
        return message != Ending.__name__

    # False when the person gives up.
    def _press(self, key: str, connection: socket.socket) -> bool:
        wish = self._controls.press(key) if self._controls is not None else None
        if wish == "quit":
            return False
        if isinstance(wish, Command):
            with contextlib.suppress(OSError):
                connection.sendall(_encode_frame(codec.encode(wish)))
        return True

    def _draw(self) -> None:
        now_s = time.monotonic()
        if self._dashboard is None or self._controls is None or now_s - self._drawn_at_s < DRAW_PERIOD_S:
            return
        self._drawn_at_s = now_s
        columns, rows = self._keyboard.size
        self._keyboard.show(self._dashboard.lines(self._controls, columns=columns, rows=rows))

    def _draw_text(self, text: str) -> None:
        columns, _ = self._keyboard.size
        self._keyboard.show([text[:columns]])


def _encode_frame(payload: bytes) -> bytes:
    return len(payload).to_bytes(_LENGTH_BYTES, "big") + payload
