"""Other runs of the same user, beside that of an attacker."""

import contextlib
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest
from real_runs import TINY_ROOM, Flight, children_of, start, with_agent

from gslcosim.runtime.status import list_active_runs

# Longer than any attack takes, and as slow as the clock: they have to be there, not to take the processor from others.
LONG = ("--set", "referee.success.within_m=0.001", "--set", "referee.stop.time_limit_s=20000", "--pace", "1")
OTHER_RUNS = ("other_runs", "more_runs")


@dataclass
class Crowd:
    """Two runs, and the folder of their sockets."""

    sockets: Path
    flights: list[Flight]

    @property
    def pids(self) -> list[int]:
        """The processes of all of them."""
        tops = [flight.process.pid for flight in self.flights]
        return [*tops, *(pid for top in tops for pid in children_of(top))]

    def end(self) -> None:
        """End the runs; their results show whether they were disturbed."""
        for flight in self.flights:
            assert flight.process.poll() is None, "the other flights go on"
            flight.process.terminate()
            ended = flight.end()
            assert ended.result["end_reason"] == "interrupted", ended.errors
            assert ended.result["faults"] == []


@contextlib.contextmanager
def crowded(folder: Path) -> Iterator[Crowd]:
    """Fly beside what happens within; the other runs are in `OTHER_RUNS` of the folder."""
    with _folder_of_sockets() as sockets:
        flights = [start(TINY_ROOM, folder / name, *LONG, *with_agent("holding")) for name in OTHER_RUNS]
        try:
            for flight in flights:
                flight.wait_until_flying()
            assert len(list_active_runs()) == len(flights)
            yield Crowd(sockets, flights)
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
