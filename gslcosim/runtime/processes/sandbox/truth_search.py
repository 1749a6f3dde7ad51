"""Search for what an agent must not see in folders that it may read: scenarios, suites, results, runs and rooms."""

import os
import re
import stat
from collections.abc import Collection, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from gslcosim.base.files import open_regular_file

# More than that is not searched: the run is refused.
MAX_ENTRIES = 50_000
MAX_BYTES = 512 << 20
# Packages of other people, and what was built of the program.
NOT_SEARCHED = frozenset((".venv", "venv", "node_modules", "__pycache__", "site-packages", "target"))
# Neither are these of a program that is installed: beside its `bin`.
_INSTALLED = frozenset(("bin", "lib", "lib64", "libexec", "include", "share", "pkgs", "envs", "conda-meta", "jmods"))
# Its objects hold every earlier version of what lies beside it.
_HISTORY = (".git", ".hg", ".svn", ".jj")
_DATA_FILES = (".yaml", ".yml", ".json", ".jsonl")
# Files of a program may speak of scenarios, as those that make some do.
_CODE_FILES = frozenset((
    ".py", ".pyi", ".pyc", ".ipynb", ".c", ".h", ".cc", ".cpp", ".hpp", ".cxx", ".rs", ".go", ".java", ".class", ".jar",
    ".kt", ".js", ".mjs", ".ts", ".mts", ".m", ".jl", ".lua", ".rb", ".sh", ".so", ".dylib", ".a", ".o", ".wasm",
    ".toml", ".cfg", ".mod", ".sum", ".lock", ".cmake",
))  # fmt: skip
_CODE_BEGINS = (b"\x7fELF", b"\xcf\xfa\xed\xfe", b"\xca\xfe\xba\xbe", b"MZ", b"#!")
_RECORDINGS = (".rrd", ".mcap", ".bag", ".db3")
_RECORDING_BEGINS = (b"RRF", b"RRIO", b"\x89MCAP", b"#ROSBAG")
# Of other files only so much is looked at: a schema stands at the beginning.
_HEAD_BYTES = 64 << 10
_SCHEMA = re.compile(rb"gslcosim/(scenario|suite|results?|maps|environment)/")
# Files with passwords of other processes are none of an agent's business either.
_PASSWORD = re.compile(rb'"password"')
_ESCAPE = re.compile(rb"\\(?:x([0-9a-fA-F]{2})|u00([0-9a-fA-F]{2})|U000000([0-9a-fA-F]{2}))")
_NO_MATTER = re.compile(rb"[\s\0\\]+")
# What stands together in the folder of a run, of results of a suite, and of an environment.
_SIGNS_OF_RUN = ("scenario.yaml", "manifest.json")
_SIGNS = (
    _SIGNS_OF_RUN,
    ("suite.yaml", "manifest.json"),
    ("environment.yaml", "occupancy.npy"),
)
# Results keep the programs that were run.
_PROGRAMS = "agents"


class TooMuchToSearchError(Exception):
    """A folder holds more than is searched."""

    def __init__(self, folder: Path) -> None:
        super().__init__(str(folder))
        self.folder = folder


@dataclass
class _Budget:
    folder: Path
    entries: int
    n_bytes: int

    def spend(self, entries: int, n_bytes: int) -> None:
        self.entries -= entries
        self.n_bytes -= n_bytes
        if self.entries < 0 or self.n_bytes < 0:
            raise TooMuchToSearchError(self.folder)


def find_exposed_truth(folders: Iterable[Path], sources: Collection[Path] = ()) -> list[Path]:
    """Return the scenarios, suites, results, runs, recordings and rooms that lie in folders, however they are named.

    Version control's folders count among them. Files of programs do not, whatever they say.

    Args:
        folders: They are searched to their ends.
        sources: Files that are truth under each name that they have.

    Raises:
        TooMuchToSearchError: a folder holds more than can be searched.
    """
    inodes = {(status.st_dev, status.st_ino) for path in sources if (status := _status(path)) is not None}
    found: list[Path] = []
    for folder in folders:
        passed_over = NOT_SEARCHED | _INSTALLED if (folder / "bin").is_dir() else NOT_SEARCHED
        found += _search(folder, _Budget(folder, MAX_ENTRIES, MAX_BYTES), inodes, passed_over)
    return found


def is_truth_folder(folder: Path) -> bool:
    """Return whether a folder is, or lies in, that of a run, of results of a suite or of a room.

    Args:
        folder: The programs that results keep do not count as part of them.
    """
    around = [folder.resolve(), *folder.resolve().parents]
    return any(_is_result_folder(place) and not folder.resolve().is_relative_to(place / _PROGRAMS) for place in around)


def _search(
    folder: Path, budget: _Budget, inodes: set[tuple[int, int]], passed_over: Collection[str]
) -> Iterator[Path]:
    try:
        entries = sorted(os.scandir(folder), key=lambda entry: entry.name)
    except OSError:
        return
    budget.spend(len(entries), 0)
    if _is_result_folder(folder):
        yield folder
        return
    if folder != budget.folder and any(_holds(Path(entry.path), _SIGNS_OF_RUN) for entry in entries):
        # More may be made in it while the agent looks.
        yield folder
        return
    for entry in entries:
        path = Path(entry.path)
        if entry.name in _HISTORY:
            yield path
        elif entry.is_dir(follow_symlinks=False):
            if entry.name not in passed_over:
                yield from _search(path, budget, inodes, NOT_SEARCHED)
        elif _is_truth(path, budget, inodes):
            yield path
            if entry.is_symlink():
                yield path.resolve()


def _is_result_folder(folder: Path) -> bool:
    return any(_holds(folder, names) for names in _SIGNS)


def _holds(folder: Path, names: Iterable[str]) -> bool:
    return all((folder / name).is_file() for name in names)


def _is_truth(path: Path, budget: _Budget, inodes: set[tuple[int, int]]) -> bool:
    status = _status(path)
    # A pipe would be waited for, for ever.
    if status is None or not stat.S_ISREG(status.st_mode):
        return False
    if (status.st_dev, status.st_ino) in inodes or path.suffix in _RECORDINGS:
        return True
    if path.suffix in _CODE_FILES:
        return False
    is_data = path.suffix in _DATA_FILES
    length = status.st_size if is_data else min(_HEAD_BYTES, status.st_size)
    budget.spend(0, length)
    try:
        with open_regular_file(path) as file:
            data = file.read(length)
    except OSError:
        return False
    if data.startswith(_RECORDING_BEGINS):
        return True
    if data.startswith(_CODE_BEGINS):
        return False
    return _names_schema(data) or (is_data and _PASSWORD.search(data) is not None)


# In each spelling of YAML and JSON: escaped, folded over lines, and in two bytes a character.
def _names_schema(data: bytes) -> bool:
    if _SCHEMA.search(data) is not None:
        return True
    if b"\\" not in data and b"\0" not in data:
        return False
    plain = _ESCAPE.sub(lambda found: bytes.fromhex((found[1] or found[2] or found[3]).decode()), data)
    return _SCHEMA.search(_NO_MATTER.sub(b"", plain)) is not None


def _status(path: Path) -> os.stat_result | None:
    try:
        return path.stat()
    except OSError:
        return None
