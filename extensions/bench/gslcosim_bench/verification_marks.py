"""Marks of verified results: kept in this user's state, by a hash of the folder's contents, never in the folder."""

import hashlib
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from gslcosim.base.errors import UsageError, build_machine_error, find_remedy
from gslcosim.base.files import iterate_tree, remove_tree, replace_file, user_state_folder

STATEMENT_FILE, SIGNATURE_FILE = "signed.json", "signed.json.sig"
"""Files of an author's statement and of its signature (`gslcosim_archive.signing`)."""

_FOLDER = "verified"
_PIECE_BYTES = 1 << 20
# Reports are made from the rest, recordings are looked at and not believed, signatures have checks of their own.
_MADE_FROM_THE_REST = {
    "recordings", "tables", "figures", "report.html", "leaderboard.json", "summary.md", ".lock", STATEMENT_FILE,
    SIGNATURE_FILE,
}  # fmt: skip
_OF_PYTHON = "__pycache__"
_MOST_BYTES = 1 << 20

Number = Annotated[int, Field(ge=0)]


class VerificationMark(BaseModel):
    """Result of running a sample of a folder's trials again.

    `same` of `sample` trials came out the same. `n_missing` trials of the suite have no row. `entries` says of each
    entry of merged results whether it was verified in the folder that it comes from.
    """

    model_config = ConfigDict(frozen=True, extra="ignore")

    sample: Number = 0
    same: Number = 0
    at: str = ""
    n_missing: Number = 0
    entries: dict[str, bool] = {}


def results_hash(folder: Path) -> str:
    """Return the hash of all that a results folder says, and of the programs in it; reports and recordings aside."""
    if problem := next(find_unhashed(folder), None):
        raise UsageError(f"{folder}: expected plain files, {problem}.")
    digest = hashlib.blake2b(digest_size=24)
    for path in list_content_files(folder):
        name = os.fsencode(path.relative_to(folder))
        digest.update(len(name).to_bytes(8, "big") + name)
        digest.update(b"F" + path.stat().st_size.to_bytes(8, "big"))
        with path.open("rb") as file:
            while piece := file.read(_PIECE_BYTES):
                digest.update(piece)
    return digest.hexdigest()


def prepare_marks() -> None:
    """Make the folder of the marks."""
    folder = user_state_folder() / _FOLDER
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        if not os.access(folder, os.W_OK | os.X_OK):
            raise PermissionError(13, os.strerror(13))
    except OSError as error:
        raise build_machine_error(
            error, "folder of this user's state", "a folder that can be written", path=folder,
            remedy=f"{find_remedy(error)} GSLCOSIM_STATE chooses another.",
        ) from error  # fmt: skip


def save_mark(contents: str, mark: VerificationMark) -> None:
    """Keep what came of a verification.

    Args:
        contents: The `results_hash` of the folder.
    """
    path = _path(contents)
    try:
        path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        replace_file(path.parent, path.name, (mark.model_dump_json() + "\n").encode())
    except OSError as error:
        raise build_machine_error(error, "mark of verified results", "a file that can be written", path=path) from error


def find_mark(folder: Path) -> VerificationMark | None:
    """Return this user's verification of results with the contents of a folder; None without one."""
    try:
        path = _path(results_hash(folder))
        if path.stat().st_size > _MOST_BYTES:
            return None
        return VerificationMark.model_validate_json(path.read_bytes())
    except (OSError, UsageError, ValidationError):
        return None


def _path(contents: str) -> Path:
    return user_state_folder() / _FOLDER / f"{contents}.json"


def list_content_files(folder: Path) -> Iterator[Path]:
    """Yield the files that say something in a results folder, in order; reports and recordings aside."""
    # What is no regular file has no contents, and is not opened.
    for path in sorted(_below(folder)):
        if path.is_file() and not path.is_symlink():
            yield path


def find_unhashed(folder: Path) -> Iterator[str]:
    """Yield what in a results folder has contents that hashes of its files miss, and what to do about it.

    Links have those of another file, and Python runs what is in its caches whatever the source beside them says.
    """
    for path in sorted(_below(folder)):
        name = path.relative_to(folder).as_posix()
        if path.is_symlink():
            yield f"{name}: is a link; put the file itself in its place"
        elif path.name == _OF_PYTHON:
            yield f"{name}: is a cache of Python, which runs it in place of the source; remove it"


def remove_caches(folder: Path) -> None:
    """Remove caches that Python has written into a results folder while its programs ran with their author's trust."""
    for path in list(_below(folder)):
        if path.name == _OF_PYTHON and path.is_dir() and not path.is_symlink():
            remove_tree(path, ignore_errors=True)


def _below(folder: Path) -> Iterator[Path]:
    def is_left_out(path: Path) -> bool:
        is_put_aside = path.name.startswith("earlier-") and path.is_dir()
        return path.parent == folder and (path.name in _MADE_FROM_THE_REST or is_put_aside)

    found = iterate_tree(folder, is_entered=lambda path: path.name != _OF_PYTHON and not is_left_out(path))
    return (path for path in found if not is_left_out(path))
