"""A viewer that shows a recording while it is written: in a window, or in a browser."""

import contextlib
import re
import socket
import subprocess
import threading
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Literal

from gslcosim.errors import RecordingError
from gslcosim.recording.following import follow
from gslcosim.recording.rerun_cli import rerun_environment, rerun_program
from gslcosim.recording.viewer import check_screen

Kind = Literal["window", "browser"]

# Only this machine may reach it.
_LOCAL = "127.0.0.1"
_FOR_BROWSER = ("--serve-web", "--web-viewer-port", "0")
_FOR_WINDOW = ("--expect-data-soon",)
# What the program says once its page can be opened.
_ADDRESS = re.compile(r"(http://\S+\?url=\S+)")
_END_TIMEOUT_S = 5.0


class LiveView:
    """A viewer of its own process; it reads what is in the file, and whoever writes that knows nothing of it.

    Args:
        kind: A window of this machine's screen, or a page for a browser of this machine.
        on_address: Is told, on a thread of the viewer's, where a browser finds the page; there is one once the viewer
            has something to show.
        prefix: What precedes the viewer's command line, for example so that it ends with this process.

    Raises:
        RecordingError: there is no screen for a window, or no viewer.
    """

    def __init__(self, kind: Kind, on_address: Callable[[str], object], *, prefix: Sequence[str] = ()) -> None:
        if kind == "window":
            check_screen()
        options = _FOR_BROWSER if kind == "browser" else _FOR_WINDOW
        call = [*prefix, str(rerun_program()), "-", "--bind", _LOCAL, "--port", str(_free_port()), *options]
        self._said: list[str] = []
        self._on_address = on_address
        # In a session of its own: Ctrl-C is for the flight first.
        self._viewer = subprocess.Popen(
            call,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            env=rerun_environment({"RUST_LOG": "info", "NO_COLOR": "1"}),
            start_new_session=True,
        )
        self._listener = threading.Thread(target=self._listen, name="listens to the viewer", daemon=True)
        self._listener.start()
        self._feeder: threading.Thread | None = None

    @property
    def is_open(self) -> bool:
        """Whether the viewer still runs."""
        return self._viewer.poll() is None

    def show(self, path: Path, is_over: Callable[[], bool]) -> None:
        """Show a recording from now on, as far as it is written, until `is_over` says that it is complete."""
        self._feeder = threading.Thread(target=self._feed, args=(path, is_over), name="feeds the viewer", daemon=True)
        self._feeder.start()

    def wait_until_shown(self) -> None:
        """Return when the viewer has been given all of the recording, or has ended."""
        if self._feeder is not None:
            self._feeder.join()

    def wait_until_closed(self) -> None:
        """Return when somebody has closed the viewer.

        Raises:
            RecordingError: it has failed.
        """
        if self._viewer.wait() != 0:
            raise RecordingError(f"viewer: expected to end with 0, {self._last_words()}")

    def close(self) -> None:
        """End the viewer."""
        self._viewer.terminate()
        try:
            self._viewer.wait(_END_TIMEOUT_S)
        except subprocess.TimeoutExpired:
            self._viewer.kill()
            self._viewer.wait()
        self.wait_until_shown()
        self._listener.join()
        if self._viewer.stdin is not None:
            with contextlib.suppress(BrokenPipeError):
                self._viewer.stdin.close()

    def _feed(self, path: Path, is_over: Callable[[], bool]) -> None:
        assert self._viewer.stdin is not None
        # A viewer that was closed takes no more. Its entrance stays open: at the end of its input it spins on a core.
        with contextlib.suppress(BrokenPipeError):
            for data in follow(path, lambda: is_over() or not self.is_open):
                self._viewer.stdin.write(data)
                self._viewer.stdin.flush()

    def _listen(self) -> None:
        assert self._viewer.stdout is not None
        with self._viewer.stdout as said:
            for line in said:
                text = line.decode(errors="replace").strip()
                self._said = [*self._said[-20:], text]
                found = _ADDRESS.search(text)
                if found:
                    self._on_address(found[1])

    def _last_words(self) -> str:
        code = self._viewer.poll()
        state = "it said nothing of one" if code is None else f"it ended with {code}"
        return f"{state}: {self._said[-1] if self._said else 'no word'}"


# The program's own search for one finds the same for two that begin at once.
def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind((_LOCAL, 0))
        return int(probe.getsockname()[1])
