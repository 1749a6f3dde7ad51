"""The log of submissions: lines are only added, and whatever else was done to them is found and named."""

import json
import shutil
from dataclasses import replace

import numpy as np
import pytest

from gslcosim.base.errors import UsageError
from gslcosim.cli.main import main
from gslcosim_archive.signing.keys import SignatureError, check_digest, write_key
from gslcosim_archive.signing.signed_results import check_signature, sign_results
from gslcosim_archive.signing.submission_log import (
    FIRST,
    add_note,
    add_submission,
    find_beacon_note,
    find_submission,
    list_own,
    list_submissions,
    read_log,
)

N_NOTES = 5


@pytest.fixture(scope="module")
def log_once(tmp_path_factory, signed_once, key):
    path = tmp_path_factory.mktemp("log") / "log.jsonl"
    for i in range(N_NOTES):
        add_note(path, f"note {i}", key, author=f"author {i}", signed_at="2026-11-27T12:00:00+00:00")
        if i == 2:
            add_submission(path, check_signature(signed_once))
    return path


@pytest.fixture
def log(log_once, tmp_path):
    return shutil.copy(log_once, tmp_path / "log.jsonl")


def error_of(path, **options):
    with pytest.raises(SignatureError) as caught:
        read_log(path, **options)
    return str(caught.value)


def test_a_log_is_read_as_it_was_written(log, signed_once):
    lines = read_log(log)
    assert [line.number for line in lines] == [1, 2, 3, 4, 5, 6]
    assert [line.previous for line in lines[1:]] == [line.hash for line in lines[:-1]]
    signed = check_signature(signed_once)
    assert find_submission(lines, signed, path=log) is lines[3]
    assert (lines[3].suite_hash, lines[3].signed_at) == (signed.suite_hash, signed.signed_at)
    assert read_log(log, head=lines[1].hash) == lines


def test_dropped_moved_and_inserted_lines_are_named(log):
    raw = log.read_bytes().splitlines(keepends=True)
    for changed, what in (
        (raw[:1] + raw[2:], "line 2 (author 2: note 2): the line before it was dropped"),
        (raw[1:], "line 1 (author 1: note 1): the line before it was dropped"),
        ([raw[0], raw[2], raw[1], *raw[3:]], "line 2 (author 2: note 2): was moved; it was added after what is line 3"),
        ([*raw[:2], raw[4], *raw[2:]], "line 3 (author 3: note 3): was moved; it was added after what is line 5 now"),
        ([*raw[:2], raw[0], *raw[2:]], "line 3 (author 0: note 0): repeats line 1"),
        ([raw[-1][:-1]], "line 1: is cut off"),
    ):
        log.write_bytes(b"".join(changed))
        assert what in error_of(log)


def test_a_log_that_was_cut_or_written_anew_lacks_the_noted_head(log, key, tmp_path):
    head = read_log(log)[-1].hash
    raw = log.read_bytes().splitlines(keepends=True)
    log.write_bytes(b"".join(raw[:-1]))
    assert len(read_log(log)) == N_NOTES
    assert "lines were dropped at the end" in error_of(log, head=head)
    anew = tmp_path / "anew.jsonl"
    for i in range(N_NOTES + 1):
        add_note(anew, f"another {i}", key, author="", signed_at="")
    assert f"no line has the hash {head}" in error_of(anew, head=head)


def test_every_bit_counts(log):
    """No bit of a log can be turned over."""
    pristine = log.read_bytes()
    rng = np.random.default_rng(1)
    for at in rng.choice(len(pristine), 200, replace=False):
        changed = bytearray(pristine)
        changed[at] ^= 1 << rng.integers(8)
        log.write_bytes(changed)
        line = pristine[:at].count(b"\n") + 1
        assert f"line {line}" in error_of(log), at


def test_a_forged_line_does_not_have_its_author_s_signature(log, tmp_path):
    """Whoever keeps the log can write hashes anew, but not what others have signed."""
    *before, last = [json.loads(line) for line in log.read_text().splitlines()]
    write_key(tmp_path / "eve", "")
    forged = tmp_path / "forged.jsonl"
    forged.write_text("".join(json.dumps(line, separators=(",", ":")) + "\n" for line in before))
    add_note(forged, "mine", tmp_path / "eve", author="author 4", signed_at=last["signed_at"])
    entry = json.loads(forged.read_text().splitlines()[-1])
    for change, what in (
        ({"text": "another"}, "its text is not what was signed"),
        ({"key": last["key"]}, "another key has signed it"),
        ({"statement_hash": last["statement_hash"]}, "its signature is one of something else"),
    ):
        from gslcosim_archive.signing import submission_log

        altered = {**entry, **change}
        altered["hash"] = submission_log._hash(altered)
        lines = [*before, altered]
        forged.write_text("".join(json.dumps(line, separators=(",", ":")) + "\n" for line in lines))
        assert what in error_of(forged)


def test_a_submission_is_there_once_whoever_signs_it(log, signed_once, tmp_path):
    with pytest.raises(UsageError, match="repeats line 4"):
        add_submission(log, check_signature(signed_once))
    folder = shutil.copytree(signed_once, tmp_path / "results")
    write_key(tmp_path / "eve", "")
    signed = sign_results(folder, tmp_path / "eve", author="Eve", signed_at="")
    with pytest.raises(SignatureError, match="expected a line with the statement"):
        find_submission(read_log(log), signed, path=log)
    assert add_submission(log, signed).number == len(read_log(log))


def test_a_line_that_says_something_else_of_a_submission_is_named(log, signed_once):
    """The signature is of the statement alone: whoever keeps the log can write the rest."""
    from gslcosim_archive.signing import submission_log

    signed = check_signature(signed_once)
    for field in ("author", "signed_at", "suite", "suite_hash"):
        previous, forged = submission_log.FIRST, []
        for entry in map(json.loads, log.read_text().splitlines()):
            if entry["kind"] == "submission":
                entry[field] = "forged"
            entry["previous"] = previous
            entry["hash"] = previous = submission_log._hash(entry)
            forged.append(json.dumps(entry, separators=(",", ":")) + "\n")
        other = log.with_name("forged.jsonl")
        other.write_text("".join(forged))
        with pytest.raises(SignatureError, match=rf"line 4: expected {field} as in what was signed, .*, was forged"):
            find_submission(read_log(other), signed, path=other)


def test_a_note_is_no_submission(signed_once, key, tmp_path):
    """Neither does its signature count as one of results, nor does its text keep results out."""
    text = (signed_once / "signed.json").read_text()
    log = tmp_path / "log.jsonl"
    note = add_note(log, text, key, author="", signed_at="")
    with pytest.raises(SignatureError, match="for another purpose"):
        check_digest(bytes.fromhex(note.statement_hash), note.signature, place="")
    assert add_submission(log, check_signature(signed_once)).number == 2
    for texts in (("\udcff", ""), ("x", "\udcff")):
        with pytest.raises(UsageError, match="expected a text in UTF-8"):
            add_note(log, texts[0], key, author=texts[1], signed_at="")
    assert len(read_log(log, head=FIRST)) == 2


def test_audit_and_rank_expect_the_noted_head(log, signed_once, capsys):
    folder, head = str(signed_once), "1" * 64
    for words in (
        ["audit", folder, "--log", str(log), "--beacon", "x", "--head", head],
        ["rank", folder, "--log", str(log), "--head", head],
    ):
        assert main(["bench", *words]) == 2
        assert f"no line has the hash {head}" in capsys.readouterr().err
    assert main(["bench", "rank", folder, "--head", head]) == 2
    assert "--head: expected the log" in capsys.readouterr().err
    assert main(["bench", "audit", folder, "--log", str(log), "--beacon", "\udcff"]) == 2
    assert "--beacon: expected a text in UTF-8" in capsys.readouterr().err


def test_the_command_line_adds_and_checks(signed_once, key, tmp_path, capsys):
    log = tmp_path / "log.jsonl"
    assert main(["bench", "log", str(log), "--note", "commitment: 1f0c", "--key", str(key), "--name", "Org"]) == 0
    assert main(["bench", "log", str(log), "--add", str(signed_once)]) == 0
    shown = capsys.readouterr().out
    assert "commitment: 1f0c" in shown
    head = read_log(log)[-1].hash
    assert f"Note the hash of the last: {head}" in shown
    assert main(["bench", "log", str(log), "--head", head, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["head"] == head
    assert main(["bench", "log", str(log), "--head", "1" * 64]) == 2
    assert main(["bench", "log", str(tmp_path / "none.jsonl")]) == 2
    assert main(["bench", "log", str(log), "--note", "x"]) == 2


def copy_signed(signed_once, tmp_path, key_path, name, *, signed_at="", change=""):
    """Sign a copy of the results once more; `change` is a comment added to the program."""
    folder = shutil.copytree(signed_once, tmp_path / name)
    with (folder / "agents" / "mine" / "agent.py").open("a") as file:
        file.write(change)
    return sign_results(folder, key_path, author="Ada", signed_at=signed_at)


def test_more_lines_of_a_suite_leave_its_first_line_the_one_that_draws(log, signed_once, key, tmp_path):
    """Copies signed again, changed programs, another suite's name and another key do not make a new first line."""
    first = find_submission(read_log(log), check_signature(signed_once), path=log)
    for i in range(4):
        signed = copy_signed(signed_once, tmp_path, key, f"copy {i}", signed_at=str(i), change=f"# {i}\n" * (i % 2))
        added = add_submission(log, replace(signed, suite=f"renamed {i}") if i == 3 else signed)
        own = list_own(read_log(log), added)
        assert (own[0], own[-1], len(own)) == (first, added, i + 2)
    write_key(tmp_path / "second", "")
    folder = shutil.copytree(signed_once, tmp_path / "other")
    other = add_submission(log, sign_results(folder, tmp_path / "second", author="Eve", signed_at=""))
    lines = read_log(log)
    assert list_submissions(lines, other) == [line for line in lines if line.kind == "submission"]
    assert list_submissions(lines, other)[0] == first
    assert list_own(lines, other) == [other]
    # The same name beside another key may be the same author.
    third = add_submission(log, copy_signed(signed_once, tmp_path, tmp_path / "second", "third"))
    assert {line.number for line in list_own(read_log(log), third)} == {
        line.number for line in list_submissions(read_log(log), third)
    }


def test_a_beacon_that_was_logged_before_the_results_is_refused(log, signed_once, key, tmp_path):
    line = find_submission(read_log(log), check_signature(signed_once), path=log)
    assert find_beacon_note(read_log(log), line, "6 49 3", path=log) is None
    add_note(log, "beacon: 16 49 3", key, author="", signed_at="")
    note = add_note(log, "beacon: 6 49 3", key, author="", signed_at="")
    add_note(log, "once more: 6 49 3", key, author="", signed_at="")
    assert find_beacon_note(read_log(log), line, " 6 49 3", path=log) == note
    late = add_submission(log, copy_signed(signed_once, tmp_path, key, "late", signed_at="later"))
    with pytest.raises(SignatureError, match=f"beacon from after line {late.number}.* line {note.number} has"):
        find_beacon_note(read_log(log), late, "6 49 3", path=log)
    # A log without its last lines still draws by the first; that they are missing is what a noted head shows.
    raw = log.read_bytes().splitlines(keepends=True)
    log.write_bytes(b"".join(raw[: note.number]))
    assert list_own(read_log(log), line) == [line]
    assert f"no line has the hash {late.hash}" in error_of(log, head=late.hash)
