"""Flights of this user that go on now: found by their windows, looked at, stopped."""

import contextlib
import os
import signal
import socket
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypedDict

from gslcosim.errors import RunTimeoutError, UsageError
from gslcosim.foreign_json import ForeignFileError, JsonObject, checked_value, parse_json
from gslcosim.runtime.watching.window import SUFFIX, windows_folder
from gslcosim.socket_paths import socket_address
from gslcosim.socket_peers import check_peer, peer_pid

LOOK_WITHIN_S = 2.0
STOP_WITHIN_S = 20.0
_LOOK_AGAIN_S = 0.05

# What a status socket tells is a few hundred bytes for each participant.
_MAX_STATUS_BYTES = 4_000_000


class _ParticipantFacts(TypedDict):
    name: str
    state: str
    tick: int
    waits_for: list[str]
    queued_ticks: int
    pid: int | None
    cpu_s: float | None
    memory_bytes: int | None
    n_resends: int


class _FlightFacts(TypedDict):
    run_id: str
    run_dir: str
    processes: str | list[object]
    began_at: str
    state: str
    text: str
    wall_s: float
    sim_time_s: float
    time_limit_s: float
    real_time_factor: float
    participants: list[_ParticipantFacts]


# Of a flight whose process stands still.
_UNTOLD: dict[str, Any] = {
    "run_id": "",
    "run_dir": "",
    "processes": "",
    "began_at": "",
    "state": "silent",
    "text": "",
    "wall_s": 0.0,
    "sim_time_s": 0.0,
    "time_limit_s": 0.0,
    "real_time_factor": 0.0,
    "participants": [],
}


@dataclass(frozen=True)
class RunningFlight:
    """A flight that goes on.

    `facts` are those of `FlightWindow.look`; `looked_at_s` is when, by a monotonic clock; `pid` is that of the process
    behind the window, as the system says and not the flight.
    """

    window: Path
    pid: int
    facts: dict[str, Any]
    looked_at_s: float

    @property
    def run_id(self) -> str:
        """The name of the run."""
        return self.facts["run_id"] or f"process {self.pid}"


def running_flights() -> list[RunningFlight]:
    """Return the flights of this user that go on now, the oldest first; windows of killed flights are removed."""
    found = [look_through(window) for window in windows_folder().glob(f"*{SUFFIX}")]
    return sorted((flight for flight in found if flight is not None), key=lambda flight: flight.facts["began_at"])


def look_through(window: Path) -> RunningFlight | None:
    """Return the flight behind a window; None where it has ended.

    It is `silent` where it tells nothing in time, `refused`, with the reason as its `text`, where it and this process
    are not confined alike, and `unreadable` where it tells something else than flights do.
    """
    if sys.platform == "win32":
        return None
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as connection, contextlib.suppress(OSError, ValueError):
        connection.settimeout(LOOK_WITHIN_S)
        try:
            with socket_address(window) as address:
                connection.connect(address)
        except ConnectionRefusedError:
            window.unlink(missing_ok=True)
            return None
        try:
            check_peer(connection, place=window.name)
            facts = parse_json(_all_of(connection), JsonObject, place=window.name)
            if "refused" in facts:
                raise UsageError(str(facts["refused"]))
            checked_value(facts, _FlightFacts, place=window.name)
        except ForeignFileError as error:
            facts = _UNTOLD | {"state": "unreadable", "text": str(error)}
        except UsageError as error:
            facts = _UNTOLD | {"state": "refused", "text": str(error)}
        except TimeoutError:
            facts = _UNTOLD
        return RunningFlight(window, _pid_of(connection, window), facts, time.monotonic())
    return None


def find_flight(run: str | None) -> RunningFlight:
    """Return the flight that a person names.

    Args:
        run: The run's id or the beginning of it, or its folder; None is the only one that goes on.

    Raises:
        UsageError: none fits, or several do.
    """
    flights = running_flights()
    fitting = [flight for flight in flights if run is None or _is_meant(run, flight)]
    if len(fitting) == 1:
        return fitting[0]
    names = ", ".join(flight.run_id for flight in flights) or "none"
    if run is None:
        wanted = "one flight that goes on, or the name of one of several"
        raise UsageError(f"RUN: expected {wanted}, found {names}.")
    raise UsageError(f"{run}: expected the id or folder of one flight that goes on, found {names}.")


def stop_flight(flight: RunningFlight) -> None:
    """Interrupt a flight as Ctrl-C does, and wait until it has ended in order.

    Raises:
        RunTimeoutError: it goes on nevertheless.
    """
    with contextlib.suppress(ProcessLookupError):
        os.kill(flight.pid, signal.SIGINT)
    deadline_s = time.monotonic() + STOP_WITHIN_S
    while flight.window.exists():
        if time.monotonic() > deadline_s:
            raise RunTimeoutError(
                f"{flight.run_id}: expected its end within {STOP_WITHIN_S:g} s, goes on. "
                f"End its process {flight.pid} with: kill -9 {flight.pid}"
            )
        time.sleep(_LOOK_AGAIN_S)


def _is_meant(run: str, flight: RunningFlight) -> bool:
    return flight.run_id.startswith(run) or os.path.realpath(run) == flight.facts["run_dir"]


def _all_of(connection: socket.socket) -> bytes:
    data = bytearray()
    deadline_s = time.monotonic() + LOOK_WITHIN_S
    while part := connection.recv(65536):
        data += part
        if len(data) > _MAX_STATUS_BYTES or time.monotonic() > deadline_s:
            raise TimeoutError
    return bytes(data)


# Elsewhere than on Linux it is the one in the window's name.
def _pid_of(connection: socket.socket, window: Path) -> int:
    return peer_pid(connection) if sys.platform == "linux" else int(window.name.partition("-")[0])
