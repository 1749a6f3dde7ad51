"""The window of a flight: whoever of its user connects, and is in no sandbox, is told how it goes, and no more."""

import contextlib
import json
import os
import secrets
import socket
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Self

from gslcosim.errors import UsageError
from gslcosim.runtime.run_dir import RunDir
from gslcosim.runtime.status import FlightStatus
from gslcosim.runtime.watching.own_process import user_id
from gslcosim.scenario import Scenario
from gslcosim.scenario.models.scenario import Processes
from gslcosim.socket_paths import socket_address
from gslcosim.socket_peers import check_peer
from gslcosim.ticks import seconds_from_ticks

SUFFIX = ".flight"
_SEND_WITHIN_S = 1.0
_QUEUE = 16


def windows_folder() -> Path:
    """Return where the windows of this user's flights are; it need not exist."""
    return Path(tempfile.gettempdir()) / f".gslcosim-flights-{user_id()}"


class FlightWindow:
    """Reports of a flight pass through here, and whoever connects to its unix socket gets the last one as JSON.

    A connection is answered and closed; nothing is read from it. Processes that are confined more than the flight, such
    as its agents, are only told why they are refused. Where no socket can be made, on Windows or on a full
    disk, the flight goes on without a window.

    Args:
        run_dir: The run.
        scenario: What is flown.
        processes: How the run is spread over processes.
        report: Is told every report, too.
    """

    def __init__(
        self, run_dir: RunDir, scenario: Scenario, processes: Processes, report: Callable[[FlightStatus], None]
    ) -> None:
        self._report = report
        self._tick_ns = scenario.tick_ns
        self._status = FlightStatus(state="starting")
        self._began_s = time.monotonic()
        self._facts: dict[str, Any] = {
            "run_id": run_dir.run_id,
            "run_dir": str(run_dir.path.resolve()),
            "scenario": scenario.name,
            "seed": scenario.seed,
            "processes": processes,
            "pid": os.getpid(),
            "began_at": datetime.now(UTC).isoformat(timespec="seconds"),
            "time_limit_s": scenario.referee.stop.time_limit_s,
        }
        self._path: Path | None = None
        self._listener: socket.socket | None = None

    def __enter__(self) -> Self:
        with contextlib.suppress(OSError):
            self._open()
        return self

    def __exit__(self, *_: object) -> None:
        listener, self._listener = self._listener, None
        if listener is None:
            return
        # Wakes the thread, which close alone does not.
        with contextlib.suppress(OSError):
            listener.shutdown(socket.SHUT_RDWR)
        listener.close()
        if self._path is not None:
            self._path.unlink(missing_ok=True)

    def __call__(self, status: FlightStatus) -> None:
        """Take a report, and pass it on."""
        self._status = status
        self._report(status)

    def look(self) -> dict[str, Any]:
        """Return what somebody who looks now is told."""
        status = self._status
        return {
            **self._facts,
            "state": status.state,
            "text": status.text,
            "wall_s": time.monotonic() - self._began_s,
            "sim_time_s": status.sim_time_s,
            "real_time_factor": status.real_time_factor,
            "participants": [
                {**asdict(participant), "sim_time_s": seconds_from_ticks(max(participant.tick, 0), self._tick_ns)}
                for participant in status.participants()
            ],
        }

    def _answer(self, connection: socket.socket) -> dict[str, Any]:
        try:
            check_peer(connection, place=str(self._facts["run_id"]))
        except UsageError as error:
            return {"refused": str(error)}
        return self.look()

    def _open(self) -> None:
        if sys.platform == "win32":
            return
        folder = windows_folder()
        folder.mkdir(mode=0o700, exist_ok=True)
        if folder.is_symlink() or folder.stat().st_uid != user_id() or folder.stat().st_mode & 0o077:
            return
        _remove_left(folder)
        path = folder / f"{os.getpid()}-{secrets.token_hex(3)}{SUFFIX}"
        listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        try:
            with socket_address(path) as address:
                listener.bind(address)
            listener.listen(_QUEUE)
        except OSError:
            listener.close()
            raise
        self._path, self._listener = path, listener
        threading.Thread(target=self._serve, args=(listener,), name="window", daemon=True).start()

    def _serve(self, listener: socket.socket) -> None:
        while self._listener is not None:
            try:
                connection, _ = listener.accept()
            except OSError:
                return
            with connection, contextlib.suppress(OSError):
                connection.settimeout(_SEND_WITHIN_S)
                connection.sendall(json.dumps(self._answer(connection)).encode())


# Of flights that were killed: nobody listens there any more.
def _remove_left(folder: Path) -> None:
    for window in folder.glob(f"*{SUFFIX}"):
        with contextlib.suppress(OSError), socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as caller:
            caller.settimeout(0)
            try:
                with socket_address(window) as address:
                    caller.connect(address)
            except ConnectionRefusedError:
                window.unlink()
