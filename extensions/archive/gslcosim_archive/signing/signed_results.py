"""Signed results: a statement with the SHA-256 of each file and each row, and its author's signature beside it.

`signed.json` is the statement, `signed.json.sig` the signature. Reports and recordings are not part of it: they are
made from the rest.
"""

import hashlib
import json
import os
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Required, TypedDict

from gslcosim.base.errors import UsageError
from gslcosim.base.files import read_regular_file
from gslcosim.base.untrusted_input import MalformedFileError, parse_json
from gslcosim_archive.signing.keys import (
    PublicKey,
    SignatureError,
    build_change_error,
    check_digest,
    check_text,
    read_public_part,
    read_signature,
    sign_digest,
)
from gslcosim_bench.secret_files import holds_secret
from gslcosim_bench.store import ResultsFolder, write_at_once
from gslcosim_bench.verification_marks import SIGNATURE_FILE, STATEMENT_FILE, find_unhashed, list_content_files

SCHEMA = "gslcosim/signed/1"
_MAX_BYTES = 1_000_000_000


class _Statement(TypedDict, total=False):
    schema: Required[str]
    key: Required[str]
    author: Required[str]
    signed_at: Required[str]
    suite: Required[str]
    suite_hash: Required[str]
    files: Required[dict[str, str]]
    rows: Required[dict[str, str]]


@dataclass(frozen=True, kw_only=True)
class SignedResults:
    """A signed statement: its key, the name and time that its author gives, and its hash.

    `signature` is its text. `suite_hash` stands for the cases, and `n_rows` counts the rows.
    """

    key: PublicKey
    author: str
    signed_at: str
    statement_hash: str
    signature: str
    suite: str
    suite_hash: str
    n_rows: int


def sign_results(folder: Path, key_path: Path, *, author: str, signed_at: str) -> SignedResults:
    """Sign all that a results folder says; an earlier signature is replaced.

    Args:
        key_path: File of the author's Ed25519 key.
        author: Name that is shown beside the key; nobody checks it.
        signed_at: Time of signing, by the author's clock.
    """
    check_text(author, "--name")
    results = ResultsFolder(folder)
    results.check()
    if results.journal.is_file() or not results.trials.is_file():
        raise UsageError(
            f"{folder}: expected results whose run has ended, were those of an interrupted one "
            f"({results.journal.name}). Give the same bench run again, then sign."
        )
    manifest = results.read_json(results.manifest)
    statement: dict[str, Any] = {
        "schema": SCHEMA,
        # Whoever signs another's statement is not taken for its author.
        "key": read_public_part(key_path).text,
        "author": author,
        "signed_at": signed_at,
        "suite": str(manifest.get("suite")),
        "suite_hash": str(manifest.get("suite_hash")),
        "files": _hash_files(folder),
        "rows": _hash_rows(results.trial_table().to_pylist()),
    }
    if odd := next((name for name in statement["files"] if _is_no_text(name)), None):
        raise UsageError(f"{folder}: expected names of files that are UTF-8, was {odd!r}. Rename or remove it.")
    if problem := next(find_unhashed(folder), None):
        raise UsageError(f"{folder}: expected plain files, {problem}.")
    if secret := next((path for path in list_content_files(folder) if holds_secret(path)), None):
        raise UsageError(
            f"{secret}: expected a file for everybody, was a private key or the secret of a seal. Move it elsewhere."
        )
    content = (json.dumps(statement, indent=0, ensure_ascii=False) + "\n").encode()
    signature, key = sign_digest(hashlib.sha256(content).digest(), key_path)
    write_at_once(folder / STATEMENT_FILE, lambda path: path.write_bytes(content))
    write_at_once(folder / SIGNATURE_FILE, lambda path: path.write_text(signature, encoding="ascii"))
    return _signed_results(statement, content, signature, key)


def check_signature(folder: Path, *, author: str | None = None) -> SignedResults | None:
    """Return what an author has signed, where a folder still is what it was then; None where nobody has signed it.

    Args:
        author: Fingerprint of the key that must have signed; absent: any.
    """
    paths = folder / STATEMENT_FILE, folder / SIGNATURE_FILE
    if not any(map(os.path.lexists, paths)):
        if author is None:
            return None
        raise SignatureError(f"{folder}: expected results signed by {author}, were unsigned ones.")
    if link := next((path for path in paths if path.is_symlink()), None):
        raise SignatureError(f"{link}: expected a plain file, was a link; put the file itself in its place.")
    if missing := next((path for path in paths if not path.is_file()), None):
        raise SignatureError(
            f"{folder}: expected {STATEMENT_FILE} and {SIGNATURE_FILE} together, {missing.name} is missing. Take the "
            "folder from a copy."
        )
    statement, content, signature, key = _read_statement(folder)
    if author is not None and key.fingerprint != author:
        raise SignatureError(f"{folder}: expected results signed by {author}, were signed by {key.fingerprint}.")
    if problems := list(_find_changes(folder, statement)):
        raise build_change_error(
            folder, f"the results that {key.fingerprint} has signed", problems,
            remedy="Take the folder from a copy, or ask its author:",
        )  # fmt: skip
    return _signed_results(statement, content, signature, key)


def _read_statement(folder: Path) -> tuple[_Statement, bytes, str, PublicKey]:
    path = folder / STATEMENT_FILE
    try:
        content = read_regular_file(path, max_bytes=_MAX_BYTES)
        signature = read_signature(folder / SIGNATURE_FILE)
        key = check_digest(hashlib.sha256(content).digest(), signature, place=str(folder / SIGNATURE_FILE))
        statement = parse_json(content, _Statement, place=f"{folder.name}/{STATEMENT_FILE}")
    except OSError as error:
        raise SignatureError(f"{path}: expected a file that can be read, was not ({error}).") from error
    except MalformedFileError as error:
        raise SignatureError(f"{error}\nFile: {path}") from error
    if statement["schema"] != SCHEMA:
        raise SignatureError(
            f"{path}: expected schema {SCHEMA}, was {statement['schema']}. Use the gslcosim that wrote it."
        )
    if statement["key"] != key.text:
        raise SignatureError(
            f"{path}: expected the signature of {statement['key']}, which it names, was one by {key.text}. Somebody "
            "else has signed it: take the folder from its author."
        )
    return statement, content, signature, key


def _find_changes(folder: Path, statement: _Statement) -> Iterator[str]:
    yield from find_unhashed(folder)
    found, signed = _hash_files(folder), statement["files"]
    for name in sorted(found.keys() | signed.keys()):
        if name not in signed:
            yield f"{name}: was added"
        elif name not in found:
            yield f"{name}: was removed"
        elif found[name] != signed[name]:
            yield f"{name}: was altered (SHA-256 {signed[name][:12]}…, is {found[name][:12]}…)"
    # Altered rows are more exact than a changed checksum.
    results = ResultsFolder(folder, is_checked=False)
    if results.trials.name in found:
        yield from _find_changed_rows(results, statement["rows"])
    yield from _find_wrong_claims(results, statement)


# What an author signs of a folder is not always what is in it.
def _find_wrong_claims(results: ResultsFolder, statement: _Statement) -> Iterator[str]:
    name = results.manifest.name
    try:
        manifest = results.read_json(results.manifest)
    except UsageError as error:
        yield f"{name}: cannot be read ({str(error).splitlines()[0]})"
        return
    for key, claimed in (("suite", statement["suite"]), ("suite_hash", statement["suite_hash"])):
        if claimed != (found := str(manifest.get(key))):
            yield f"{STATEMENT_FILE}: says {key} {claimed}, {name} says {found}"


# Hashes of files say that something differs; this says what, and whether it was signed as it is.
def _find_changed_rows(results: ResultsFolder, signed: Mapping[str, str]) -> Iterator[str]:
    name = results.trials.name
    try:
        rows = {row["trial"]: row for row in results.trial_table().to_pylist()}
    except (UsageError, ValueError) as error:
        yield f"{name}: its rows cannot be read ({str(error).splitlines()[0]})"
        return
    found = _hash_rows(rows.values())
    for trial in sorted(found.keys() | signed.keys()):
        row = rows.get(trial)
        where = f" ({row['entry']} in {row['case']}, repetition {row['repetition']})" if row is not None else ""
        if trial not in signed:
            yield f"{name}: row of trial {trial}{where} was added"
        elif trial not in found:
            yield f"{name}: row of trial {trial} was removed"
        elif found[trial] != signed[trial]:
            yield f"{name}: row of trial {trial}{where} was altered"
    if found == signed and list(found) != list(signed):
        first = next(a for a, b in zip(found, signed, strict=True) if a != b)
        yield f"{name}: rows stand in another order, from trial {first} on"


def _signed_results(statement: Mapping[str, Any], content: bytes, signature: str, key: PublicKey) -> SignedResults:
    return SignedResults(
        key=key,
        author=statement["author"],
        signed_at=statement["signed_at"],
        statement_hash=hashlib.sha256(content).hexdigest(),
        signature=signature,
        suite=statement["suite"],
        suite_hash=statement["suite_hash"],
        n_rows=len(statement["rows"]),
    )


def _is_no_text(name: str) -> bool:
    try:
        name.encode()
    except UnicodeEncodeError:
        return True
    return False


def _hash_files(folder: Path) -> dict[str, str]:
    return {path.relative_to(folder).as_posix(): _hash_file(path) for path in list_content_files(folder)}


def _hash_file(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


# A row's values in the order of the columns, as JSON; Python writes a number so that it is read back to the bit.
def _hash_rows(rows: Iterable[Mapping[str, Any]]) -> dict[str, str]:
    return {row["trial"]: hashlib.sha256(json.dumps(row, separators=(",", ":")).encode()).hexdigest() for row in rows}
