"""A file behind a pipe: complete when it is closed, and the first write that fails is reported and stops nobody."""

import os
from pathlib import Path

import pytest

from gslcosim.base.errors import RecordingWriteError
from gslcosim.contract.participant import Episode
from gslcosim_services.recorder.core import RecorderCore
from gslcosim_services.recorder.recording_file import PipedFile

pytestmark = pytest.mark.skipif(not PipedFile.is_possible(), reason="there are no pipes with names")


@pytest.fixture
def largest_file():
    """Set the largest size of a file that this process may write, and lift the limit afterwards."""
    import resource

    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    yield lambda n_bytes: resource.setrlimit(resource.RLIMIT_FSIZE, (n_bytes, before[1]))
    resource.setrlimit(resource.RLIMIT_FSIZE, before)


def test_what_is_sent_is_written(tmp_path):
    content = os.urandom(3_000_000)
    file = PipedFile(tmp_path / "new" / "recording.rrd")
    with file.entrance.open("wb") as writer:
        file.close_write_end()
        writer.write(content[:1_000_000])
        writer.flush()
        file.wait_until_written()
        assert (tmp_path / "new" / "recording.rrd").read_bytes() == content[:1_000_000]
        writer.write(content[1_000_000:])
    file.close()
    assert (tmp_path / "new" / "recording.rrd").read_bytes() == content


def test_a_write_that_fails_is_reported_and_the_writer_goes_on(tmp_path, largest_file):
    file = PipedFile(tmp_path / "recording.rrd")
    expected = r"recording\.rrd: expected to write .* more after .*, was file too large\. .*recording\.enabled=false"
    largest_file(100_000)
    with file.entrance.open("wb") as writer:
        file.close_write_end()
        writer.write(bytes(5_000_000))
        writer.flush()
        with pytest.raises(RecordingWriteError, match=expected):
            file.wait_until_written()
    with pytest.raises(RecordingWriteError, match=expected):
        file.close()
    assert (tmp_path / "recording.rrd").stat().st_size == 100_000


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="there is no device that is always full")
def test_a_device_in_the_files_place_is_refused(tmp_path):
    (tmp_path / "recording.rrd").symlink_to("/dev/full")
    with pytest.raises(RecordingWriteError, match=r"symbolic link"):
        PipedFile(tmp_path / "recording.rrd")


@pytest.mark.parametrize("n_bytes", [0, 40_000, 250_000])
def test_a_recorder_without_room_fails_at_once_with_its_reason(make_room, tmp_path, largest_file, n_bytes):
    """From its first byte on, or in flight, or with its last rows; it never ends as if all were well."""
    from scripted_flight import ScriptedFlight

    flight = ScriptedFlight(n_ticks=3000)
    core = RecorderCore(flight.scenario, make_room(), tmp_path / "recording.rrd")
    largest_file(n_bytes)

    def record():
        core.reset(Episode(seed=0))
        for tick in range(flight.n_ticks):
            core.step(tick, flight.inbox(tick))
        core.close()

    with pytest.raises(RecordingWriteError, match=r"recording\.rrd: expected to write .*, was file too large"):
        record()
