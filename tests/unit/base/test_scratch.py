"""Temporary folders: what a killed process has left is removed by the next one, and nothing else is."""

import errno
import os
import signal
import socket
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from gslcosim.base.errors import MachineError
from gslcosim.base.files import ScratchFolder

OWNING = """
import sys
import tempfile
from pathlib import Path
from gslcosim.base.files import ScratchFolder
scratch = ScratchFolder("bench", parent=Path(sys.argv[1]))
(scratch.path / "content").write_text("something")
print(scratch.path, flush=True)
sys.stdin.read()
"""


def owner(parent):
    return subprocess.Popen(
        [sys.executable, "-c", OWNING, str(parent)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )


def names(folder):
    return sorted(path.name for path in folder.iterdir())


def test_a_closed_folder_is_gone(tmp_path):
    with ScratchFolder("check", parent=tmp_path) as scratch:
        assert scratch.path.name.startswith("gslcosim-check-")
        (scratch.path / "content").write_text("something")
    assert names(tmp_path) == []


@pytest.mark.skipif(sys.platform == "win32", reason="on Windows what is left stays")
def test_the_next_one_removes_what_a_killed_process_has_left(tmp_path):
    with owner(tmp_path) as process:
        left = Path(process.stdout.readline().strip())
        with ScratchFolder(parent=tmp_path):
            assert left.exists(), "its owner lives"
        os.kill(process.pid, signal.SIGKILL)
        process.wait()
    with ScratchFolder(parent=tmp_path):
        assert not left.exists()


KILLED_WHILE_IT_CLOSES = """
import os, signal, sys
from pathlib import Path
from gslcosim.base.files import ScratchFolder
scratch = ScratchFolder(parent=Path(sys.argv[1]))
for name in ("a", "b", "z"):
    (scratch.path / name).mkdir()
    (scratch.path / name / "content").write_text("something")
    (scratch.path / f"{name}.txt").write_text("something")
left = int(sys.argv[2])
def kill_itself(event, _):
    global left
    if event in ("os.remove", "os.rmdir"):
        left -= 1
        if left == 0:
            os.kill(os.getpid(), signal.SIGKILL)
sys.addaudithook(kill_itself)
scratch.close()
"""


# Six files, three folders, the owner and the folder itself.
@pytest.mark.skipif(sys.platform == "win32", reason="on Windows what is left stays")
@pytest.mark.parametrize("i_removal", [1, 2, 4, 6, 8, 9, 10, 11])
def test_the_next_one_removes_what_a_process_killed_while_it_closes_has_left(tmp_path, i_removal):
    ended = subprocess.run([sys.executable, "-c", KILLED_WHILE_IT_CLOSES, str(tmp_path), str(i_removal)], check=False)
    assert ended.returncode == -signal.SIGKILL
    (left,) = tmp_path.iterdir()
    os.utime(left, (0.0, 0.0))  # an empty folder may have been made just now by another process
    with ScratchFolder(parent=tmp_path):
        assert not left.exists()


def test_what_is_not_ours_is_left_alone(tmp_path):
    """A folder of that name without an owner's mark may be anybody's, for example of an older version."""
    (tmp_path / "gslcosim-older").mkdir()
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "elsewhere" / ".owner").touch()
    if sys.platform != "win32":
        (tmp_path / "gslcosim-link").symlink_to(tmp_path / "elsewhere")
    before = names(tmp_path)
    ScratchFolder(parent=tmp_path).close()
    assert names(tmp_path) == before


def test_a_place_that_cannot_be_written_is_reported(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(MachineError, match=r"temporary directory: expected a folder .* or set TMPDIR to a folder"):
        ScratchFolder(parent=tmp_path / "file")


def test_where_the_temporary_directory_has_a_long_name_sockets_go_elsewhere(tmp_path, monkeypatch):
    """Where nothing shorter can be written, that is reported in one sentence."""
    long, of_the_user = tmp_path / ("l" * 100), Path(tempfile.mkdtemp(prefix="gsl-test-", dir="/tmp"))
    long.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(long))
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(of_the_user))
    with ScratchFolder.for_sockets("check") as scratch, socket.socket(socket.AF_UNIX) as listener:
        assert scratch.path.parent == of_the_user
        listener.bind(str(scratch.path / "gateway.sock"))
    with ScratchFolder("check") as scratch:
        assert scratch.path.parent == long
    of_the_user.rmdir()
    monkeypatch.delenv("XDG_RUNTIME_DIR")
    monkeypatch.setattr(os, "access", lambda *_: False)
    with pytest.raises(MachineError, match=r"temporary directory: expected a path of at most 70 bytes, .* was one of"):
        ScratchFolder.for_sockets()


def test_a_short_temporary_directory_takes_sockets_itself(monkeypatch):
    place = Path(tempfile.mkdtemp(prefix="gsl-test-", dir="/tmp"))
    monkeypatch.setattr(tempfile, "tempdir", str(place))
    with ScratchFolder.for_sockets() as scratch:
        assert scratch.path.parent == place
    place.rmdir()


@pytest.mark.parametrize(("number", "remedy"), [(errno.EMFILE, "(ulimit -n)"), (errno.ENOSPC, "Free room there")])
def test_the_remedy_fits_what_the_temporary_directory_lacked(monkeypatch, number, remedy):
    def refuse(*_args, **_names):
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr(tempfile, "mkdtemp", refuse)
    with pytest.raises(MachineError) as refused:
        ScratchFolder()
    assert remedy in str(refused.value)
