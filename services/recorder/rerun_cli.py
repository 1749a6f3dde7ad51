"""Rerun's command line program, and repair of recordings that were cut off."""

import errno
import importlib.util
import os
import secrets
import signal
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

from gslcosim.base.errors import RecordingError
from gslcosim.base.processes import build_parent_death_prefix

# Rerun's usage statistics are off wherever this is set, on every platform and without touching the user's settings.
_WITHOUT_ANALYTICS = {"CI": "1"}
_ANALYTICS_SWITCH = "FORCE_RERUN_ANALYTICS"

TIMEOUT_S = 300.0
# The program prints the number of files it verified; an empty file passes as "0 files".
_VERIFIED = "1 file verified"
# The last bytes of a file name its footer (format RRF2 of Rerun 0.41); the program does not look at them.
_END_MARK = b"RRF2FOOT"
_END_BYTES = 12
_DISK_FULL_TEXTS = tuple(os.strerror(number) for number in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG))


def rerun_program() -> Path:
    """Return the path of the program."""
    spec = importlib.util.find_spec("rerun_cli")
    folder = Path(spec.origin).parent if spec is not None and spec.origin else Path(sys.prefix)
    program = folder / ("rerun.exe" if sys.platform == "win32" else "rerun")
    if not program.is_file():
        raise RecordingError(
            "rerun: expected the program that comes with the package rerun-sdk, was missing. "
            f"Reinstall it: {sys.executable} -m pip install --force-reinstall rerun-sdk\nFile: {program}"
        )
    return program


def rerun_path(path: Path) -> str:
    """Return a path as Rerun takes it."""
    try:
        os.fsencode(path).decode()
    except UnicodeDecodeError as error:
        raise RecordingError(
            "recording: expected a path in UTF-8, without which Rerun opens no file, was one in another encoding. "
            f"Rename its folder, or choose another.\nFile: {path}"
        ) from error
    return str(path)


def rerun_environment(extra: Mapping[str, str] | None = None) -> dict[str, str]:
    """Return the environment variables for the program: ours, no usage statistics, and `extra`."""
    inherited = {name: value for name, value in os.environ.items() if name != _ANALYTICS_SWITCH}
    return inherited | _WITHOUT_ANALYTICS | dict(extra or {})


def run_rerun(arguments: Sequence[str | Path], *, timeout_s: float) -> subprocess.CompletedProcess[str]:
    """Run the program to its end and return what it wrote."""
    paths = [rerun_path(each) if isinstance(each, Path) else each for each in arguments]
    call = [*build_parent_death_prefix(), str(rerun_program()), *paths]
    try:
        return subprocess.run(
            call,
            capture_output=True,
            text=True,
            errors="replace",
            stdin=subprocess.DEVNULL,
            timeout=timeout_s,
            env=rerun_environment(),
            check=False,
        )
    except subprocess.TimeoutExpired as error:
        raise RecordingError(
            f"rerun {arguments[0]}: expected an end within {timeout_s:g} s, was still running."
        ) from error
    except OSError as error:
        raise RecordingError(f"rerun: expected a program that starts, was {error}.") from error


def is_complete(path: Path) -> bool:
    """Return whether a recording can be read to its end and has its footer."""
    if not path.is_file():
        raise RecordingError(f"recording: expected a file, was none.\nFile: {path}")
    if not has_footer(path):
        return False
    verified = run_rerun(["rrd", "verify", path], timeout_s=TIMEOUT_S)
    return verified.returncode == 0 and _VERIFIED in verified.stdout + verified.stderr


def has_footer(path: Path) -> bool:
    """Return whether a file ends like a whole recording, by its last bytes alone."""
    with path.open("rb") as file:
        file.seek(max(0, path.stat().st_size - _END_BYTES))
        return file.read().startswith(_END_MARK)


def repair_recording(path: Path) -> bool:
    """Make a recording whole, keeping every row that reached the disk.

    A recorder that was killed leaves a file without footer, and perhaps with half a chunk at its end. All readable
    chunks go to a new file beside the old one, which then replaces it in one step; on any error the old file stays.

    Returns:
        True if the file was repaired, false if it was whole.
    """
    if is_complete(path):
        return False
    # Its name ends like the recording's: the program depends on it.
    repaired = path.with_name(f".{path.stem}.{secrets.token_hex(4)}.rrd")
    try:
        merged = run_rerun(["rrd", "merge", "--continue-on-error", "-o", repaired, path], timeout_s=TIMEOUT_S)
        if _ran_out_of_space(merged):
            raise RecordingError(
                f"recording: expected room for a second copy of {path.stat().st_size / 1e6:.3g} MB to make it whole, "
                f"was none. What was written is kept, and gslcosim view shows it.\nFile: {path}"
            )
        if merged.returncode != 0 or not repaired.is_file() or not is_complete(repaired):
            raise RecordingError(
                f"recording: expected a file of which something can be read, was {path.stat().st_size} bytes "
                f"without any whole part. Nothing of this recording is left; fly the run again.\nFile: {path}"
            )
        os.replace(repaired, path)  # noqa: PTH105 - replaces on every platform, as Path.rename does not
    finally:
        repaired.unlink(missing_ok=True)
    return True


def _ran_out_of_space(merged: "subprocess.CompletedProcess[str]") -> bool:
    # Above a limit on the size of files a program is ended by a signal.
    if sys.platform != "win32" and merged.returncode == -signal.SIGXFSZ:
        return True
    return merged.returncode != 0 and any(reason in merged.stderr for reason in _DISK_FULL_TEXTS)
