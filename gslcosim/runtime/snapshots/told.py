"""What agents were told, kept so that another agent can be told it again: `snapshots/told/<agent>.log`.

A file is a chain of pieces: four bytes of length, big-endian, and compressed observations, each behind four bytes of
length of its own.
"""

import zlib
from collections.abc import Iterator
from pathlib import Path

from gslcosim.errors import RunFolderError, SnapshotError
from gslcosim.machine import machine_error
from gslcosim.runtime.run_dir import RunDir
from gslcosim.safe_files import append_to

TOLD = "told"
_PIECE_TICKS = 64
_PIECE_BYTES = 1 << 20


class ToldLog:
    """Keeps the observations of one agent, in the order of their ticks, in pieces."""

    def __init__(self, run_dir: RunDir, agent: str) -> None:
        self._run_dir = run_dir
        self._name = f"snapshots/{TOLD}/{agent}.log"
        self._waiting: list[bytes] = []
        self._n_bytes = 0

    def add(self, payload: bytes) -> None:
        """Keep an observation.

        Raises:
            RunFolderError: it cannot be written.
        """
        self._waiting.append(payload)
        self._n_bytes += len(payload)
        if len(self._waiting) >= _PIECE_TICKS or self._n_bytes >= _PIECE_BYTES:
            self.flush()

    def flush(self) -> None:
        """Write what waits.

        Raises:
            RunFolderError: it cannot be written.
        """
        if not self._waiting:
            return
        piece = zlib.compress(b"".join(_with_length(payload) for payload in self._waiting), 1)
        self._waiting.clear()
        self._n_bytes = 0
        try:
            self._run_dir.make_folders(self._name)
            append_to(self._run_dir.path, self._name, _with_length(piece))
        except OSError as error:
            raise RunFolderError(str(machine_error(error, self._name, "a file that can be written"))) from error


def read_told(folder: Path, agent: str) -> Iterator[bytes]:
    """Yield the observations of an agent, from tick 0 on.

    Raises:
        SnapshotError: there are no more.
    """
    try:
        with (folder / f"{agent}.log").open("rb") as file:
            while piece := file.read(int.from_bytes(file.read(4), "big")):
                rest = zlib.decompress(piece)
                while rest:
                    n = int.from_bytes(rest[:4], "big")
                    yield rest[4 : 4 + n]
                    rest = rest[4 + n :]
    except (OSError, zlib.error) as error:
        raise SnapshotError(f"without what {agent} was told ({error})") from error
    raise SnapshotError(f"without all that {agent} was told")


def _with_length(data: bytes) -> bytes:
    return len(data).to_bytes(4, "big") + data
