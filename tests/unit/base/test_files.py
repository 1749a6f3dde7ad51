"""Files of a run are replaced at once, and never written through what an agent has put in their place."""

import os
import sys
from pathlib import Path

import pytest

from gslcosim.base.files import append_bytes, open_for_writing, open_regular_file, read_regular_file, replace_file

needs_links = pytest.mark.skipif(sys.platform == "win32", reason="Windows follows links")


def test_what_is_appended_is_behind_what_was_there(tmp_path):
    (tmp_path / "logs").mkdir()
    for line in (b"one\n", b"two\n"):
        append_bytes(tmp_path, "logs/a.log", line)
    assert (tmp_path / "logs" / "a.log").read_bytes() == b"one\ntwo\n"


def test_a_replaced_file_is_new_and_nothing_is_left_beside_it(tmp_path):
    for content in (b"a longer text\n", b"short\n"):
        replace_file(tmp_path, "result.json", content)
    assert (tmp_path / "result.json").read_bytes() == b"short\n"
    assert [path.name for path in tmp_path.iterdir()] == ["result.json"]


@needs_links
def test_what_cannot_be_replaced_stays_as_it_was(tmp_path):
    (tmp_path / "result.json").mkdir()
    with pytest.raises(OSError, match="directory"):
        replace_file(tmp_path, "result.json", b"new")
    assert [path.name for path in tmp_path.iterdir()] == ["result.json"]


@needs_links
def test_a_link_is_replaced_and_not_followed(tmp_path):
    foreign = tmp_path / "foreign"
    foreign.write_text("kept")
    run = tmp_path / "run"
    run.mkdir()
    (run / "result.json").symlink_to(foreign)
    replace_file(run, "result.json", b"new")
    assert (run / "result.json").read_bytes() == b"new"
    assert not (run / "result.json").is_symlink()
    assert foreign.read_text() == "kept"


@needs_links
@pytest.mark.parametrize("name", ["inputs.log", "logs/agent.log"])
def test_nothing_is_appended_through_a_link(tmp_path, name):
    foreign = tmp_path / "foreign"
    (foreign / "logs").mkdir(parents=True)
    run = tmp_path / "run"
    run.mkdir()
    (run / "inputs.log").symlink_to(foreign / "inputs.log")
    (run / "logs").symlink_to(foreign / "logs")
    with pytest.raises(OSError, match=r"symbolic links|Not a directory"):
        append_bytes(run, name, b"new")
    assert [path for path in foreign.rglob("*") if path.is_file()] == []


@needs_links
def test_a_folder_that_became_a_link_is_not_written_to(tmp_path):
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "run").symlink_to(tmp_path / "elsewhere")
    with pytest.raises(OSError, match=r"symbolic links|Not a directory"):
        replace_file(tmp_path / "run", "result.json", b"new")
    assert list((tmp_path / "elsewhere").iterdir()) == []


@needs_links
def test_a_pipe_in_a_files_place_does_not_stop_the_run(tmp_path):
    os.mkfifo(tmp_path / "inputs.log")
    with pytest.raises(OSError, match="No such device or address"):
        open_for_writing(tmp_path, "inputs.log", is_appended=True)
    reader = os.open(tmp_path / "inputs.log", os.O_RDONLY | os.O_NONBLOCK)
    try:
        with pytest.raises(OSError, match=r"something that is no file"):
            append_bytes(tmp_path, "inputs.log", b"new")
    finally:
        os.close(reader)


@needs_links
def test_only_files_are_read_and_only_so_much(tmp_path):
    (tmp_path / "file").write_bytes(b"12345")
    assert read_regular_file(tmp_path / "file", max_bytes=5) == b"12345"
    with pytest.raises(OSError, match="more than 4 bytes"):
        read_regular_file(tmp_path / "file", max_bytes=4)
    os.mkfifo(tmp_path / "pipe")
    for path in (tmp_path / "pipe", Path("/dev/zero"), tmp_path):
        with pytest.raises(OSError, match=r"a (pipe|folder|device|socket) and no file"):
            read_regular_file(path, max_bytes=5)
        with pytest.raises(OSError, match=r"a (pipe|folder|device|socket) and no file"):
            open_regular_file(path)
