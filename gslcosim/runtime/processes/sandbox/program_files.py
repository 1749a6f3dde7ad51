"""Files of a program that its sandbox binds: those of its command line, its code, and those that its card names.

Of a bundle all files are the program's. Names and kinds of files decide, never contents: elsewhere a copy of a scenario
is hidden under each name but that of code.
"""

import os
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from gslcosim.base.bundled import CARD_FILE, SUBMISSION_FILE
from gslcosim.base.errors import UsageError
from gslcosim.methods.card import find_card_beside

# A folder with more entries, and one with more places of code, is refused.
MAX_ENTRIES = 50_000
MAX_PLACES = 500
# Packages of others and build products, bound whole and not entered.
_VENDORED = frozenset((".venv", "venv", "node_modules", "__pycache__", "site-packages", "target"))
# Folders of an installed program, beside its `bin`.
_INSTALLED = frozenset(("bin", "lib", "lib64", "libexec", "include", "share", "pkgs", "envs", "conda-meta", "jmods"))
_HISTORY = frozenset((".git", ".hg", ".svn", ".jj"))
_CODE_KINDS = frozenset((
    ".py", ".pyi", ".pyc", ".pyd", ".c", ".h", ".cc", ".cpp", ".hpp", ".cxx", ".rs", ".go", ".java", ".class", ".jar",
    ".kt", ".scala", ".clj", ".js", ".mjs", ".cjs", ".ts", ".mts", ".node", ".m", ".mexa64", ".jl", ".lua", ".rb",
    ".pl", ".r", ".f90", ".cs", ".fs", ".swift", ".zig", ".hs", ".sh", ".so", ".dylib", ".dll", ".exe", ".a", ".o",
    ".wasm", ".toml", ".cfg", ".mod", ".sum", ".lock", ".cmake",
))  # fmt: skip
_CODE_NAMES = frozenset(("package.json", "tsconfig.json", "CMakeLists.txt", "Makefile", CARD_FILE))
# Products of builds, which a program that has been built does not read.
_BUILD_KINDS = frozenset(("", ".d", ".rlib", ".rmeta"))
_CODE_BEGINS = (b"\x7fELF", b"\xcf\xfa\xed\xfe", b"\xca\xfe\xba\xbe", b"MZ", b"#!")
_NAMES_OF_RUNS = frozenset(("scenario.yaml", "suite.yaml", "result.json", "inputs.log"))
# Files that stand together in the folder of a run, of results of a suite, and of an environment.
_SIGNS = (
    ("scenario.yaml", "manifest.json"),
    ("suite.yaml", "manifest.json"),
    ("environment.yaml", "occupancy.npy"),
)
# Results keep the programs that were run, those of a suite that another one includes with that suite.
_PROGRAMS, _INCLUDED_SUITES = "agents", "suites"


@dataclass(frozen=True, kw_only=True)
class ProgramFiles:
    """Places that a sandbox binds for a program, and files beside it, none of a run, that stay hidden."""

    reads: tuple[Path, ...]
    unseen: tuple[Path, ...]


class PrivatePlaces:
    """Files and folders that belong to runs, by path and, under other names, by inode."""

    def __init__(self, paths: Collection[Path]) -> None:
        self._paths = {path.resolve() for path in paths}
        self._inodes = {(status.st_dev, status.st_ino) for path in paths if (status := _status(path)) is not None}

    def contains(self, path: Path) -> bool:
        """Return whether a place is one of them, or lies in one."""
        # `Path.resolve` raises at links that lead back to themselves.
        place = Path(os.path.realpath(path))
        status = _status(place)
        is_same = status is not None and (status.st_dev, status.st_ino) in self._inodes
        return is_same or not self._paths.isdisjoint((place, *place.parents))


def select_program_files(folder: Path, named: Collection[Path], private: PrivatePlaces, *, place: str) -> ProgramFiles:
    """Return what a sandbox binds of the folder of a program.

    Args:
        folder: The folder that the command line names, or that of a file that it names.
        named: Files of it that the command line names.
        place: Place of the agent or participant in its scenario, for errors.

    Raises:
        UsageError: The card names other files than those of its folder, or the folder has too many files.
    """
    card = find_card_beside(folder / CARD_FILE)
    given = [_find_card_file(folder, name, private, place) for name in (card.files if card is not None else ())]
    code: list[Path] = []
    unseen: list[Path] = []
    is_bundle = (folder / SUBMISSION_FILE).is_file()
    for path, is_whole in _iterate_entries(folder, place):
        is_packed = is_bundle and path.is_file() and not path.is_symlink() and not path.name.startswith(".")
        is_own = is_packed and not _is_of_run(path, private)
        is_code = is_own or (not private.contains(path) and (is_whole or _is_code(path, folder)))
        (code if is_code else unseen).append(path)
    # A subfolder with nothing but code is bound as one.
    mixed = {folder, *folder.parents, *(each for path in unseen for each in path.parents)}
    places = [next((each for each in reversed(path.parents) if each not in mixed), path) for path in code]
    reads = tuple(dict.fromkeys((*(path for path in named if not _is_of_run(path, private)), *given, *places)))
    if len(reads) > MAX_PLACES:
        raise UsageError(
            f"{place}.start: expected at most {MAX_PLACES} files of code beside files that are none, were {len(reads)} "
            f"in {folder}. Move the program into a folder of its own."
        )
    data = (path for path in unseen if path.is_file() and not path.name.startswith("."))
    files = (path for path in data if path.suffix not in _BUILD_KINDS and not _is_of_run(path, private))
    return ProgramFiles(reads=reads, unseen=tuple(path for path in files if not any(map(path.is_relative_to, reads))))


def list_run_places(folder: Path, private: PrivatePlaces, *, place: str) -> list[Path]:
    """Return what a folder that an agent is granted holds of runs and of version control."""
    entries = _iterate_entries(folder, place)
    return [path for path, _ in entries if path.name in _HISTORY or _is_of_run(path, private)]


# The author of an agent can name only what lies beside it.
def _find_card_file(folder: Path, name: str, private: PrivatePlaces, place: str) -> Path:
    path = folder / name
    is_below = not PurePosixPath(name).is_absolute() and ".." not in PurePosixPath(name).parts
    is_below = is_below and folder.resolve() in Path(os.path.realpath(path)).parents
    within = [path, *(each for each, _ in (_iterate_entries(path, place) if is_below and path.is_dir() else ()))]
    if not is_below or not path.exists():
        found = "none" if is_below else "a place outside of it, or the folder itself"
        problem = f"expected files and folders within the folder of the card, found {found}: {name!r}. Correct it"
    elif (bad := next((each for each in within if _is_of_run(each, private)), None)) is not None:
        problem = f"expected files of the program, found {bad}, which belongs to a run. Move it elsewhere"
    else:
        return path
    raise UsageError(f"{place}.start: {CARD_FILE}: files: {problem}.\nFile: {folder / CARD_FILE}")


# Yields the files below a folder, and the folders that are not entered: those of others' packages, which count as a
# whole (the second value), and those of runs, of version control, and hidden ones.
def _iterate_entries(root: Path, place: str) -> Iterator[tuple[Path, bool]]:
    whole_at_root = _VENDORED | _INSTALLED if (root / "bin").is_dir() else _VENDORED
    unseen, n_entries = [root], 0
    while unseen:
        folder = unseen.pop()
        try:
            entries = sorted(os.scandir(folder), key=lambda entry: entry.name)
        except OSError:
            continue
        n_entries += len(entries)
        if n_entries > MAX_ENTRIES:
            raise UsageError(
                f"{place}: expected at most {MAX_ENTRIES} files in a folder that an agent reads, was more in {root}. "
                "Move the program into a folder of its own, or name smaller folders in may_read."
            )
        for entry in entries:
            path = Path(entry.path)
            is_folder = entry.is_dir(follow_symlinks=False)
            is_whole = is_folder and entry.name in (whole_at_root if folder == root else _VENDORED)
            is_closed = (
                is_whole or entry.name.startswith(".") or entry.name in _NAMES_OF_RUNS or _is_result_folder(path)
            )
            if is_folder and not is_closed:
                unseen.append(path)
            else:
                yield path, is_whole


def _is_of_run(path: Path, private: PrivatePlaces) -> bool:
    return path.name in _NAMES_OF_RUNS or private.contains(path) or _is_result_folder(path)


# A link to code within the folder is code, whatever its own name.
def _is_code(path: Path, folder: Path) -> bool:
    target = Path(os.path.realpath(path))
    if not target.is_file() or folder.resolve() not in target.parents:
        return False
    if target.suffix.lower() in _CODE_KINDS or target.name in _CODE_NAMES:
        return True
    return not target.suffix and os.access(target, os.X_OK) and _begins_like_code(target)


def _begins_like_code(path: Path) -> bool:
    try:
        with path.open("rb") as file:
            return file.read(4).startswith(_CODE_BEGINS)
    except OSError:
        return False


def is_truth_folder(folder: Path) -> bool:
    """Return whether a folder is, or lies in, that of a run, of results of a suite or of a room.

    Args:
        folder: The programs that results keep do not count as part of them.
    """
    around = [folder.resolve(), *folder.resolve().parents]
    return any(_is_result_folder(place) and not _is_kept_program(folder.resolve(), place) for place in around)


def _is_kept_program(folder: Path, results: Path) -> bool:
    parts = folder.relative_to(results).parts
    while parts[:1] == (_INCLUDED_SUITES,):
        parts = parts[2:]
    return parts[:1] == (_PROGRAMS,)


def _is_result_folder(folder: Path) -> bool:
    return any(all((folder / name).is_file() for name in names) for names in _SIGNS)


def _status(path: Path) -> os.stat_result | None:
    try:
        return path.stat()
    except OSError:
        return None
