"""Public log of submissions: a file to which lines are only added, each with the hash of the line before.

A line is a submission (the hash that an author has signed, with key and signature, so that it is checked without the
results) or a note that its organiser has signed, such as the commitment to a sealed suite's seed. Whoever has noted the
hash of the last line can tell later that no line up to it was altered, dropped, moved or put between others.
"""

import hashlib
import json
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Required, TypedDict

from gslcosim.base.errors import UsageError, build_machine_error
from gslcosim.base.files import append_bytes, hold_lock, read_regular_file
from gslcosim.base.untrusted_input import MalformedFileError, parse_json
from gslcosim_archive.signing.keys import (
    NAMESPACE,
    NOTE_NAMESPACE,
    SignatureError,
    build_change_error,
    check_digest,
    check_text,
    sign_digest,
)
from gslcosim_archive.signing.signed_results import SignedResults

FIRST = "0" * 64
"""Hash of the line before the first line."""

_PURPOSES = {"submission": NAMESPACE, "note": NOTE_NAMESPACE}
_MAX_BYTES = 1_000_000_000


class _Line(TypedDict):
    previous: Required[str]
    kind: Required[str]
    key: Required[str]
    author: Required[str]
    signed_at: Required[str]
    suite: Required[str]
    suite_hash: Required[str]
    text: Required[str]
    statement_hash: Required[str]
    signature: Required[str]
    hash: Required[str]


@dataclass(frozen=True, kw_only=True)
class LogLine:
    """A line of the log, `number` from 1 on.

    `statement_hash` is the SHA-256 of what was signed: of a submission `signed.json`, of a note its `text`. `hash` is
    that of the line, `previous` that of the line before.
    """

    number: int
    previous: str
    kind: str
    key: str
    author: str
    signed_at: str
    suite: str
    suite_hash: str
    text: str
    statement_hash: str
    signature: str
    hash: str


def read_log(path: Path, *, head: str | None = None) -> list[LogLine]:
    """Return the lines of a log whose chain of hashes and signatures are whole.

    Args:
        head: Hash of a line that must be in it, noted earlier; absent: a log whose end was cut off passes.
    """
    lines, problems = _parse(path)
    problems = [*problems, *_find_broken_links(lines), *_find_wrong_signatures(lines), *_find_repeated(lines)]
    if head is not None and head not in {FIRST, *(line.hash for line in lines)}:
        problems.append(f"no line has the hash {head}: lines were dropped at the end, or all were written anew")
    if problems:
        raise build_change_error(
            path, "a log to which lines were only added", problems, remedy="Take it from a copy:"
        )  # fmt: skip
    return lines


def add_submission(path: Path, signed: SignedResults) -> LogLine:
    """Add signed results to a log, which is made where there is none.

    Args:
        signed: As `check_signature` returns them.
    """
    return _add(path, kind="submission", text="", **_list_fields(signed))


def add_note(path: Path, text: str, key_path: Path, *, author: str, signed_at: str) -> LogLine:
    """Add a signed note to a log, such as the commitment to a seed; as `add_submission`."""
    check_text(text, "--note")
    check_text(author, "--name")
    digest = hashlib.sha256(text.encode())
    signature, key = sign_digest(digest.digest(), key_path, namespace=NOTE_NAMESPACE)
    return _add(
        path,
        kind="note",
        key=key.text,
        author=author,
        signed_at=signed_at,
        suite="",
        suite_hash="",
        text=text,
        statement_hash=digest.hexdigest(),
        signature=signature,
    )


def find_submission(lines: Sequence[LogLine], signed: SignedResults, *, path: Path) -> LogLine:
    """Return the line of signed results."""
    for line in lines:
        if line.kind == "submission" and line.statement_hash == signed.statement_hash:
            if wrong := [name for name, value in _list_fields(signed).items() if getattr(line, name) != value]:
                raise SignatureError(
                    f"{path}: line {line.number}: expected {wrong[0]} as in what was signed, "
                    f"{_list_fields(signed)[wrong[0]]}, was {getattr(line, wrong[0])}. Its organiser has written "
                    "something else: ask why."
                )
            return line
    raise SignatureError(
        f"{path}: expected a line with the statement {signed.statement_hash}, found none. Its organiser adds it with "
        "bench log --add; results that are signed again are another submission."
    )


def find_beacon_note(lines: Sequence[LogLine], submission: LogLine, beacon: str, *, path: Path) -> LogLine | None:
    """Return the first note of the log with an audit's beacon in it; None where no note has it."""
    value = re.compile(rf"(?<!\w){re.escape(beacon.strip())}(?!\w)")
    note = next((line for line in lines if line.kind == "note" and value.search(line.text)), None)
    if note is not None and note.number < submission.number:
        raise SignatureError(
            f"{path}: expected a beacon from after line {submission.number}, the submission, was '{beacon}', which "
            f"line {note.number} has: its author could know what would be drawn. Audit with a later beacon."
        )
    return note


def list_submissions(lines: Sequence[LogLine], submission: LogLine) -> list[LogLine]:
    """Return all submissions of a line's suite, that is for the same cases, under whatever name and by whatever key."""
    return [line for line in lines if (line.kind, line.suite_hash) == (submission.kind, submission.suite_hash)]


def list_own(lines: Sequence[LogLine], submission: LogLine) -> list[LogLine]:
    """Return the submissions of a line's suite by its key, and by keys with the same name beside them.

    The log cannot tell whether these are of one author, so they count as lines of one.
    """
    return [
        line
        for line in list_submissions(lines, submission)
        if line.key == submission.key or (line.author == submission.author and line.author)
    ]


def _list_fields(signed: SignedResults) -> dict[str, str]:
    return {
        "key": signed.key.text,
        "author": signed.author,
        "signed_at": signed.signed_at,
        "suite": signed.suite,
        "suite_hash": signed.suite_hash,
        "statement_hash": signed.statement_hash,
        "signature": signed.signature,
    }


def _add(path: Path, **fields: str) -> LogLine:
    try:
        path.touch(exist_ok=True)
        with hold_lock(path):
            lines = read_log(path)
            entry = {"previous": lines[-1].hash if lines else FIRST, **fields}
            entry["hash"] = _hash(entry)
            added = LogLine(number=len(lines) + 1, **entry)
            if problems := list(_find_repeated([*lines, added])):
                raise UsageError(f"{path}: expected a new submission or note, was one that is there: {problems[0]}.")
            append_bytes(path.parent, path.name, _encode(entry) + b"\n")
    except OSError as error:
        raise build_machine_error(error, "log of submissions", "a file that can be written", path=path) from error
    return added


def _parse(path: Path) -> tuple[list[LogLine], list[str]]:
    try:
        content = read_regular_file(path, max_bytes=_MAX_BYTES)
    except OSError as error:
        raise UsageError(
            f"{path}: expected a log of submissions, was not one that can be read ({error.strerror}). bench log --add "
            "makes one."
        ) from error
    *raw_lines, rest = content.split(b"\n")
    problems = [f"line {len(raw_lines) + 1}: is cut off"] if rest else []
    lines: list[LogLine] = []
    for number, raw in enumerate(raw_lines, 1):
        try:
            entry = parse_json(raw, _Line, place=f"line {number}")
            line = LogLine(number=number, **{name: entry[name] for name in _Line.__annotations__})
        except MalformedFileError as error:
            problems.append(f"line {number}: was altered ({error})")
            continue
        if _encode(entry) != raw or _hash(entry) != line.hash:
            problems.append(f"line {number} ({_describe(line)}): was altered")
        lines.append(line)
    return lines, problems


# By the hashes that lines have of themselves, so that an altered line is no broken link.
def _find_broken_links(lines: Sequence[LogLine]) -> Iterator[str]:
    numbers = {line.hash: line.number for line in reversed(lines)}
    before = FIRST
    for line in lines:
        if line.previous != before:
            home = 0 if line.previous == FIRST else numbers.get(line.previous)
            where = f"line {line.number} ({_describe(line)})"
            if home is None:
                yield f"{where}: the line before it was dropped"
            elif home < line.number:
                yield f"{where}: lines were put before it, or moved; it was added after line {home}"
            else:
                yield f"{where}: was moved; it was added after what is line {home} now"
        before = line.hash


def _find_wrong_signatures(lines: Sequence[LogLine]) -> Iterator[str]:
    for line in lines:
        where = f"line {line.number} ({_describe(line)})"
        if line.kind not in _PURPOSES:
            yield f"{where}: is neither a submission nor a note"
            continue
        try:
            digest = bytes.fromhex(line.statement_hash)
            key = check_digest(digest, line.signature, place=where, namespace=_PURPOSES[line.kind])
        except (SignatureError, ValueError):
            yield f"{where}: its signature is one of something else"
            continue
        if key.text != line.key:
            yield f"{where}: another key has signed it, {key.fingerprint}"
        if line.kind == "note" and hashlib.sha256(line.text.encode()).hexdigest() != line.statement_hash:
            yield f"{where}: its text is not what was signed"


def _find_repeated(lines: Sequence[LogLine]) -> Iterator[str]:
    # By another key too: whoever signs somebody else's statement is the second.
    seen: dict[tuple[str, str], int] = {}
    for line in lines:
        first = seen.setdefault((line.kind, line.statement_hash), line.number)
        if first != line.number:
            yield f"line {line.number} ({_describe(line)}): repeats line {first}"


def _describe(line: LogLine) -> str:
    return f"{line.author or line.key[-12:]}: {line.suite or line.text[:40]}"


def _hash(entry: Mapping[str, Any]) -> str:
    return hashlib.sha256(_encode({name: value for name, value in entry.items() if name != "hash"})).hexdigest()


def _encode(entry: Mapping[str, Any]) -> bytes:
    return json.dumps(entry, separators=(",", ":"), ensure_ascii=False).encode()
