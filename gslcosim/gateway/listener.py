"""Where one agent connects to the gateway: an address, and a token that it sends first."""

import secrets
import socket
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any, Self

from gslcosim.errors import ContractError, SimulationFault
from gslcosim.gateway.framing import LENGTH_BYTES, FrameFormat, fields_of_frame
from gslcosim.gateway.streams import SocketStream

HELLO_LIMIT_S = 10.0
MAX_HELLO_BYTES = 4096
MAX_WAITING = 8
_LOOK_EVERY_S = 0.2


class Listener:
    """Listens for one agent; the first connection that shows the token is it, and then nobody else is let in."""

    def __init__(self, listening: socket.socket, address: str) -> None:
        self.address = address
        self.token = secrets.token_urlsafe(18)
        self._listening = listening
        self._listening.settimeout(_LOOK_EVERY_S)
        self._is_closed = threading.Event()
        self._waiting = threading.Semaphore(MAX_WAITING)
        self._lock = threading.Lock()

    @classmethod
    def open_tcp(cls, host: str = "127.0.0.1", *, public_name: str | None = None) -> Self:
        """Listen on a free TCP port.

        Args:
            host: The address of this machine to listen on.
            public_name: What others call this machine, where that differs.

        Raises:
            SimulationFault: that is not possible.
        """
        try:
            listening = socket.create_server((host, 0), backlog=MAX_WAITING)
        except OSError as error:
            raise SimulationFault(f"gateway: expected to listen on {host}, could not: {error}") from error
        return cls(listening, f"tcp:{public_name or host}:{listening.getsockname()[1]}")

    @classmethod
    def open_unix(cls, path: Path) -> Self:
        """Listen on a unix socket, which only this user may open.

        Raises:
            SimulationFault: that is not possible.
        """
        listening = socket.socket(socket.AF_UNIX)
        try:
            listening.bind(str(path))
            path.chmod(0o600)
            listening.listen(MAX_WAITING)
        except OSError as error:
            listening.close()
            raise SimulationFault(f"gateway: expected to listen on {path}, could not: {error}") from error
        return cls(listening, f"unix:{path}")

    def admit(
        self,
        frame_format: FrameFormat,
        on_admitted: Callable[[SocketStream, dict[str, Any]], None],
        on_refused: Callable[[str], None],
    ) -> None:
        """Wait for the agent in a thread.

        Args:
            frame_format: The format of its frames, and already of the one with the token.
            on_admitted: Gets the agent's connection and the whole map of its first frame.
            on_refused: Is told why a connection was not the agent's.
        """
        arguments = (frame_format, on_admitted, on_refused)
        threading.Thread(target=self._accept, args=arguments, daemon=True).start()

    def close(self) -> None:
        """Let nobody in any more."""
        self._is_closed.set()

    def _accept(self, frame_format: FrameFormat, on_admitted: Any, on_refused: Any) -> None:
        with self._listening:
            while not self._is_closed.is_set():
                if not self._waiting.acquire(timeout=_LOOK_EVERY_S):
                    continue
                try:
                    connection, _ = self._listening.accept()
                except OSError:  # most often: nobody within the time
                    self._waiting.release()
                    continue
                arguments = (connection, frame_format, on_admitted, on_refused)
                threading.Thread(target=self._greet, args=arguments, daemon=True).start()

    def _greet(self, connection: socket.socket, frame_format: FrameFormat, on_admitted: Any, on_refused: Any) -> None:
        try:
            hello = self._hello(connection, frame_format)
        except (ContractError, OSError) as error:
            connection.close()
            on_refused(f"a connection was refused: {error}")
            return
        finally:
            self._waiting.release()
        with self._lock:
            is_late = self._is_closed.is_set()
            self._is_closed.set()
        if is_late:
            connection.close()
        else:
            on_admitted(SocketStream(connection), hello)

    def _hello(self, connection: socket.socket, frame_format: FrameFormat) -> dict[str, Any]:
        connection.settimeout(HELLO_LIMIT_S)
        if connection.family != socket.AF_UNIX:
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        fields = fields_of_frame(frame_format, _first_frame(connection, frame_format))
        token = fields.get("token")
        if not isinstance(token, str) or not secrets.compare_digest(
            token.encode(errors="replace"), self.token.encode()
        ):
            raise ContractError("expected a first frame with the token of GSLCOSIM_TOKEN, it has another or none.")
        connection.settimeout(None)
        return fields


# Not a byte more than the frame, because what follows belongs to the link.
def _first_frame(connection: socket.socket, frame_format: FrameFormat) -> bytes:
    if frame_format == "msgpack":
        length = int.from_bytes(_exactly(connection, LENGTH_BYTES), "big")
        _check_length(length)
        return _exactly(connection, length)
    line = bytearray()
    while (byte := _exactly(connection, 1)) != b"\n":
        line += byte
        _check_length(len(line))
    return bytes(line)


def _check_length(n_bytes: int) -> None:
    if n_bytes > MAX_HELLO_BYTES:
        raise ContractError(f"expected a first frame of at most {MAX_HELLO_BYTES} bytes, was {n_bytes} or more.")


def _exactly(connection: socket.socket, n_bytes: int) -> bytes:
    data = bytearray()
    while len(data) < n_bytes:
        piece = connection.recv(n_bytes - len(data))
        if not piece:
            raise ContractError(f"expected a first frame with the token, the stream ended after {len(data)} bytes.")
        data += piece
    return bytes(data)
