"""Submission bundles: a program with its card, lock and build recipe in one file that has one hash.

A bundle is an uncompressed tar of a folder with `submission.yaml`. Names are sorted, times are zero, nobody owns the
files, and modes are 644 or 755, so the same files have the same bytes wherever and whenever they are packed.
"""

import hashlib
import io
import os
import shutil
import subprocess
import tarfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path, PurePosixPath
from typing import Annotated, Literal

from pydantic import Field

from gslcosim.base.errors import UsageError, build_machine_error
from gslcosim.base.files import read_regular_file, replace_file
from gslcosim.bench.cases.models import LOWER_ANCHOR, UPPER_ANCHOR, EntrySpec
from gslcosim.methods.card import CARD_FILE, load_card
from gslcosim.runtime.processes.sandbox.policy import is_system_path
from gslcosim.scenario.loader import read_spec_file
from gslcosim.scenario.models.base import Spec
from gslcosim.scenario.serialization import dump_values

SUBMISSION_FILE = "submission.yaml"
_BUILT_FILE = ".built"
_MAX_BYTES, _MAX_FILES = 200_000_000, 10_000
_MAX_LEVELS_UP = 4
_MAX_PATH = 4096
_MAX_LOG_LINES = 20
_BUNDLES = "bundles"

Word = Annotated[str, Field(min_length=1)]


class Submission(Spec):
    """A whole submission file.

    `entry` is the method as a suite has it, with paths from the file's folder. `build` are the command lines that make
    the program from the folder's files, in this order. `lock` names the files that pin everything else that the program
    needs. `leaves_out` are patterns of what is not packed, such as what `build` makes.
    """

    schema_: Literal["gslcosim/submission/1"] = Field(alias="schema")
    entry: EntrySpec
    build: tuple[Annotated[tuple[Word, ...], Field(min_length=1)], ...]
    lock: tuple[Word, ...]
    leaves_out: tuple[Word, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Bundle:
    """A bundle: its SHA-256, what it says, and the files in it by name; `root` is where they are unpacked or from."""

    digest: str
    submission: Submission
    files: tuple[str, ...]
    root: Path


@dataclass(frozen=True, kw_only=True)
class PreparedBundles:
    """Bundles that are ready to fly: the suite with their entries, and where each is unpacked, by the entry's name."""

    suite: Path
    roots: Mapping[str, Path]


def load_submission(folder: Path) -> Submission:
    """Return the submission file of a folder.

    Raises:
        ScenarioError: it cannot be read, or has problems: all of them in one error.
        UsageError: there is none, or no card; its entry has the name of an anchor or names files outside the folder.
        MethodError: the card is not what it should be.
    """
    path = folder / SUBMISSION_FILE
    if not path.is_file():
        raise UsageError(
            f"{folder}: expected a folder with {SUBMISSION_FILE}, found none. docs/benchmark/submit.md has an example."
        )
    submission = read_spec_file(path, Submission, shown_path=str(path), keys="schema, entry, build and lock")
    for name in (CARD_FILE, *submission.lock):
        if not (folder / name).is_file():
            what = "the method's card" if name == CARD_FILE else "a file that lock names"
            raise UsageError(f"{folder}: expected {what}, {name}, found none. Add it beside {SUBMISSION_FILE}.")
    load_card(folder / CARD_FILE)
    _check_entry(submission.entry, folder)
    return submission


def _check_entry(entry: EntrySpec, folder: Path) -> None:
    path = folder / SUBMISSION_FILE
    if entry.name in (LOWER_ANCHOR, UPPER_ANCHOR):
        raise UsageError(
            f"{path}: entry.name: expected a name of its own, was that of an anchor, {entry.name}. Choose another."
        )
    words = [entry.start.python] if entry.start.python is not None else [*(entry.start.command or ())]
    # The program alone may be one of the system: other files that a command names are kept with the results.
    is_installed = entry.start.python is None and Path(words[0]).is_absolute() and is_system_path(Path(words[0]))
    for word in words[is_installed:]:
        if outside := next((text for text in _list_paths(word) if _is_outside(text, folder)), None):
            raise UsageError(
                f"{path}: entry.start: expected paths from this folder to what lies in it, was {outside}. Put the file "
                "into the folder, and name it from there."
            )


# `--option=path` names one too, and `-cp here:there` several.
def _list_paths(word: str) -> list[str]:
    return [word, *word.replace("=", os.pathsep).split(os.pathsep)]


def _is_outside(text: str, folder: Path) -> bool:
    if not text or len(text) >= _MAX_PATH or "\0" in text:
        return False
    if not Path(text).is_absolute() and ".." in Path(os.path.normpath(text)).parts:
        return True
    try:
        place = folder / text
        return os.path.lexists(place) and not place.resolve().is_relative_to(folder.resolve())
    except OSError:
        return False


def find_bundle_root(program: Path) -> Path | None:
    """Return the folder with the submission file that a program belongs to: its own, or one above; None without one."""
    above = list(program.resolve().parents)[:_MAX_LEVELS_UP]
    return next((folder for folder in above if (folder / SUBMISSION_FILE).is_file()), None)


def list_bundle_files(root: Path) -> list[Path]:
    """Return the files of a bundle's folder by name; hidden ones, caches of Python and what it leaves out apart.

    Raises:
        ScenarioError: the submission file cannot be read, or has problems.
    """
    path = root / SUBMISSION_FILE
    left_out = read_spec_file(path, Submission, shown_path=str(path), keys="schema, entry, build and lock").leaves_out
    return sorted(_iterate_files(root, root, left_out), key=lambda path: path.relative_to(root).as_posix())


def _iterate_files(folder: Path, root: Path, left_out: Sequence[str]) -> Iterator[Path]:
    for path in folder.iterdir():
        name = path.relative_to(root).as_posix()
        if path.name.startswith(".") or path.name == "__pycache__":
            continue
        if any(fnmatchcase(name, pattern.rstrip("/")) for pattern in left_out):
            continue
        if path.is_dir() and not path.is_symlink():
            yield from _iterate_files(path, root, left_out)
        elif path.is_file():
            yield path


def pack_bundle(folder: Path, out: Path) -> Bundle:
    """Write the bundle of a folder.

    Args:
        folder: Folder with the submission file.
        out: The file; an earlier one is replaced.

    Raises:
        ScenarioError: the submission file has problems.
        UsageError: a file is missing, a link, too large, or its name does not fit.
        MethodError: the card is not what it should be.
        MachineError: it cannot be written.
    """
    submission = load_submission(folder)
    files = list_bundle_files(folder)
    if link := next((path for path in files if path.is_symlink()), None):
        raise UsageError(f"{link}: expected a plain file, was a link. Put the file itself in its place.")
    size = sum(path.stat().st_size for path in files)
    if size > _MAX_BYTES or len(files) > _MAX_FILES:
        raise UsageError(
            f"{folder}: expected at most {_MAX_FILES} files with {_MAX_BYTES // 1_000_000} MB together, were "
            f"{len(files)} with {size // 1_000_000} MB. Add what is built to leaves_out in {SUBMISSION_FILE}."
        )
    packed = io.BytesIO()
    with tarfile.open(fileobj=packed, mode="w", format=tarfile.USTAR_FORMAT) as tar:
        for path in files:
            _add_file(tar, path, path.relative_to(folder).as_posix())
    content = packed.getvalue()
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        replace_file(out.parent, out.name, content)
    except OSError as error:
        raise build_machine_error(error, "bundle", "a file that can be written", path=out) from error
    return _bundle(content, submission, files, folder)


def _add_file(tar: tarfile.TarFile, path: Path, name: str) -> None:
    content = path.read_bytes()
    member = tarfile.TarInfo(name)
    member.size = len(content)
    member.mode = 0o755 if os.access(path, os.X_OK) else 0o644
    try:
        tar.addfile(member, io.BytesIO(content))
    except ValueError as error:
        raise UsageError(f"{path}: expected a name that fits into a tar ({error}). Shorten it.") from error


def unpack_bundle(path: Path, below: Path) -> Bundle:
    """Unpack a bundle into a folder named after it and its hash; one that is there already is taken as it is.

    Args:
        path: The file.
        below: Where the folder is made.

    Raises:
        ScenarioError: its submission file has problems.
        UsageError: it is no bundle.
        MachineError: it cannot be written.
    """
    expected = f"{path}: expected a bundle of gslcosim bench pack"
    try:
        content = read_regular_file(path, max_bytes=2 * _MAX_BYTES)
    except OSError as error:
        raise UsageError(f"{expected}, was a file that cannot be read ({error.strerror}).") from error
    try:
        files = _read_files(content)
    except (tarfile.TarError, ValueError, EOFError, OSError) as error:
        raise UsageError(f"{expected}, was another file ({error}). Take it from a copy.") from error
    if SUBMISSION_FILE not in files:
        raise UsageError(f"{expected}, was one without {SUBMISSION_FILE}. Take it from a copy.")
    root = below / hashlib.sha256(content).hexdigest()[:16]
    try:
        if not root.is_dir():
            beside = below / f".{root.name}.{os.getpid()}"
            for name, (mode, data) in files.items():
                target = beside / name
                target.parent.mkdir(parents=True, exist_ok=True)
                target.write_bytes(data)
                target.chmod(mode)
            beside.rename(root)
    except OSError as error:
        raise build_machine_error(error, "bundle", "a folder that can be written", path=root) from error
    return _bundle(content, load_submission(root), [root / name for name in files], root)


# Plain files below the folder alone, each once: what else a tar can hold is no bundle.
def _read_files(content: bytes) -> dict[str, tuple[int, bytes]]:
    files: dict[str, tuple[int, bytes]] = {}
    n_bytes = 0
    with tarfile.open(fileobj=io.BytesIO(content), mode="r:") as tar:
        for member in tar:
            parts = PurePosixPath(member.name).parts
            is_below = bool(parts) and not member.name.startswith("/") and not {"..", "."} & {*member.name.split("/")}
            n_bytes += member.size
            data = tar.extractfile(member) if member.isreg() and is_below and "\\" not in member.name else None
            if data is None or member.name in files:
                raise ValueError(f"{member.name!r} is no plain file of it")
            if n_bytes > _MAX_BYTES or len(files) >= _MAX_FILES:
                raise ValueError("too much is in it")
            files[member.name] = 0o755 if member.mode & 0o100 else 0o644, data.read()
    return files


def build_program(bundle: Bundle, *, is_agreed: bool) -> None:
    """Run the build recipe of an unpacked bundle, once.

    Args:
        bundle: As `unpack_bundle` returns it.
        is_agreed: Whether whoever starts it has read the commands: they run with all of their rights.

    Raises:
        UsageError: there are commands and nobody has agreed to them, or one has failed.
    """
    built = bundle.root / _BUILT_FILE
    if not bundle.submission.build or built.is_file():
        return
    lines = "\n".join(f"  {' '.join(words)}" for words in bundle.submission.build)
    if not is_agreed:
        raise UsageError(
            f"{bundle.root}: expected --build, or a bundle without commands to build it, was one with commands, which "
            f"run with all your rights. Read its files, then give --build, or do all of this in a container:\n{lines}"
        )
    for words in bundle.submission.build:
        try:
            ended = subprocess.run(
                list(words), cwd=bundle.root, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT, text=True, errors="replace", check=False,
                env={**os.environ, "SOURCE_DATE_EPOCH": "0"},
            )  # fmt: skip
            failure = ended.returncode and f"exit code {ended.returncode}"
            tail = "\n".join(ended.stdout.splitlines()[-_MAX_LOG_LINES:])
        except OSError as error:
            failure, tail = error.strerror, ""
        if failure:
            raise UsageError(
                f"{bundle.root}: expected {' '.join(words)} to build the program, was {failure}. Install what it "
                f"needs, or ask its author.\n{tail}".rstrip()
            )
    built.touch()


def write_bundle_suite(bundles: Sequence[Bundle], suite: Path, *, name: str, below: Path) -> Path:
    """Write a suite with the cases of another one, and the methods of unpacked bundles as its entries, in a sandbox.

    Args:
        bundles: Their folders lie in `below`.
        suite: File of the suite whose cases are taken.
        name: Name of the new one.
        below: Folder of the new file.

    Raises:
        UsageError: two bundles have one name.
    """
    names = [bundle.submission.entry.name for bundle in bundles]
    if twice := next((each for each in names if names.count(each) > 1), None):
        raise UsageError(f"--bundle: expected entries with names of their own, was {twice} twice. Fly them one by one.")
    entries = []
    for bundle in bundles:
        values = bundle.submission.entry.model_dump(mode="json", exclude_none=True, exclude_defaults=True)
        start = values["start"]
        place = bundle.root.name
        if "python" in start and (bundle.root / start["python"]).is_file():
            start["python"] = f"{place}/{start['python']}"
        if "command" in start:
            start["command"] = [
                f"{place}/{word}" if not Path(word).is_absolute() and (bundle.root / word).is_file() else word
                for word in start["command"]
            ]
        entries.append(values)
    text = dump_values(
        {
            "schema": "gslcosim/suite/1",
            "name": name,
            "include": [str(suite.resolve())],
            "entries": entries,
            "sandbox": "required",
        }
    )
    replace_file(below, f"{name}.yaml", text.encode())
    return below / f"{name}.yaml"


def prepare_bundles(paths: Sequence[Path], suite: Path, *, name: str, results: Path, builds: bool) -> PreparedBundles:
    """Unpack and build bundles beside results, and write the suite that flies them.

    Args:
        paths: The bundles.
        suite: File of the suite whose cases are taken.
        name: Name of the suite that is written.
        results: Folder of the results.
        builds: Whether their build recipes may run.

    Raises:
        UsageError: a file is no bundle, or cannot be built.
        MachineError: nothing can be written there.
    """
    below = results.parent / _BUNDLES
    try:
        below.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise build_machine_error(error, "bundles", "a folder that can be written", path=below) from error
    bundles = [unpack_bundle(path, below) for path in paths]
    for bundle in bundles:
        build_program(bundle, is_agreed=builds)
    return PreparedBundles(
        suite=write_bundle_suite(bundles, suite, name=name, below=below),
        roots={bundle.submission.entry.name: bundle.root for bundle in bundles},
    )


def copy_bundle_files(paths: Sequence[Path], root: Path, folder: Path, into: str) -> dict[Path, str]:
    """Copy files of a bundle with the folders that they lie in; return where each is, from `folder` on."""
    kept: dict[Path, str] = {}
    for path in paths:
        name = f"{into}/{path.relative_to(root).as_posix()}"
        target = folder / name
        target.parent.mkdir(parents=True, exist_ok=True)
        if target.resolve() != path.resolve():
            shutil.copy(path, target)
        kept[path.resolve()] = name
    return kept


def _bundle(content: bytes, submission: Submission, files: Sequence[Path], root: Path) -> Bundle:
    names = tuple(path.relative_to(root).as_posix() for path in files)
    return Bundle(digest=hashlib.sha256(content).hexdigest(), submission=submission, files=names, root=root)
