"""Rerun's viewer: shows a recording in a window, saves a picture of it, and follows one that is still being written."""

import contextlib
import os
import re
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Literal

from PIL import Image

from gslcosim.base.errors import RecordingError
from gslcosim.base.files import ScratchFolder
from gslcosim.base.processes import build_parent_death_prefix
from gslcosim_services.recorder.rerun_cli import rerun_environment, rerun_path, rerun_program

# Drawing without a graphics card took 6 s on two cores.
SCREENSHOT_TIMEOUT_S = 90.0
# The viewer gives up on a frame that takes its drawing 10 s, as on a busy machine, and then neither retries nor ends.
_DRAWING_FAILED = b"Failed to render"
# Points of the window, of which each is two pixels: a quarter of them draws four times as fast, with larger letters.
_WINDOW_SCALES = (1.0, 0.5, 0.5)
# How often a page for a browser is opened: a viewer has once served nothing.
N_TRIES = 2
# The viewer listens for more data; only programs of this machine may send some.
_LOCAL_OPTIONS = ("--bind", "127.0.0.1", "--port", "auto")
POLL_S = 0.1
_CHUNK_BYTES = 1 << 18
ViewerKind = Literal["window", "browser"]
# Only this machine may reach it.
_LOOPBACK = "127.0.0.1"
_FOR_BROWSER = ("--serve-web", "--web-viewer-port", "0")
_FOR_WINDOW = ("--expect-data-soon",)
# Line with which the program announces its page.
_ADDRESS_PATTERN = re.compile(r"(http://\S+\?url=\S+)")
_END_TIMEOUT_S = 5.0
# A viewer that had announced its address has once taken nothing for ten minutes.
_STALL_S = 60.0


def open_viewer(path: Path) -> None:
    """Show a recording in a window and return when it is closed."""
    _check_file(path)
    check_screen()
    # Its log may contain text of the recording, which must not reach a terminal.
    viewer = subprocess.run(
        [*build_parent_death_prefix(), str(rerun_program()), *_LOCAL_OPTIONS, rerun_path(path)],
        env=rerun_environment({"NO_COLOR": "1"}),
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        encoding="utf-8",
        errors="replace",
        check=False,
    )
    if viewer.returncode != 0:
        said = viewer.stdout.strip().splitlines()
        last = f": {said[-1][:300]}" if said else ""
        raise RecordingError(f"viewer: expected to end with 0, was {viewer.returncode}{last}\nFile: {path}")


def check_screen() -> None:
    """Refuse a machine on which no window can be shown."""
    if sys.platform.startswith("linux") and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise RecordingError(
            "viewer: expected a screen, was none (neither DISPLAY nor WAYLAND_DISPLAY is set). Look with a browser "
            "(--web; while it flies: --serve), or save a picture (gslcosim view RUN --screenshot FILE)."
        )


def screenshot(path: Path, png: Path, *, window_size: tuple[int, int] = (1600, 1000)) -> None:
    """Save a picture of a recording as the viewer first shows it; needs no screen and no graphics card.

    On a machine too busy to draw it within the viewer's limit, letters and lines are twice as large.

    Args:
        window_size: Width and height of the picture [pixels].
    """
    _check_file(path)
    png.unlink(missing_ok=True)
    said = _try_screenshot(path, png.resolve(), window_size)
    if not png.is_file():
        raise RecordingError(f"{_failure_reason(said)}\nFile: {path}")
    _resize(png, window_size)


# The viewer draws two pixels for each point of its window.
def _resize(png: Path, size: tuple[int, int]) -> None:
    with Image.open(png) as drawn:
        if drawn.size == size:
            return
        picture = drawn.convert("RGB").resize(size, Image.Resampling.LANCZOS)
    picture.save(png)


def _try_screenshot(path: Path, png: Path, size: tuple[int, int]) -> str:
    for scale in _WINDOW_SCALES:
        said = _draw(path, png, [max(1, round(scale * n)) for n in size])
        if said is not None:
            return said
    raise RecordingError(
        f"viewer: expected a picture, was still drawing in {len(_WINDOW_SCALES)} tries. "
        "Ask for a smaller one (--window-size), close what else computes, or look at it with gslcosim view.\n"
        f"File: {path}"
    )


# Return what the viewer has printed by its end, or None if it does not finish the picture.
def _draw(path: Path, png: Path, window: list[int]) -> str | None:
    # By standard input, because a file given by name is loaded piece by piece, after the picture.
    call = [
        *build_parent_death_prefix(), str(rerun_program()), "-", "--headless", *_LOCAL_OPTIONS,
        "--screenshot-to", rerun_path(png), "--window-size", f"{window[0]}x{window[1]}",
    ]  # fmt: skip
    with ScratchFolder() as scratch:
        # Below errors the viewer's notes would be part of the picture. Drivers require a runtime directory.
        environment = rerun_environment({"RUST_LOG": "error", "XDG_RUNTIME_DIR": str(scratch.path)})
        printed = scratch.path / "printed.txt"
        with (
            path.open("rb") as recording,
            printed.open("wb") as output,
            subprocess.Popen(call, stdin=recording, stdout=output, stderr=output, env=environment) as viewer,
        ):
            try:
                deadline = time.monotonic() + SCREENSHOT_TIMEOUT_S
                while viewer.poll() is None:
                    if _DRAWING_FAILED in printed.read_bytes() or time.monotonic() > deadline:
                        return None
                    time.sleep(POLL_S)
            finally:
                viewer.kill()
        return printed.read_text("utf-8", "replace")


def _failure_reason(said: str) -> str:
    if re.search(r"graphics adapter|render context|Vulkan", said, re.IGNORECASE):
        return (
            "viewer: expected a Vulkan driver to draw with, was none. Install one that needs no graphics card, "
            "on Debian and Ubuntu: apt-get install mesa-vulkan-drivers"
        )
    lines = [line.strip() for line in said.splitlines() if line.strip()]
    telling = [line for line in lines if re.search(r"panicked|error", line, re.IGNORECASE)]
    return f"viewer: expected a picture, was none ({(telling or lines or ['it said nothing'])[0]})"


def _check_file(path: Path) -> None:
    if not path.is_file():
        raise RecordingError(f"recording: expected a file, was none.\nFile: {path}")


def tail_file(path: Path, is_over: Callable[[], bool]) -> Iterator[bytes]:
    """Yield the bytes of a file from its beginning, and further ones as it grows, until it is complete.

    Args:
        path: The file; it need not exist yet. It is read as opened, even if another replaces it.
        is_over: Returns True once no process writes the file any more; earlier content is still read.
    """
    was_over = False
    while not path.exists():
        if was_over:
            return
        was_over = is_over()
        time.sleep(0 if was_over else POLL_S)
    was_over = False
    with path.open("rb") as file:
        while True:
            data = file.read(_CHUNK_BYTES)
            if data:
                yield data
            elif was_over:
                return
            else:
                was_over = is_over()
                time.sleep(0 if was_over else POLL_S)


class LiveViewer:
    """Viewer in a process of its own that shows a recording while it is written, without the recorder's involvement.

    Args:
        kind: A window of this machine's screen, or a page for a browser of this machine.
        on_address: Receives the address of the page for a browser, on a thread of the viewer's, once the viewer has
            something to show.
        prefix: Command in front of the viewer's, for example so that the viewer ends with this process.
    """

    def __init__(self, kind: ViewerKind, on_address: Callable[[str], object], *, prefix: Sequence[str] = ()) -> None:
        if kind == "window":
            check_screen()
        options = _FOR_BROWSER if kind == "browser" else _FOR_WINDOW
        call = [*prefix, str(rerun_program()), "-", "--bind", _LOOPBACK, "--port", str(_free_port()), *options]
        self._said: list[str] = []
        self._on_address = on_address
        # In a session of its own: Ctrl-C is for the run first.
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
        self._n_bytes_taken = 0

    @property
    def is_open(self) -> bool:
        """True while the viewer runs."""
        return self._viewer.poll() is None

    def show(self, path: Path, is_over: Callable[[], bool]) -> None:
        """Show a recording from now on, as far as it is written, until `is_over` returns True."""
        self._feeder = threading.Thread(target=self._feed, args=(path, is_over), name="feeds the viewer", daemon=True)
        self._feeder.start()

    def wait_until_shown(self) -> None:
        """Return when the viewer has taken all of the recording, or has ended.

        Raises:
            RecordingError: if it takes nothing any more.
        """
        while self._feeder is not None and self._feeder.is_alive():
            before = self._n_bytes_taken
            self._feeder.join(_STALL_S)
            if self._feeder.is_alive() and self._n_bytes_taken == before:
                raise RecordingError(
                    f"viewer: expected to take the recording, took nothing for {_STALL_S:g} s. Open it again: "
                    "gslcosim view RUN, with --web in a browser"
                )

    def wait_until_closed(self) -> None:
        """Return when the viewer is closed."""
        if self._viewer.wait() != 0:
            raise RecordingError(f"viewer: expected to end with 0, {self._log_tail()}")

    def close(self) -> None:
        """End the viewer."""
        self._viewer.terminate()
        try:
            self._viewer.wait(_END_TIMEOUT_S)
        except subprocess.TimeoutExpired:
            self._viewer.kill()
            self._viewer.wait()
        if self._feeder is not None:
            self._feeder.join()
        self._listener.join()
        if self._viewer.stdin is not None:
            with contextlib.suppress(BrokenPipeError):
                self._viewer.stdin.close()

    def _feed(self, path: Path, is_over: Callable[[], bool]) -> None:
        assert self._viewer.stdin is not None
        # A closed viewer takes no more. Its input stays open: at the end of its input it spins on a core.
        with contextlib.suppress(BrokenPipeError):
            for data in tail_file(path, lambda: is_over() or not self.is_open):
                self._viewer.stdin.write(data)
                self._viewer.stdin.flush()
                self._n_bytes_taken += len(data)

    def _listen(self) -> None:
        assert self._viewer.stdout is not None
        with self._viewer.stdout as said:
            for line in said:
                text = line.decode(errors="replace").strip()
                self._said = [*self._said[-20:], text]
                found = _ADDRESS_PATTERN.search(text)
                if found:
                    self._on_address(found[1])

    def _log_tail(self) -> str:
        code = self._viewer.poll()
        state = "it said nothing of one" if code is None else f"it ended with {code}"
        return f"{state}: {self._said[-1] if self._said else 'no word'}"


# The program's own search for a port finds the same one for two viewers that start at once.
def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind((_LOOPBACK, 0))
        return int(probe.getsockname()[1])
