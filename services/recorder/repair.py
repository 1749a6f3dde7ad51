"""Repair of recordings that were cut off: found by their missing footer, rewritten from what is left."""

import errno
import os
import secrets
import signal
import subprocess
import sys
from pathlib import Path

from gslcosim.base.errors import RecordingError
from gslcosim_services.recorder.rerun_cli import run_rerun

TIMEOUT_S = 300.0
# The program says how many files it looked at; an empty file passes as "0 files".
_VERIFIED = "1 file verified"
# The last bytes of a file name its footer (format RRF2 of Rerun 0.41); the program does not look at them.
_END_MARK = b"RRF2FOOT"
_END_BYTES = 12
_DISK_FULL_TEXTS = tuple(os.strerror(number) for number in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG))


def is_complete(path: Path) -> bool:
    """Return whether a recording can be read to its end and has its footer.

    Raises:
        RecordingError: there is no such file.
    """
    if not path.is_file():
        raise RecordingError(f"recording: expected a file, was none.\nFile: {path}")
    if not has_footer(path):
        return False
    verified = run_rerun(["rrd", "verify", path], timeout_s=TIMEOUT_S)
    return verified.returncode == 0 and _VERIFIED in verified.stdout + verified.stderr


def has_footer(path: Path) -> bool:
    """Return whether a file ends like a whole recording; what is before its end is not looked at."""
    with path.open("rb") as file:
        file.seek(max(0, path.stat().st_size - _END_BYTES))
        return file.read().startswith(_END_MARK)


def repair_recording(path: Path) -> bool:
    """Make a recording whole, keeping every row that reached the disk.

    A recorder that was killed leaves a file without footer, and perhaps with half a chunk at its end. What can be read
    is written to a new file beside the old one, which replaces it at once; whatever goes wrong, the old file stays.

    Args:
        path: The recording.

    Returns:
        True if the file was repaired, false if it was whole.

    Raises:
        RecordingError: there is no such file, nothing in it can be read, or there is no room for the new one.
    """
    if is_complete(path):
        return False
    # Its name ends like the recording's: the program goes by it.
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
