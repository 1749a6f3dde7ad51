"""Status of a run while it goes on, served on a unix socket of its user: `gslcosim runs active`, `top` and `stop`."""

import contextlib
import json
import os
import secrets
import signal
import socket
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, NotRequired, TypedDict

from gslcosim.base.errors import RunTimeoutError, UsageError
from gslcosim.base.sockets import check_peer, read_peer_pid, short_socket_address
from gslcosim.base.ticks import seconds_from_ticks
from gslcosim.base.untrusted_input import JsonObject, MalformedFileError, parse_json, validate_value
from gslcosim.runtime.participant_status import ParticipantStatus, explain_stall
from gslcosim.runtime.run_dir import RunDir
from gslcosim.scenario import Scenario
from gslcosim.scenario.models.scenario import Processes

STATUS_PERIOD_S = 0.1
# Participants that have not joined by then are named in a log, too; a stopped one may still join.
LATE_AFTER_S = 4.0
SOCKET_SUFFIX = ".flight"
# A run without progress for this long gets an explanation.
STALL_SHOWN_AFTER_S = 3.0
_SEND_TIMEOUT_S = 1.0
_BACKLOG = 16
QUERY_TIMEOUT_S = 2.0
STOP_TIMEOUT_S = 20.0
_POLL_PERIOD_S = 0.05
# The status on a socket takes a few hundred bytes for each participant.
_MAX_STATUS_BYTES = 4_000_000
# Facts of a run whose process does not answer.
_UNKNOWN_FACTS: dict[str, Any] = {
    **dict.fromkeys(("run_id", "run_dir", "processes", "began_at", "text"), ""),
    **dict.fromkeys(("wall_s", "sim_time_s", "time_limit_s", "real_time_factor"), 0.0),
    "state": "silent",
    "participants": [],
}


@dataclass(frozen=True, kw_only=True)
class RunStatus:
    """Status of a run at one moment.

    `state` is `preparing`, `starting`, `flying`, `closing` or `ended`; `fraction` is the finished share of the present
    piece of work (absent if unknown); `text` is one short sentence. With `is_late`, the work takes longer than it
    should; with `is_compiling`, kernels are being compiled, which takes a minute in the first run of a version.
    `participants` may be called on any thread during the run, and returns their status at that time. `run_dir` is set
    from the state `starting` on.
    """

    state: str
    text: str = ""
    fraction: float | None = None
    sim_time_s: float = 0.0
    real_time_factor: float = 0.0
    is_late: bool = False
    is_compiling: bool = False
    participants: Callable[[], list[ParticipantStatus]] = list
    run_dir: Path | None = None


@dataclass(frozen=True, kw_only=True)
class RunResult:
    """The end of a run: exit code, run directory, and the content of its `result.json`."""

    exit_code: int
    run_dir: Path
    result: dict[str, Any] = field(default_factory=dict[str, Any])


class StatusReporter:
    """Reporter of a run's status: not too often, but each state at once."""

    def __init__(
        self,
        report: Callable[[RunStatus], None],
        tick_ns: int,
        participants: Callable[[], list[ParticipantStatus]],
    ) -> None:
        self._report = report
        self._tick_ns = tick_ns
        self._participants = participants
        self._reported_at_s, self._reported_state = 0.0, ""

    def report_awaited(self, names: Sequence[str], waited_s: float) -> None:
        """Report the participants that have not joined yet, and after a while the duration of the wait."""
        text, is_late = f"waiting for {', '.join(names)}", waited_s > LATE_AFTER_S
        if is_late:
            text = f"{text}, not here after {waited_s:.0f} s"
        self._report_status(RunStatus(state="starting", text=text, is_late=is_late))

    def report_run(self, state: str, tick: int, wall_s: float, text: str = "") -> None:
        """Report the progress of the run, and notes."""
        sim_time_s = seconds_from_ticks(tick, self._tick_ns)
        factor = sim_time_s / wall_s if wall_s > 0 else 0.0
        self._report_status(RunStatus(state=state, text=text, sim_time_s=sim_time_s, real_time_factor=factor))

    def _report_status(self, status: RunStatus) -> None:
        now_s = time.monotonic()
        if status.state != self._reported_state or now_s - self._reported_at_s >= STATUS_PERIOD_S:
            self._reported_at_s, self._reported_state = now_s, status.state
            self._report(replace(status, participants=self._participants))


def get_status_folder() -> Path:
    """Return the folder of the sockets of this user's runs; it need not exist."""
    user_id = 0 if sys.platform == "win32" else os.getuid()
    return Path(tempfile.gettempdir()) / f".gslcosim-flights-{user_id}"


class StatusServer:
    """Server of a run's status: reports pass through it, and a client of its unix socket gets the last one as JSON.

    A connection is answered and closed; nothing is read from it. Processes that are confined more than the run, such
    as its agents, only get the reason why they are refused. Where no socket can be made, on Windows or on a full
    disk, the run goes on without a window.
    """

    def __init__(
        self, run_dir: RunDir, scenario: Scenario, processes: Processes, report: Callable[[RunStatus], None]
    ) -> None:
        self._report = report
        self._tick_ns = scenario.tick_ns
        self._status = RunStatus(state="starting")
        self._began_s = self._moved_at_s = time.monotonic()
        self._facts: dict[str, Any] = {
            "run_id": run_dir.path.name,
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
        with contextlib.suppress(OSError):
            self._open()

    def close(self) -> None:
        """Close the socket."""
        listener, self._listener = self._listener, None
        if listener is None:
            return
        # Wakes the thread; `close` alone would not.
        with contextlib.suppress(OSError):
            listener.shutdown(socket.SHUT_RDWR)
        listener.close()
        if self._path is not None:
            self._path.unlink(missing_ok=True)

    def __call__(self, status: RunStatus) -> None:
        """Take a report, and pass it on."""
        if (status.state, status.sim_time_s) != (self._status.state, self._status.sim_time_s):
            self._moved_at_s = time.monotonic()
        self._status = status
        self._report(status)

    def look(self) -> dict[str, Any]:
        """Return the status as a client gets it now; `stall` explains why nothing moves, and is empty otherwise."""
        status = self._status
        participants = status.participants()
        still_s = time.monotonic() - self._moved_at_s
        stall = explain_stall(participants) if status.state == "flying" and still_s > STALL_SHOWN_AFTER_S else None
        return {
            **self._facts,
            "state": status.state,
            "text": status.text,
            "wall_s": time.monotonic() - self._began_s,
            "sim_time_s": status.sim_time_s,
            "real_time_factor": status.real_time_factor,
            "participants": [
                {
                    **asdict(participant),
                    "waits_for": participant.waits_for,
                    "sim_time_s": seconds_from_ticks(max(participant.tick, 0), self._tick_ns),
                }
                for participant in participants
            ],
            "stall": f"nothing has moved for {still_s:.0f} s\n{stall.text}" if stall is not None else "",
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
        folder = get_status_folder()
        folder.mkdir(mode=0o700, exist_ok=True)
        if folder.is_symlink() or folder.stat().st_uid != os.getuid() or folder.stat().st_mode & 0o077:
            return
        _remove_stale(folder)
        path = folder / f"{os.getpid()}-{secrets.token_hex(3)}{SOCKET_SUFFIX}"
        listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        try:
            with short_socket_address(path) as address:
                listener.bind(address)
            listener.listen(_BACKLOG)
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
                connection.settimeout(_SEND_TIMEOUT_S)
                connection.sendall(json.dumps(self._answer(connection)).encode())


# Sockets of killed runs, on which no process listens.
def _remove_stale(folder: Path) -> None:
    for window in folder.glob(f"*{SOCKET_SUFFIX}"):
        with contextlib.suppress(OSError), socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as caller:
            caller.settimeout(0)
            try:
                with short_socket_address(window) as address:
                    caller.connect(address)
            except ConnectionRefusedError:
                window.unlink()


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


class _RunFacts(TypedDict):
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
    stall: NotRequired[str]


@dataclass(frozen=True)
class ActiveRun:
    """Active run.

    `facts` are those of `StatusServer.look`; `looked_at_s` is their time by a monotonic clock; `pid` is the process
    behind the window, as reported by the operating system and not by the run.
    """

    window: Path
    pid: int
    facts: dict[str, Any]
    looked_at_s: float

    @property
    def run_id(self) -> str:
        """The name of the run."""
        return self.facts["run_id"] or f"process {self.pid}"


def list_active_runs() -> list[ActiveRun]:
    """Return the active runs of this user, the oldest first; sockets of killed runs are removed."""
    found = [query_status(window) for window in get_status_folder().glob(f"*{SOCKET_SUFFIX}")]
    return sorted((flight for flight in found if flight is not None), key=lambda flight: flight.facts["began_at"])


def query_status(window: Path) -> ActiveRun | None:
    """Return the run behind a window; None where it has ended.

    It is `silent` where it answers nothing in time, `refused`, with the reason as its `text`, where it and this process
    are not confined alike, and `unreadable` where it answers something else than runs do.
    """
    if sys.platform == "win32":
        return None
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as connection, contextlib.suppress(OSError, ValueError):
        connection.settimeout(QUERY_TIMEOUT_S)
        try:
            with short_socket_address(window) as address:
                connection.connect(address)
        except ConnectionRefusedError:
            window.unlink(missing_ok=True)
            return None
        try:
            check_peer(connection, place=window.name)
            facts = parse_json(_read_all(connection), JsonObject, place=window.name)
            if "refused" in facts:
                raise UsageError(str(facts["refused"]))
            validate_value(facts, _RunFacts, place=window.name)
        except MalformedFileError as error:
            facts = _UNKNOWN_FACTS | {"state": "unreadable", "text": str(error)}
        except UsageError as error:
            facts = _UNKNOWN_FACTS | {"state": "refused", "text": str(error)}
        except TimeoutError:
            facts = _UNKNOWN_FACTS
        # On systems other than Linux it is the one in the window's name.
        pid = read_peer_pid(connection) if sys.platform == "linux" else int(window.name.partition("-")[0])
        return ActiveRun(window, pid, facts, time.monotonic())
    return None


def find_active_run(run: str | None) -> ActiveRun:
    """Return the active run of an id or folder.

    Args:
        run: The run's id or the beginning of it, or its folder; None is the only one that goes on.
    """
    flights = list_active_runs()
    fitting = [
        flight
        for flight in flights
        if run is None or flight.run_id.startswith(run) or os.path.realpath(run) == flight.facts["run_dir"]
    ]
    if len(fitting) == 1:
        return fitting[0]
    names = ", ".join(flight.run_id for flight in flights) or "none"
    if run is None and not flights:
        raise UsageError("No run is active.")
    if run is None:
        raise UsageError(f"Several runs are active, name one of them: {names}.")
    raise UsageError(f"No single active run has the id or folder {run}; active runs: {names}.")


def stop_run(flight: ActiveRun) -> None:
    """Interrupt a run as Ctrl-C does, and wait until it has ended in order."""
    with contextlib.suppress(ProcessLookupError):
        os.kill(flight.pid, signal.SIGINT)
    deadline_s = time.monotonic() + STOP_TIMEOUT_S
    while flight.window.exists():
        if time.monotonic() > deadline_s:
            raise RunTimeoutError(
                f"The run {flight.run_id} did not end within {STOP_TIMEOUT_S:g} s. "
                f"End its process with `kill -9 {flight.pid}`."
            )
        time.sleep(_POLL_PERIOD_S)


def _read_all(connection: socket.socket) -> bytes:
    data = bytearray()
    deadline_s = time.monotonic() + QUERY_TIMEOUT_S
    while part := connection.recv(65536):
        data += part
        if len(data) > _MAX_STATUS_BYTES or time.monotonic() > deadline_s:
            raise TimeoutError
    return bytes(data)
