"""Submission bundles: a program with its card, lock and build recipe in one file that has one hash.

A bundle is an uncompressed tar of a folder with `submission.yaml`. Names are sorted, times are zero, nobody owns the
files, and modes are 644 or 755, so the same files have the same bytes wherever and whenever they are packed.
"""

import hashlib
import io
import os
import re
import shlex
import shutil
import subprocess
import tarfile
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path, PurePosixPath
from typing import Annotated, Literal

from pydantic import Field

from gslcosim.base.bundled import SUBMISSION_FILE, SUITE_FILE
from gslcosim.base.errors import UsageError, build_machine_error
from gslcosim.base.files import iterate_tree, read_regular_file, remove_tree, replace_file
from gslcosim.base.yaml_core import without_editor_header
from gslcosim.methods.card import CARD_FILE, load_card
from gslcosim.runtime.processes.sandbox.policy import is_system_path
from gslcosim.scenario.models.base import Spec
from gslcosim.scenario.serialization import dump_values
from gslcosim_bench.cases.models import LOWER_ANCHOR, UPPER_ANCHOR, EntrySpec
from gslcosim_bench.cases.spec_files import read_spec_file
from gslcosim_bench.secret_files import holds_secret

_BUILT = ".built"
_MAX_BYTES, _MAX_FILES = 200_000_000, 10_000
_MAX_LEVELS_UP = 4
_MAX_PATH = 4096
# What a tar of this kind has room for.
_MAX_NAME_BYTES = 256
_MAX_LOG_LINES = 20
_BUNDLES = "bundles"
_ENDING = ".tar"
_YAML = (".yaml", ".yml")
_NO_PROGRAM = (
    "expected a word that names a file of the bundle, such as ./agent or run.sh in [sh, run.sh], found none. Name the "
    "program by its file, or start it from a script in the folder; what build makes counts too."
)
_DIGEST = re.compile(r"[0-9a-f]{16}")

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


def load_submission(folder: Path, *, shown_path: Path | None = None) -> Submission:
    """Return the submission file of a folder.

    Args:
        shown_path: What errors call it where files are missing; absent: the folder.
    """
    path = folder / SUBMISSION_FILE
    if not path.is_file():
        raise UsageError(
            f"{folder}: expected a folder with {SUBMISSION_FILE}, found none. docs/benchmark/submit.md has an example."
        )
    submission = _read_submission(folder)
    for name in (CARD_FILE, *submission.lock):
        if not (folder / name).is_file():
            what = "the method's card" if name == CARD_FILE else "a file that lock names"
            raise UsageError(
                f"{shown_path or folder}: expected {what}, {name}, found none. Add it beside {SUBMISSION_FILE}."
            )
    load_card(folder / CARD_FILE)
    _check_entry(submission.entry, folder)
    return submission


def _read_submission(folder: Path) -> Submission:
    path = folder / SUBMISSION_FILE
    return read_spec_file(path, Submission, shown_path=str(path), keys="schema, entry, build and lock")


def _check_entry(entry: EntrySpec, folder: Path) -> None:
    path = folder / SUBMISSION_FILE
    if entry.name in (LOWER_ANCHOR, UPPER_ANCHOR):
        raise UsageError(
            f"{path}: entry.name: expected a name of its own, was that of an anchor, {entry.name}. Choose another."
        )
    words = [entry.start.python] if entry.start.python is not None else [*(entry.start.command or ())]
    # The program alone may be one of the system: other files that a command names are kept with the results.
    program = Path(os.path.normpath(words[0]))
    is_installed = entry.start.python is None and program.is_absolute() and is_system_path(program)
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
    """Return the files of a bundle's folder by name.

    Hidden ones, caches of Python, results, the bundle itself and what it leaves out are not among them.
    """
    return [path for path in _list_entries(root, _read_submission(root)) if path.is_file()]


# Pipes and links to nowhere too, so that whoever packs learns of them.
def _list_entries(root: Path, submission: Submission) -> list[Path]:
    left_out = (*submission.leaves_out, f"{submission.entry.name}{_ENDING}")

    def is_packed(path: Path) -> bool:
        name = path.relative_to(root).as_posix()
        is_left_out = is_never_packed(path.name) or any(fnmatchcase(name, each.rstrip("/")) for each in left_out)
        is_folder = path.is_dir() and not path.is_symlink()
        return not is_left_out and not (is_folder and _is_made_by_runs(path))

    found = (path for path in iterate_tree(root, is_entered=is_packed) if is_packed(path))
    return sorted(found, key=lambda path: path.relative_to(root).as_posix())


def is_never_packed(name: str) -> bool:
    """Return whether files and folders of a name are left out of every bundle."""
    return name.startswith(".") or name == "__pycache__"


# Results of a method that lies at a project's root, and the bundles beside them.
def _is_made_by_runs(folder: Path) -> bool:
    if (folder / SUITE_FILE).is_file() and ((folder / "manifest.json").is_file() or (folder / "agents").is_dir()):
        return True
    return folder.name == _BUNDLES and any(_DIGEST.fullmatch(path.name) for path in folder.iterdir())


def pack_bundle(folder: Path, out: Path) -> Bundle:
    """Write the bundle of a folder.

    Args:
        out: The file; an earlier one is replaced.
    """
    submission = load_submission(folder)
    files = [path for path in _list_entries(folder, submission) if path.resolve() != out.resolve()]
    for path in files:
        if path.is_symlink():
            raise UsageError(f"{path}: expected a plain file, was a link. Put the file itself in its place.")
        if not path.is_file():
            raise UsageError(f"{path}: expected a plain file, was a pipe or a device. Remove it.")
        if problem := _find_problem_of_name(path.relative_to(folder).as_posix()):
            raise UsageError(f"{folder}: expected a name that every system takes, {problem}. Give the file another.")
        if holds_secret(path):
            raise UsageError(
                f"{path}: expected a file for everybody, was a private key or the secret of a seal. Move it elsewhere."
            )
    _check_packed(submission, {path.relative_to(folder).as_posix() for path in files}, folder / SUBMISSION_FILE)
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


def _find_problem_of_name(name: str) -> str:
    if not name.isprintable():
        return f"was {name!a}, with characters that are not shown"
    if name != PurePosixPath(name).as_posix() or "\\" in name:
        return f"was {name!r}"
    if len(name.encode()) > _MAX_NAME_BYTES:
        return f"was one of {len(name.encode())} bytes, more than {_MAX_NAME_BYTES}"
    return ""


# What is flown must be among the files that are packed, or made of them.
def _check_packed(submission: Submission, names: Collection[str], place: Path) -> None:
    lock = [PurePosixPath(name).as_posix() for name in submission.lock]
    if missing := next((name for name in (SUBMISSION_FILE, CARD_FILE, *lock) if name not in names), None):
        raise UsageError(
            f"{place}: expected {missing} to be packed, is left out: hidden files, caches and what leaves_out names "
            "are. Rename it, or change leaves_out."
        )
    start = submission.entry.start
    words = [start.python] if start.python is not None else [*(start.command or ())]
    if not submission.build and not any(PurePosixPath(word).as_posix() in names for word in words):
        raise UsageError(f"{place}: entry.start: {_NO_PROGRAM}")


def _add_file(tar: tarfile.TarFile, path: Path, name: str) -> None:
    content = read_regular_file(path)
    if path.suffix in _YAML:
        content = without_editor_header(content)
    member = tarfile.TarInfo(name)
    member.size = len(content)
    member.mode = 0o755 if os.access(path, os.X_OK) else 0o644
    try:
        tar.addfile(member, io.BytesIO(content))
    except ValueError as error:
        raise UsageError(f"{path}: expected a name that fits into a tar ({error}). Shorten it.") from error


def unpack_bundle(path: Path, below: Path) -> Bundle:
    """Unpack a bundle into a folder named after it and its hash; one that is there already is taken as it is."""
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
    if root.is_dir():
        return _bundle(content, load_submission(root), [root / name for name in files], root)
    beside = below / f".{root.name}.{os.getpid()}"
    try:
        for name, (mode, data) in files.items():
            target = beside / name
            target.parent.mkdir(parents=True, exist_ok=True)
            target.write_bytes(data)
            target.chmod(mode)
        submission = load_submission(beside, shown_path=path)
        _check_packed(submission, files, path)
        if others := sorted(files.keys() - {each.relative_to(beside).as_posix() for each in list_bundle_files(beside)}):
            raise UsageError(f"{expected}, was one with a file that pack leaves out: {others[0]}. Pack it again.")
        beside.rename(root)
    except OSError as error:
        raise build_machine_error(error, "bundle", "a folder that can be written", path=root) from error
    finally:
        remove_tree(beside, ignore_errors=True)
    return _bundle(content, submission, [root / name for name in files], root)


# Plain files below the folder alone, each once: what else a tar can hold is no bundle.
def _read_files(content: bytes) -> dict[str, tuple[int, bytes]]:
    files: dict[str, tuple[int, bytes]] = {}
    folders: set[str] = set()
    n_bytes = 0
    with tarfile.open(fileobj=io.BytesIO(content), mode="r:") as tar:
        for member in tar:
            name = member.name
            if problem := _find_problem_of_name(name):
                raise ValueError(f"a name {problem}")
            parts = PurePosixPath(name).parts
            is_below = bool(parts) and not name.startswith("/") and ".." not in parts
            n_bytes += member.size
            data = tar.extractfile(member) if member.isreg() and is_below else None
            above = {parent.as_posix() for parent in PurePosixPath(name).parents}
            if data is None or name in files or name in folders or above & files.keys():
                raise ValueError(f"{name!r} is no plain file of it")
            if any(map(is_never_packed, parts)):
                raise ValueError(f"{name!r} is a hidden file or a cache, which pack leaves out")
            if n_bytes > _MAX_BYTES or len(files) >= _MAX_FILES:
                raise ValueError("too much is in it")
            folders |= above
            files[name] = 0o755 if member.mode & 0o100 else 0o644, data.read()
    return files


def build_program(bundle: Bundle, *, is_agreed: bool) -> None:
    """Run the build recipe of an unpacked bundle, once.

    Args:
        bundle: As `unpack_bundle` returns it.
        is_agreed: Whether whoever starts it has read the commands: they run with all of their rights.
    """
    # Beside the files, where none of them can be it.
    built = bundle.root.with_name(f"{bundle.root.name}{_BUILT}")
    if not bundle.submission.build or built.is_file():
        return
    lines = "\n".join(f"  {shlex.join(words)}" for words in bundle.submission.build)
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
                f"{bundle.root}: expected {shlex.join(words)} to build the program, was {failure}. Install what it "
                f"needs, or ask its author.\n{tail}".rstrip()
            )
    built.touch()


def write_bundle_suite(bundles: Sequence[Bundle], suite: Path, *, name: str, below: Path) -> Path:
    """Write a suite with the cases of another one, and the methods of unpacked bundles as its entries, in a sandbox.

    Args:
        bundles: Their folders lie in `below`.
        suite: File of the suite whose cases are taken.
    """
    names = [bundle.submission.entry.name for bundle in bundles]
    if twice := next((each for each in names if names.count(each) > 1), None):
        raise UsageError(f"--bundle: expected entries with names of their own, was {twice} twice. Fly them one by one.")
    entries = []
    for bundle in bundles:
        values = bundle.submission.entry.model_dump(mode="json", exclude_none=True, exclude_defaults=True)
        start = values["start"]
        place = bundle.root.name
        words = (start.get("python", ""), *start.get("command", ()))
        if not any((bundle.root / word).is_file() and not Path(word).is_absolute() for word in words):
            raise UsageError(f"{bundle.root}: entry.start: {_NO_PROGRAM}")
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
        suite: File of the suite whose cases are taken.
        builds: Whether their build recipes may run.
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


def copy_shared_file(path: Path, target: Path) -> None:
    """Copy a file into a folder for others, unless it is there: YAML without the schema that it names for editors.

    The path of that schema leads nowhere in another folder; the key `schema` still identifies the file.
    """
    if target.resolve() == path.resolve():
        return
    if path.suffix not in _YAML:
        shutil.copy(path, target)
        return
    target.unlink(missing_ok=True)
    target.write_bytes(without_editor_header(path.read_bytes()))
    shutil.copymode(path, target)


def copy_bundle_files(paths: Sequence[Path], root: Path, folder: Path, into: str) -> dict[Path, str]:
    """Copy files of a bundle with the folders that they lie in; return where each is, from `folder` on."""
    kept: dict[Path, str] = {}
    for path in paths:
        name = f"{into}/{path.relative_to(root).as_posix()}"
        target = folder / name
        target.parent.mkdir(parents=True, exist_ok=True)
        copy_shared_file(path, target)
        kept[path.resolve()] = name
    return kept


def _bundle(content: bytes, submission: Submission, files: Sequence[Path], root: Path) -> Bundle:
    names = tuple(path.relative_to(root).as_posix() for path in files)
    return Bundle(digest=hashlib.sha256(content).hexdigest(), submission=submission, files=names, root=root)
