"""What an agent, a log or a submission leaves in a folder of ours is removed or refused, whatever it is."""

import os
import resource
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from gslcosim.base.errors import UsageError
from gslcosim.base.files import OWNER_FILE, ScratchFolder, iterate_tree, list_files, remove_tree

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="no descriptors of folders, or other limits")
# Deeper than Python's recursion goes, and its path longer than the system takes.
DEEP, N_FILES = 2100, 1000
NOBODY = 65534


def nest(folder, n_levels=DEEP, *, name="d", mode=0o700):
    """Make folders in each other, each with a file."""
    inside = os.open(folder, os.O_RDONLY)
    for _ in range(n_levels):
        os.mkdir(name, dir_fd=inside)
        below = os.open(name, os.O_RDONLY, dir_fd=inside)
        os.close(os.open("file", os.O_CREAT | os.O_WRONLY, dir_fd=below))
        os.fchmod(inside, mode)
        os.close(inside)
        inside = below
    os.close(inside)


def nest_twice(folder):
    for name in ("a", "b"):
        nest(folder, 1100, name=name)


def leave_odd_files(folder):
    os.mkfifo(folder / "pipe")
    with socket.socket(socket.AF_UNIX) as unix:
        unix.bind(str(folder / "socket"))
    (folder / "nowhere").symlink_to("nothing")
    (folder / "itself").symlink_to("itself")
    for name in (b"\xff\xfe", b"line\nfeed", b"-rf", b" ", b"x" * 255):
        Path(os.fsdecode(os.fsencode(folder) + b"/" + name)).mkdir()
        Path(os.fsdecode(os.fsencode(folder) + b"/" + name + b"/" + name)).touch()


def leave_many_files(folder):
    for place in (folder, folder / "below"):
        place.mkdir(exist_ok=True)
        for i in range(N_FILES):
            (place / str(i)).touch()


@pytest.mark.parametrize("fill", [nest, nest_twice, leave_odd_files, leave_many_files])
def test_any_content_is_removed(tmp_path, monkeypatch, fill):
    monkeypatch.chdir(tmp_path)  # for the short path that a socket takes
    doomed = Path("doomed")
    doomed.mkdir()
    fill(doomed)
    limits = resource.getrlimit(resource.RLIMIT_NOFILE)
    n_open = max(int(path.name) for path in Path("/proc/self/fd").iterdir()) + 1
    resource.setrlimit(resource.RLIMIT_NOFILE, (n_open + 10, limits[1]))
    try:
        remove_tree(doomed)
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, limits)
    assert list(tmp_path.iterdir()) == []


def test_no_link_is_followed(tmp_path):
    kept, doomed = tmp_path / "kept", tmp_path / "doomed"
    (kept / "folder").mkdir(parents=True)
    (kept / "folder" / "file").write_text("mine")
    (doomed / "below").mkdir(parents=True)
    for place in (doomed, doomed / "below"):
        (place / "link").symlink_to(kept)
    remove_tree(doomed)
    assert (kept / "folder" / "file").read_text() == "mine"
    assert not doomed.exists()
    (tmp_path / "link").symlink_to(kept)
    with pytest.raises(OSError, match=r"symbolic links|Not a directory"):
        remove_tree(tmp_path / "link")
    assert (kept / "folder" / "file").read_text() == "mine"


# A user without root's rights, who may not enter each folder of his own.
WITHOUT_RIGHTS = """
import os, sys
from pathlib import Path
from gslcosim.base.files import remove_tree
os.chdir(sys.argv[1])
if os.geteuid() == 0:
    os.setgid(65534)
    os.setuid(65534)
for above in (0o300, 0o000):
    for mode in (0o000, 0o100, 0o200, 0o300, 0o400, 0o500, 0o600):
        folder = Path("doomed") / f"{above:o}" / f"{mode:o}"
        (folder / "deeper" / "deepest").mkdir(parents=True)
        (folder / "deeper" / "file").touch(mode=0o000)
        (folder / "deeper").chmod(mode)
        folder.chmod(above)
remove_tree(Path("doomed"))
print(os.listdir())
"""


def test_folders_without_permissions_are_given_them(tmp_path):
    (tmp_path / "place").mkdir()
    (tmp_path / "place").chmod(0o777)
    command = [sys.executable, "-c", WITHOUT_RIGHTS, str(tmp_path / "place")]
    ran = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (ran.stdout.strip(), ran.stderr) == ("[]", "")


@pytest.mark.parametrize("name", ["deep", "owner is a folder", "owner is a pipe", "owner is a link"])
def test_leftovers_never_stop_the_next_one(tmp_path, name):
    left = tmp_path / "gslcosim-left"
    left.mkdir()
    owner = left / OWNER_FILE
    if name == "deep":
        owner.touch()
        nest(left)
    elif name == "owner is a folder":
        owner.mkdir()
        nest(owner)
    elif name == "owner is a pipe":
        os.mkfifo(owner)
    else:
        owner.symlink_to("nothing")
        (left / "content").touch()
    os.utime(left, (0, 0))
    with ScratchFolder(parent=tmp_path):
        assert not left.exists()


def test_a_folder_of_its_own_is_removed_with_all_that_was_put_there(tmp_path):
    with ScratchFolder(parent=tmp_path) as scratch:
        (scratch.path / OWNER_FILE).unlink()
        (scratch.path / OWNER_FILE).mkdir()
        nest(scratch.path / OWNER_FILE)
    assert list(tmp_path.iterdir()) == []


def test_files_are_listed_without_links_to_folders_pipes_and_what_is_not_entered(tmp_path):
    (tmp_path / "b" / "deeper").mkdir(parents=True)
    for name in ("c", "b/deeper/x", "b/y"):
        (tmp_path / name).touch()
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "link").symlink_to(tmp_path / "b")
    (tmp_path / "again").symlink_to(tmp_path / "c")
    assert [path.relative_to(tmp_path).as_posix() for path in list_files(tmp_path)] == [
        "again",
        "b/deeper/x",
        "b/y",
        "c",
    ]
    found = iterate_tree(tmp_path, is_entered=lambda path: path.name != "deeper")
    assert sorted(path.name for path in found) == ["again", "c", "deeper", "link", "pipe", "y"]


@pytest.mark.parametrize("n_levels", [70, DEEP])
def test_folders_that_are_nested_too_deep_are_refused(tmp_path, n_levels):
    (tmp_path / "deep").mkdir()
    nest(tmp_path / "deep", n_levels)
    with pytest.raises(UsageError, match="expected folders at most 64 deep, was a deeper one"):
        list_files(tmp_path / "deep")
    remove_tree(tmp_path / "deep")
