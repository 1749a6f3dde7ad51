"""What attackers find beside their own run: a warm server and two other flights of the same user."""

import contextlib
import subprocess
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest
from deadlines import EVENT_S
from real_runs import COMMAND, TINY_ROOM, Flight, children_of, start, with_agent

from gslcosim.runtime.status import list_active_runs

# Longer than any attack takes, and as slow as the clock: they have to be there, not to take the processor from others.
LONG = ("--set", "referee.success.within_m=0.001", "--set", "referee.stop.time_limit_s=20000", "--pace", "1")
OTHER_RUNS = ("other_runs", "runs_of_the_server")


@dataclass
class Crowd:
    """The server, a flight of its own processes and one that the server flies, and the folder of their sockets."""

    sockets: Path
    server: subprocess.Popen
    flights: list[Flight]

    @property
    def pids(self) -> list[int]:
        """The processes of all of them."""
        tops = [self.server.pid, *(flight.process.pid for flight in self.flights)]
        return [*tops, *(pid for top in tops for pid in children_of(top))]

    def end(self) -> None:
        """End the flights; that nobody has touched them is seen in their results."""
        for flight in self.flights:
            assert flight.process.poll() is None, "the other flights go on"
            flight.process.terminate()
            ended = flight.end()
            assert ended.result["end_reason"] == "interrupted", ended.errors
            assert ended.result["faults"] == []
        assert self.server.poll() is None, "the server goes on"


@contextlib.contextmanager
def crowded(folder: Path) -> Iterator[Crowd]:
    """Serve and fly beside what happens within; the other runs are in `OTHER_RUNS` of the folder."""
    with _folder_of_sockets() as sockets, _serving() as server:
        own, of_server = (folder / name for name in OTHER_RUNS)
        flights = [
            start(TINY_ROOM, own, *LONG, *with_agent("holding")),
            start(TINY_ROOM, of_server, *LONG, *with_agent("holding"), "--warm"),
        ]
        try:
            for flight in flights:
                flight.wait_until_flying()
            assert len(list_active_runs()) == len(flights)
            yield Crowd(sockets, server, flights)
        finally:
            for flight in flights:
                flight.abandon()


# For sockets alone, with a name that is short.
@contextlib.contextmanager
def _folder_of_sockets() -> Iterator[Path]:
    with tempfile.TemporaryDirectory(prefix="a-") as folder, pytest.MonkeyPatch.context() as patch:
        patch.setenv("TMPDIR", folder)
        patch.setattr("tempfile.tempdir", None)
        yield Path(folder)


@contextlib.contextmanager
def _serving() -> Iterator[subprocess.Popen]:
    process = subprocess.Popen([*COMMAND, "serve"], stdout=subprocess.PIPE, text=True, start_new_session=True)
    try:
        assert "--warm" in process.stdout.readline()
        yield process
    finally:
        process.terminate()
        process.wait(EVENT_S)
        process.stdout.close()
