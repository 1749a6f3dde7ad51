"""A recording that was cut off is made whole again, and keeps what reached the disk."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from gslcosim.base.errors import RecordingError
from gslcosim_services.recorder.rerun_cli import is_complete, repair_recording

KILLED = """
import sys
sys.path[:0] = sys.argv[1:3]
from pathlib import Path
from built_rooms import build_closed_room
from scripted_flight import ScriptedFlight
from gslcosim.contract.participant import Episode
from gslcosim_services.recorder.core import RecorderCore

flight = ScriptedFlight(n_ticks=300)
core = RecorderCore(flight.scenario, build_closed_room(), Path(sys.argv[3]))
core.reset(Episode(seed=0))
for tick in range(300):
    core.step(tick, flight.inbox(tick))
sys.stdout.write("recorded")
sys.stdout.flush()
sys.stdin.read()
"""


@pytest.mark.parametrize("kept_frac", [0.4, 0.7, 0.95, 0.999])
def test_a_truncated_recording_is_whole_after_repair(record, rows_of, kept_frac):
    path = record(n_ticks=300)
    content = path.read_bytes()
    path.write_bytes(content[: int(kept_frac * len(content))])
    assert not is_complete(path)
    assert repair_recording(path)
    assert is_complete(path)
    assert not repair_recording(path)
    assert rows_of(path)["/room/outline"] == -1
    assert [item.name for item in path.parent.iterdir()] == [path.name]


@pytest.mark.parametrize("n_missing", [1, 31, 33])
def test_no_row_is_lost_when_only_the_footer_is(record, rows_of, n_missing):
    path = record(n_ticks=300)
    before = rows_of(path)
    path.write_bytes(path.read_bytes()[:-n_missing])
    assert repair_recording(path)
    assert rows_of(path) == before


@pytest.mark.slow
def test_a_killed_recorder_leaves_everything_up_to_the_verdict(rows_of, tmp_path):
    path = tmp_path / "recording.rrd"
    kit = Path(__file__).parents[3] / "kit"
    call = [sys.executable, "-c", KILLED, str(kit), str(Path(__file__).parent), str(path)]
    with subprocess.Popen(call, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as recorder:
        assert recorder.stdout is not None
        assert recorder.stdout.read(8) == "recorded"
        os.kill(recorder.pid, signal.SIGKILL)
        recorder.wait()
    assert not is_complete(path)
    assert repair_recording(path)
    rows = rows_of(path)
    assert rows["/vehicles/agent_0"] == 300
    assert rows["/summary"] == 2


@pytest.mark.parametrize("content", [b"", b"RRF2", b"not a recording at all, but long enough to be looked at twice"])
def test_a_file_without_anything_readable_is_reported_and_kept(tmp_path, content):
    path = tmp_path / "recording.rrd"
    path.write_bytes(content)
    with pytest.raises(RecordingError, match="expected a file of which something can be read"):
        repair_recording(path)
    assert path.read_bytes() == content
    assert [item.name for item in tmp_path.iterdir()] == [path.name]


def test_a_missing_recording_is_named(tmp_path):
    with pytest.raises(RecordingError, match=r"expected a file, was none\.\nFile: .*recording\.rrd"):
        repair_recording(tmp_path / "recording.rrd")
