"""How many threads and open files the processes of a run have: bounded, whatever it is made of."""

import contextlib
from pathlib import Path

import pytest
from real_runs import TINY_ROOM, children_of, command_of, start, with_agent

pytestmark = [pytest.mark.end_to_end]
LONG = ("--set", "referee.success.within_m=0.001", "--set", "referee.stop.time_limit_s=20000")
# The supervisor has the router's as well; a service five of Zenoh's and one a key that it reads.
MOST_THREADS, MOST_FILES = 40, 48


@pytest.mark.skipif(not Path("/proc/self/task").is_dir(), reason="only Linux tells")
def test_threads_and_descriptors_of_each_process_are_bounded(tmp_path):
    flight = start(TINY_ROOM, tmp_path, *LONG, *with_agent("holding"), is_recorded=True, is_fresh=True)
    flight.child("gslcosim_services recorder")
    flight.wait_until_flying()
    found = {}
    for pid in (flight.process.pid, *children_of(flight.process.pid)):
        place = Path(f"/proc/{pid}")
        with contextlib.suppress(FileNotFoundError, ProcessLookupError):  # a short-lived helper has ended since
            found[pid] = command_of(pid)[:80], *(len([*(place / kind).iterdir()]) for kind in ("task", "fd"))
    server = next(facts for facts in found.values() if "--fork-server" in facts[0])
    flight.abandon()
    assert len(found) >= 7
    assert all(n_threads <= MOST_THREADS and n_files <= MOST_FILES for _, n_threads, n_files in found.values()), found
    assert server[1] == 1
