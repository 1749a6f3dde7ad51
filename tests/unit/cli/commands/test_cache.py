"""`gslcosim cache`: what it lists, and what it removes only when it was asked to."""

import json
import os
import time

import pytest

from gslcosim.cli.main import main

HASH = "0123456789abcdef"


@pytest.fixture
def cache(tmp_path, monkeypatch):
    """A cache with an old large tape, a new small room, and kernels between."""
    monkeypatch.setenv("GSLCOSIM_CACHE", str(tmp_path))
    for folder, n_kb, unused_days in (("tapes", 3000, 40), ("numba", 500, 20), ("environments", 100, 0)):
        entry = tmp_path / folder / HASH
        entry.mkdir(parents=True)
        (entry / "data").write_bytes(os.urandom(n_kb * 1000))
        used_at_s = time.time() - unused_days * 86400
        os.utime(entry, (used_at_s, used_at_s))
    return tmp_path


def answer(capsys, *words):
    assert main(["cache", *words, "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def kinds(content):
    return [each["kind"] for each in content["entries"]]


def test_it_lists_by_last_use_or_size(cache, capsys):
    listed = answer(capsys)
    assert kinds(listed) == ["room", "kernels", "tape"]
    assert listed["folder"] == str(cache)
    assert listed["size_mb"] == pytest.approx(3.6, abs=0.1)
    assert listed["limit_mb"] == 5000
    assert listed["entries"][2]["unused_h"] == pytest.approx(960, abs=1)
    assert kinds(answer(capsys, "--sort", "size", "--limit", "2")) == ["tape", "kernels"]
    assert kinds(answer(capsys, "list", "--kind", "tape", "--kind", "room")) == ["room", "tape"]


def test_the_table_has_sums(cache, capsys):
    assert main(["cache"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].split() == ["kind", "entry", "size", "unused", "for", "in", "use"]
    assert lines[3].split() == ["tape", HASH, "3.0", "MB", "40", "d", "-"]
    assert lines[-2].startswith("all           3   3.6 MB, limit 5.0 GB (GSLCOSIM_CACHE_LIMIT)")


@pytest.mark.parametrize(
    ("words", "removed"),
    [
        (["--older-than", "30d"], ["tape"]),
        (["--older-than", "2w"], ["tape", "kernels"]),
        (["--keep", "1MB"], ["tape"]),
        (["--keep", "200kB"], ["tape", "kernels"]),
        (["--keep", "1GB", "--older-than", "480h"], ["tape", "kernels"]),
        (["--all", "--kind", "kernels"], ["kernels"]),
        (["--all"], ["tape", "kernels", "room"]),
    ],
)
def test_free_lists_what_it_would_remove_and_removes_it_when_asked(cache, capsys, words, removed):
    assert kinds(answer(capsys, "free", *words)) == removed
    assert len(answer(capsys)["entries"]) == 3
    answered = answer(capsys, "free", *words, "--yes")
    assert (kinds(answered), answered["removed"]) == (removed, True)
    assert not set(kinds(answer(capsys))) & set(removed)


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (["free"], "expected --older-than, --keep or --all"),
        (["--all"], "with free only"),
        (["free", "--older-than", "soon"], "expected an age such as 90min, 12h, 30d or 8w, was 'soon'"),
        (["free", "--keep", "some"], "gslcosim cache --keep: expected a size such as"),
        (["free", "tiny_room"], "expected scenarios with compile only, was 'tiny_room'"),
        (["compile", "--yes"], "with free only"),
        (["compile", "tiny_rom"], "tiny_room"),
        (["--kind", "gas"], "expected --kind of room, tape, kernels, files, program, was 'gas'"),
    ],
)
def test_a_wrong_call_is_refused(cache, capsys, words, text):
    assert main(["cache", *words]) == 2
    assert text in capsys.readouterr().err
