"""What the cache holds, what is in use, and what goes first; entries that a process uses are never removed."""

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from gslcosim.base.disk_cache import (
    DEFAULT_LIMIT_BYTES,
    UNUSED_KERNELS_S,
    CacheEntry,
    choose_unused,
    keep_within_limit,
    limit_from_environment,
    list_entries,
    mark_used,
    parse_size_bytes,
    remove_entries,
)
from gslcosim.base.errors import UsageError

HASH = "0123456789abcdef"
DAY_S = 86400.0
NOW_S = 1e9


@pytest.fixture
def cache(tmp_path, monkeypatch):
    """A cache of its own; `add` puts an entry of so many kB into it that was used so many days ago."""
    root = tmp_path / "cache"
    monkeypatch.setenv("GSLCOSIM_CACHE", str(root))

    def add(folder, n_kb, unused_days):
        entry = root / folder
        (entry / "within").mkdir(parents=True)
        (entry / "within" / "data").write_bytes(os.urandom(n_kb * 1024))
        used_at_s = time.time() - unused_days * DAY_S
        os.utime(entry, (used_at_s, used_at_s))
        return entry

    return root, add


def entry(name, *, kind="tape", size_bytes=100, unused_days=0.0, is_in_use=False):
    used_at_s = NOW_S - unused_days * DAY_S
    return CacheEntry(
        kind=kind, folder=Path(name), size_bytes=size_bytes, used_at_s=used_at_s, is_in_use=is_in_use
    )  # fmt: skip


def names(entries):
    return [entry.folder.name for entry in entries]


def test_nothing_goes_within_the_limit_but_old_kernels():
    """Each version of the code leaves a folder of kernels behind."""
    assert UNUSED_KERNELS_S == 30 * DAY_S
    entries = [
        entry("old tape", unused_days=400), entry("kernels", kind="kernels", unused_days=29),
        entry("old kernels", kind="kernels", unused_days=31),
        entry("used kernels", kind="kernels", unused_days=31, is_in_use=True),
    ]  # fmt: skip
    assert names(choose_unused(entries, 400, NOW_S)) == ["old kernels"]


def test_what_was_unused_for_longest_goes_first_and_no_more_than_needed():
    entries = [entry(f"{days}", unused_days=days) for days in (1, 4, 2, 3)]
    assert names(choose_unused(entries, 250, NOW_S)) == ["4", "3"]
    assert names(choose_unused(entries, 0, NOW_S)) == ["4", "3", "2", "1"]
    assert choose_unused(entries, float("inf"), NOW_S) == []


def test_what_is_in_use_and_what_nobody_makes_again_by_itself_stays():
    entries = [
        entry("used", unused_days=9, is_in_use=True), entry("built", kind="program", unused_days=8),
        entry("tape", unused_days=1), entry("room", kind="room"),
    ]  # fmt: skip
    assert names(choose_unused(entries, 300, NOW_S)) == ["tape"]


def test_entries_have_kind_size_and_age(cache):
    root, add = cache
    add(f"tapes/{HASH}", 100, 2)
    add(f"environments/{HASH}", 10, 1)
    add(f"numba/{HASH}-0", 1, 3)
    add("agents/dung_beetle_c", 1, 4)
    add(f"tapes/.{HASH}.being_made", 1, 0)
    add("environments/.fetched.left", 1, 5)
    (root / "tapes" / "link").symlink_to(root / "environments")
    (root / "code").mkdir()
    found = list_entries()
    assert [(each.kind, each.folder.name) for each in found] == [
        ("room", HASH), ("tape", HASH), ("kernels", f"{HASH}-0"), ("program", "dung_beetle_c"),
        ("room", ".fetched.left"),
    ]  # fmt: skip
    assert 100 * 1024 <= found[1].size_bytes < 130 * 1024
    assert not any(each.is_in_use for each in found)


def test_no_cache_holds_nothing(cache):
    assert list_entries() == []
    assert remove_entries(list) == []
    assert keep_within_limit() == []


def test_what_is_chosen_is_removed(cache):
    root, add = cache
    kept, gone = add(f"tapes/{HASH}", 1, 0), add(f"tapes/{HASH}00", 1, 0)
    removed = remove_entries(lambda entries: [each for each in entries if each.folder == gone])
    assert [each.folder for each in removed] == [gone]
    assert list((root / "tapes").iterdir()) == [kept]


USER = """
import os, sys
from pathlib import Path
from gslcosim.base.disk_cache import mark_used
mark_used(Path(sys.argv[1]))
if len(sys.argv) > 2 and os.fork():
    os._exit(0)
sys.stdout.write("marked\\n")
sys.stdout.flush()
sys.stdin.read()
"""


@pytest.mark.skipif(sys.platform == "win32", reason="files are locked otherwise there")
@pytest.mark.parametrize("forked", [(), ("forked",)], ids=["itself", "fork"])
def test_what_a_process_uses_stays_until_it_and_its_forks_have_ended(cache, forked):
    root, add = cache
    used, other = add(f"tapes/{HASH}", 1, 9), add(f"environments/{HASH}", 1, 9)
    command = [sys.executable, "-c", USER, str(used), *forked]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        assert process.stdin is not None
        assert process.stdout.readline() == b"marked\n"
        entries = {each.folder: each for each in list_entries()}
        assert entries[used].is_in_use
        assert entries[used].used_at_s > entries[other].used_at_s
        assert [each.folder for each in remove_entries(lambda entries: entries)] == [other]
        assert used.is_dir()
        process.stdin.close()
        # Its end: nobody holds the other end of the pipe any more.
        assert process.stdout.read() == b""
        process.wait()
        while list_entries()[0].is_in_use:
            os.sched_yield()
    assert [each.folder for each in remove_entries(lambda entries: entries)] == [used]
    # The files of processes that have ended go with the next that uses something.
    mark_used(add(f"tapes/{HASH}11", 1, 0))
    assert len(list((root / "leases").iterdir())) == 1


def test_a_folder_elsewhere_is_none_of_the_caches(cache, tmp_path):
    root, _ = cache
    (tmp_path / "room").mkdir()
    os.utime(tmp_path / "room", (1.0, 1.0))
    mark_used(tmp_path / "room")
    assert not root.exists()
    assert (tmp_path / "room").stat().st_mtime == 1.0


def test_the_cache_keeps_within_the_limit_of_the_environment(cache, monkeypatch):
    _, add = cache
    old, young = add(f"tapes/{HASH}", 100, 2), add(f"tapes/{HASH}00", 100, 1)
    monkeypatch.setenv("GSLCOSIM_CACHE_LIMIT", "150KB")
    assert [each.folder for each in keep_within_limit()] == [old]
    monkeypatch.setenv("GSLCOSIM_CACHE_LIMIT", "none")
    assert keep_within_limit() == []
    assert young.is_dir()


@pytest.mark.parametrize(
    ("text", "expected"),
    [("500MB", 5e8), ("1.5 GB", 1.5e9), ("1GiB", 2**30), ("2k", 2e3), ("7", 7), ("1TB", 1e12)],
)
def test_sizes_are_read(text, expected):
    assert parse_size_bytes(text, place="here") == expected


@pytest.mark.parametrize("text", ["much", "-1GB", "1XB", "GB", "1 0GB"])
def test_what_is_no_size_is_refused(text, monkeypatch):
    with pytest.raises(UsageError, match="here: expected a size such as 500MB, 5GB or 1GiB, was"):
        parse_size_bytes(text, place="here")
    monkeypatch.setenv("GSLCOSIM_CACHE_LIMIT", text)
    with pytest.raises(UsageError, match="GSLCOSIM_CACHE_LIMIT: expected a size"):
        limit_from_environment()


def test_without_a_limit_of_its_own_there_is_the_usual_one(monkeypatch):
    monkeypatch.delenv("GSLCOSIM_CACHE_LIMIT", raising=False)
    assert limit_from_environment() == DEFAULT_LIMIT_BYTES
