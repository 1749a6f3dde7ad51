"""A file is read as it grows, whole and once."""

import threading

import pytest

from gslcosim.base.errors import RecordingError
from gslcosim.recordings import viewer
from gslcosim.recordings.viewer import LiveViewer, tail_file


def test_a_growing_file_is_read_whole_and_once(tmp_path):
    path = tmp_path / "grows"
    parts = [bytes([i]) * (1 + 1000 * i) for i in range(40)]
    is_read, is_over = threading.Semaphore(0), threading.Event()

    def write():
        with path.open("wb", buffering=0) as file:
            for part in parts:
                file.write(part)
                is_read.acquire()
        is_over.set()

    writer = threading.Thread(target=write)
    writer.start()
    read = b""
    n_seen = 0
    for data in tail_file(path, is_over.is_set):
        read += data
        while n_seen < len(parts) and len(read) >= sum(map(len, parts[: n_seen + 1])):
            n_seen += 1
            is_read.release()
    writer.join()
    assert read == b"".join(parts)
    assert n_seen == len(parts), "each part was read before the next was written"


def test_what_is_written_before_the_end_is_sent_is_read(tmp_path):
    path = tmp_path / "file"

    def is_over():
        if not path.exists():
            path.write_bytes(b"at the last moment")
        return True

    assert b"".join(tail_file(path, is_over)) == b"at the last moment"


def test_a_file_that_never_comes_ends_with_its_writer(tmp_path):
    assert list(tail_file(tmp_path / "none", lambda: True)) == []


def test_a_file_that_is_replaced_is_read_as_it_was_opened(tmp_path):
    path = tmp_path / "file"
    path.write_bytes(b"first")
    data = tail_file(path, lambda: True)
    assert next(data) == b"first"
    (tmp_path / "other").write_bytes(b"second and longer")
    (tmp_path / "other").replace(path)
    assert list(data) == []


def test_a_viewer_that_takes_nothing_is_reported(tmp_path, monkeypatch):
    monkeypatch.setattr(viewer, "_STALL_S", 0.1)
    path = tmp_path / "recording.rrd"
    path.write_bytes(bytes(1 << 20))  # more than a pipe holds
    # Before the viewer's own command line: a program that reads nothing, and does not start it.
    sleeper = ("/bin/sh", "-c", "exec sleep 1000", "sh")
    live = LiveViewer("browser", lambda _: None, prefix=sleeper)
    try:
        live.show(path, lambda: True)
        with pytest.raises(RecordingError, match="took nothing for 0"):
            live.wait_until_shown()
    finally:
        live.close()
