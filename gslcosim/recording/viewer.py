"""A recording on the screen, or as a picture."""

import contextlib
import os
import re
import subprocess
import sys
from pathlib import Path

from gslcosim.command_lines import ending_with_parent
from gslcosim.errors import RecordingError
from gslcosim.recording.rerun_cli import rerun_environment, rerun_path, rerun_program
from gslcosim.scratch import ScratchFolder

# Drawing without a graphics card took 6 s on two busy cores; a minute of simulated time more adds little.
SCREENSHOT_TIMEOUT_S = 90.0
# The viewer was once seen to draw nothing for minutes where it needed 11 s just after.
N_TRIES = 2
# The viewer listens for more data; only programs of this machine may send some.
_LOCAL = ("--bind", "127.0.0.1", "--port", "auto")


def open_viewer(path: Path) -> None:
    """Show a recording in a window and return when it is closed.

    Raises:
        RecordingError: there is no such file, no screen, or the viewer fails.
    """
    _check_file(path)
    check_screen()
    # What it logs may come from the recording, and is no text for a terminal.
    viewer = subprocess.run(
        [*ending_with_parent(), str(rerun_program()), *_LOCAL, rerun_path(path)],
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
    """Refuse where a window cannot be shown.

    Raises:
        RecordingError: there is no screen.
    """
    if sys.platform.startswith("linux") and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise RecordingError(
            "viewer: expected a screen, was none (neither DISPLAY nor WAYLAND_DISPLAY is set). Look with a browser "
            "(--web; while it flies: --serve), or save a picture (gslcosim view RUN --screenshot FILE)."
        )


def screenshot(path: Path, png: Path, *, window_size: tuple[int, int] = (1600, 1000)) -> None:
    """Save a picture of a recording as the viewer shows it first; needs no screen and no graphics card.

    Args:
        path: The recording.
        png: The picture to write.
        window_size: Width and height of the window [points]; the picture has two pixels for each.

    Raises:
        RecordingError: there is no such file, no Vulkan driver, or the viewer fails.
    """
    _check_file(path)
    png.unlink(missing_ok=True)
    said = _draw(path, png.resolve(), f"{window_size[0]}x{window_size[1]}")
    if not png.is_file():
        raise RecordingError(f"{_reason(said)}\nFile: {path}")


def _draw(path: Path, png: Path, size: str) -> str:
    # As standard input, because a file given by name is loaded piece by piece, after the picture.
    call = [
        *ending_with_parent(), str(rerun_program()), "-", "--headless", *_LOCAL,
        "--screenshot-to", rerun_path(png), "--window-size", size,
    ]  # fmt: skip
    for _ in range(N_TRIES):
        with path.open("rb") as recording, ScratchFolder() as scratch:
            # Below errors the viewer's notes would be part of the picture. Drivers want a runtime directory.
            environment = rerun_environment({"RUST_LOG": "error", "XDG_RUNTIME_DIR": str(scratch.path)})
            with contextlib.suppress(subprocess.TimeoutExpired):
                drawn = subprocess.run(
                    call,
                    stdin=recording,
                    capture_output=True,
                    text=True,
                    errors="replace",
                    env=environment,
                    timeout=SCREENSHOT_TIMEOUT_S,
                    check=False,
                )
                return drawn.stdout + drawn.stderr
    raise RecordingError(
        f"viewer: expected a picture within {SCREENSHOT_TIMEOUT_S:g} s, was still drawing in {N_TRIES} tries.\n"
        f"File: {path}"
    )


def _reason(said: str) -> str:
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
