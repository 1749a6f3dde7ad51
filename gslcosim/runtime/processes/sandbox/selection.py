"""Selection of the sandbox that an agent or participant gets on this machine, and of what is hidden from it."""

import bz2
import gzip
import io
import itertools
import lzma
import os
import re
import stat
import tarfile
import tempfile
import zipfile
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import IO, Any, Literal

from gslcosim.base.errors import UsageError
from gslcosim.base.files import open_regular_file, read_regular_file
from gslcosim.base.kernel_cache import NUMBA_VARIABLE
from gslcosim.base.problems import Problem
from gslcosim.base.spawn import build_short_environment
from gslcosim.runtime.agents.loader import build_start_command, resolve_command
from gslcosim.runtime.processes.sandbox import confinement
from gslcosim.runtime.processes.sandbox.bubblewrap import find_bubblewrap_failure
from gslcosim.runtime.processes.sandbox.launcher_client import Confinement, is_launcher_possible
from gslcosim.runtime.processes.sandbox.policy import (
    SYSTEM_FOLDERS,
    SandboxPolicy,
    find_own_folders,
    list_code_folders,
    list_hidden_folders,
    list_private_system_paths,
    list_python_folders,
)
from gslcosim.runtime.setup import RunSetup
from gslcosim.scenario import Scenario
from gslcosim.scenario.loader import list_input_files
from gslcosim.scenario.models.participants import ParticipantProgramSpec
from gslcosim.scenario.models.scenario import AgentSpec

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
_RECORDINGS = (".rrd", ".mcap", ".bag", ".db3", ".mp4", ".gif", ".webp")
_RECORDING_BEGINS = (b"RRF", b"RRIO", b"\x89MCAP", b"#ROSBAG", b"GIF8", b"RIFF")
# What a folder of Zarr holds at its top.
_OF_ZARR = (".zgroup", ".zarray", ".zmetadata", "zarr.json")
# Formats that name their columns anywhere: Parquet, Feather, Arrow, HDF5 and so NetCDF 4, NetCDF 3, SQLite.
_BINARY_BEGINS = (b"PAR1", b"ARROW1", b"FEA1", b"\x89HDF", b"CDF", b"SQLite format 3")
# Of archives, as NumPy's and units of FMI are, names of arrays alone count: a unit may have such variables.
_ARCHIVE_BEGIN, _ARRAY_NAME = b"PK", re.compile(rb"\w+(?=\.npy|/\.z(?:array|attrs))")
# Columns of the tables that `extract`, `environment sample` and results have; four of them are a table of ours.
_COLUMNS = re.compile(
    rb"(?<![A-Za-z0-9_])(?:tick|time_s|agent|trial|x_m|y_m|z_m|sigma_m|\w{0,60}_pp[mb]|\w{1,60}_[xyz]_m_s|occupancy|"
    rb"level|text|label|distance_m|tracking_error_m|file|column|unit|meaning)(?![A-Za-z0-9_])"
)
_MIN_COLUMNS = 4
# Beside the schema: a run's name in a dictionary of columns and in metadata, topics of a bag, and what has drawn plots.
_SIGN_OF_EXPORT = re.compile(rb'"run_id": "|CREATE TABLE topics|gslcosim \d|gslcosim plot')
# Compressed files and archives are unpacked, as far as they are searched, these within one another.
_MAX_ARCHIVE_LEVELS = 4
_MAX_ARROW_BYTES = 64 << 20
_BLOCK_BYTES = 1 << 20
_PACKED_TAPES = (".tgz", ".tbz", ".tbz2", ".txz", ".tzst")
_COMPRESSED: Mapping[bytes, Callable[[IO[bytes]], Any]] = {
    b"\x1f\x8b": lambda file: gzip.GzipFile(fileobj=file),
    b"BZh": bz2.BZ2File,
    b"\xfd7zXZ\0": lzma.LZMAFile,
    b"]\0\0": lzma.LZMAFile,
    b"\x28\xb5\x2f\xfd": lambda file: _open_by_arrow(file, "zstd"),
    b"\x04\x22\x4d\x18": lambda file: _open_by_arrow(file, "lz4"),
}
# Nothing here reads archives of 7-Zip and RAR: no program needs one beside it.
_UNREADABLE_BEGINS = (b"7z\xbc\xaf\x27\x1c", b"Rar!")
_PICTURE_BEGINS = (b"\x89PNG", b"%PDF", b"<?xml", b"<svg")
# Of other files only so much is looked at: a schema stands at the beginning.
_HEAD_BYTES = 64 << 10
_SCHEMA = re.compile(rb"gslcosim/(scenario|suite|results?|maps|environment|seal)/")
# Files with passwords of other processes and private keys are none of an agent's business either.
_PASSWORD = re.compile(rb'"password"')
_PRIVATE_KEY = re.compile(rb"-----BEGIN [A-Z ]*PRIVATE KEY-----")
_SEAL = re.compile(rb"gslcosim/seal/")
_ESCAPE = re.compile(rb"\\(?:x([0-9a-fA-F]{2})|u00([0-9a-fA-F]{2})|U000000([0-9a-fA-F]{2}))")
_NO_MATTER = re.compile(rb"[\s\0\\]+")
# What stands together in the folder of a run, of results of a suite, and of an environment.
_SIGNS_OF_RUN = ("scenario.yaml", "manifest.json")
_SIGNS = (
    _SIGNS_OF_RUN,
    ("suite.yaml", "manifest.json"),
    ("environment.yaml", "occupancy.npy"),
)
# Results keep the programs that were run, those of a suite that another one includes with that suite.
_PROGRAMS, _INCLUDED_SUITES = "agents", "suites"


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
        sources: Files that are truth under each name that they have.
    """
    inodes = {(status.st_dev, status.st_ino) for path in sources if (status := _status(path)) is not None}
    found: list[Path] = []
    for folder in folders:
        passed_over = NOT_SEARCHED | _INSTALLED if (folder / "bin").is_dir() else NOT_SEARCHED
        found += _search(folder, _Budget(folder, MAX_ENTRIES, MAX_BYTES), inodes, passed_over)
    return found


def holds_secret(path: Path) -> bool:
    """Return whether a file is a private key or the secret of a sealed suite, which nobody else may have.

    Args:
        path: A file; of a long one, which is neither, nothing is read.
    """
    try:
        data = read_regular_file(path, max_bytes=_HEAD_BYTES)
    except OSError:
        return False
    return _holds_private_key(data) or (_SEAL.search(data) is not None and b'"nonce"' in data)


def _holds_private_key(data: bytes) -> bool:
    return _PRIVATE_KEY.search(data) is not None


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


# Without recursion: another program may have nested folders as deep as it likes.
def _search(root: Path, budget: _Budget, inodes: set[tuple[int, int]], passed_over: Collection[str]) -> Iterator[Path]:
    unseen = [root]
    while unseen:
        folder = unseen.pop()
        try:
            entries = sorted(os.scandir(folder), key=lambda entry: entry.name)
        except OSError:
            continue
        budget.spend(len(entries), 0)
        is_below = folder != root
        # More may be made beside a run while the agent looks.
        if (
            _is_result_folder(folder)
            or (is_below and any(entry.name in _OF_ZARR for entry in entries))
            or (is_below and any(_holds(Path(entry.path), _SIGNS_OF_RUN) for entry in entries))
        ):
            yield folder
            continue
        for entry in entries:
            path = Path(entry.path)
            if entry.name in _HISTORY:
                yield path
            elif entry.is_dir(follow_symlinks=False):
                if entry.name not in (NOT_SEARCHED if is_below else passed_over):
                    unseen.append(path)
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
    if (status.st_dev, status.st_ino) in inodes:
        return True
    try:
        with open_regular_file(path) as file:
            return _holds_truth(path.name, file, budget, n_bytes=status.st_size)
    # Of what is damaged or locked with a password nothing is read; its libraries raise what they like.
    except TooMuchToSearchError:
        raise
    except Exception:
        return False


# `level` counts the archives around it; only of a plain file the length is known before it is unpacked.
def _holds_truth(name: str, file: IO[bytes], budget: _Budget, *, n_bytes: int | None = None, level: int = 0) -> bool:
    suffix = Path(name).suffix
    if suffix in _RECORDINGS:
        return True
    if suffix in _CODE_FILES:
        return False
    is_data = suffix in _DATA_FILES
    data = _read_within(budget, file, MAX_BYTES if is_data else _HEAD_BYTES)
    if data.startswith(_UNREADABLE_BEGINS) or data.startswith(_RECORDING_BEGINS) or data[4:8] == b"ftyp":
        return True
    if data.startswith(_CODE_BEGINS):
        return False
    is_archive = data.startswith(_ARCHIVE_BEGIN)
    if level < _MAX_ARCHIVE_LEVELS and any(
        _holds_truth(inner, content, budget, level=level + 1) for inner, content in _unpack(name, data, file, budget)
    ):
        return True
    if is_archive or data.startswith((*_BINARY_BEGINS, *_PICTURE_BEGINS)):
        file.seek(len(data) if n_bytes is None else max(len(data), n_bytes - _HEAD_BYTES))
        tail = b""
        while block := _read_within(budget, file, _BLOCK_BYTES):
            tail = (tail + block)[-_HEAD_BYTES:]
        data += tail
    has_secret = _holds_private_key(data) or (is_data and _PASSWORD.search(data) is not None)
    return has_secret or _names_schema(data) or _is_export(data)


def _read_within(budget: _Budget, file: IO[bytes], n_bytes: int) -> bytes:
    data = bytearray()
    while len(data) < n_bytes and (block := file.read(min(_BLOCK_BYTES, n_bytes - len(data)))):
        budget.spend(0, len(block))
        data += block
    return bytes(data)


# Yields what a compressed file or an archive holds, with its name, one at a time; nothing for all others.
def _unpack(name: str, data: bytes, file: IO[bytes], budget: _Budget) -> Iterator[tuple[str, IO[bytes]]]:
    file.seek(0)
    if data.startswith(_ARCHIVE_BEGIN):
        with zipfile.ZipFile(file) as archive:
            for member in archive.infolist():
                budget.spend(1, 0)
                # Names of arrays are looked at where they are: units of FMI may have such variables.
                if not member.is_dir() and not member.flag_bits & 1 and not member.filename.endswith(".npy"):
                    with archive.open(member) as content:
                        yield member.filename, content
    elif data[257:262] == b"ustar":
        with tarfile.open(fileobj=file) as tape:
            for entry in tape:
                budget.spend(1, entry.size if name.endswith(_PACKED_TAPES) else 0)
                if (content := tape.extractfile(entry) if entry.isreg() else None) is not None:
                    yield entry.name, content
    elif (opened := next((begin for begin in _COMPRESSED if data.startswith(begin)), None)) is not None:
        with _COMPRESSED[opened](file) as content:
            # `a.csv.gz` has `a.csv` in it, and `a.tgz` a tape.
            inner = name.removesuffix(Path(name).suffix)
            yield (name if Path(name).suffix in _PACKED_TAPES else inner), content


def _open_by_arrow(file: IO[bytes], codec: str) -> IO[bytes]:
    import pyarrow  # pyright: ignore[reportMissingTypeStubs]

    arrow: Any = pyarrow
    with arrow.CompressedInputStream(file, codec) as stream:
        return io.BytesIO(stream.read(_MAX_ARROW_BYTES))


# Of text the first line alone is looked at, so that a page about tables is none.
def _is_export(data: bytes) -> bool:
    is_binary, is_json = data.startswith(_BINARY_BEGINS), data.lstrip(b"\xef\xbb\xbf \t\r\n")[:1] in (b"{", b"[")
    if (is_binary or is_json or data.startswith(_PICTURE_BEGINS)) and _SIGN_OF_EXPORT.search(data) is not None:
        return True
    if data.startswith(_ARCHIVE_BEGIN):
        data = b" ".join(_ARRAY_NAME.findall(data))
    columns = set(_COLUMNS.findall(data if is_binary else data.partition(b"\n")[0]))
    return len(columns) >= _MIN_COLUMNS or {b"tick", b"time_s"} <= columns


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


SandboxKind = Literal["bubblewrap", "landlock", "none"]
NONE_IN_THIS_PROCESS = "none: in this process"
NONE_STARTED_ELSEWHERE = "none: started elsewhere"


# Whose process is confined; `place` is its place in the scenario, for errors.
ConfinementSpec = AgentSpec | ParticipantProgramSpec


def unavailable_reason(kind: SandboxKind) -> str:
    """Return why a sandbox does not work on this machine, empty when it works."""
    if kind == "none":
        return ""
    if kind == "bubblewrap":
        return find_bubblewrap_failure()
    if not confinement.read_landlock_version():
        return "this kernel has no Landlock"
    return "" if confinement.can_filter() else "there is no filter of system calls for this kind of processor"


def find_strongest_sandbox() -> SandboxKind:
    """Return the strongest sandbox that works on this machine."""
    if not unavailable_reason("bubblewrap"):
        return "bubblewrap"
    return "none" if unavailable_reason("landlock") else "landlock"


def describe_sandboxes(scenario: Scenario, *, is_one_process: bool) -> Mapping[str, str]:
    """Return by agent and participant what its process is confined by, in the words of `result.json`."""
    starts = {agent.name: agent for agent in scenario.agents}
    of_agents = {
        agent.name: _describe_sandbox(starts[agent.process], is_one_process=is_one_process) for agent in scenario.agents
    }
    return {**of_agents, **{participant.name: _describe_started(participant) for participant in scenario.participants}}


def is_sandboxed(sandboxes: str) -> bool:
    """Return whether words of `describe_sandboxes`, or several of them joined by `; `, are all about sandboxes."""
    return bool(sandboxes) and not any(each.startswith("none") for each in sandboxes.split("; "))


def choose_sandbox(agent: ConfinementSpec) -> SandboxKind:
    """Return which sandbox the process of an agent or participant is started in."""
    _raise_problem(agent, _find_missing_sandbox(agent))
    start = agent.start.registered if isinstance(agent, AgentSpec) else None
    if start is not None and not start.is_confinable:
        return "none"
    return find_strongest_sandbox() if agent.sandbox in ("auto", "required") else agent.sandbox


def find_sandbox_problems(scenario: Scenario, directory: Path) -> Iterator[Problem]:
    """Yield what a scenario demands for its processes, and this machine or the way they are started does not give.

    Args:
        scenario: What is to be flown; its `processes` say whether Python agents are objects.
    """
    del directory
    is_one_process = scenario.processes == "one"
    for i, agent in enumerate(scenario.agents):
        if agent.process == agent.name:
            is_object = is_one_process and not agent.start.is_behind_gateway
            has_none = agent.start.attach or is_object
            problems = (_find_demands_without_process if has_none else _find_unmet_demands)(agent)
            yield from (replace(problem, where=f"agents[{i}].{problem.where}") for problem in problems)
    for i, participant in enumerate(scenario.participants):
        for problem in _find_unmet_demands(participant):
            yield replace(problem, where=f"participants[{i}].{problem.where}")


def _find_unmet_demands(agent: ConfinementSpec) -> Iterator[Problem]:
    found = (_find_missing_sandbox(agent), _find_missing_limits(agent), _find_unset_variable(agent, os.environ))
    return (problem for problem in found if problem is not None)


def _find_missing_sandbox(agent: ConfinementSpec) -> Problem | None:
    if agent.sandbox == "required" and find_strongest_sandbox() == "none":
        reasons = f"{unavailable_reason('bubblewrap')}; {unavailable_reason('landlock')}"
        remedy = f"{reasons[:1].upper()}{reasons[1:]}. Install bubblewrap, or take auto."
        return Problem(where="sandbox", expected="a sandbox on this machine", found="none", remedy=remedy)
    if agent.sandbox in ("auto", "required") or not (reason := unavailable_reason(agent.sandbox)):
        return None
    return Problem(
        where="sandbox",
        expected=f"{agent.sandbox} on this machine",
        found=f"one where it does not work: {reason}",
        remedy="Install it, or take auto for the strongest that works here; `gslcosim doctor` says which that is.",
    )


def _find_missing_limits(agent: ConfinementSpec) -> Problem | None:
    if not agent.limits.are_given or is_launcher_possible():
        return None
    return Problem(where="limits", expected="Linux for limits", found="another system", remedy="Leave them out.")


def _find_unset_variable(agent: ConfinementSpec, around: Mapping[str, str]) -> Problem | None:
    name = next((name for name, value in (agent.environment or {}).items() if value is None and name not in around), "")
    if not name:
        return None
    expected = "a variable that is set where gslcosim starts, since it has no value here"
    return Problem(where=f"environment.{name}", expected=expected, found="unset", remedy="Set it, or write its value.")


def _find_demands_without_process(agent: AgentSpec) -> Iterator[Problem]:
    where = "started elsewhere" if agent.start.attach else "an object in this process"
    remedy = (
        "Confine it where it is started, and leave this out."
        if agent.start.attach
        else "Leave out --in-process, or start it with door: stdio."
    )
    wanted = {
        "sandbox": {"required": "a sandbox", "auto": "", "none": ""}.get(agent.sandbox, agent.sandbox),
        "limits": "bounds" if agent.limits.are_given else "",
        "environment": "variables" if agent.environment else "",
    }
    for key, value in wanted.items():
        if value:
            expected = f"an agent with a process that is started here for {value}"
            yield Problem(where=key, expected=expected, found=where, remedy=remedy)


def _raise_problem(agent: ConfinementSpec, problem: Problem | None) -> None:
    if problem is not None:
        raise UsageError(f"{agent.place}.{problem}")


def _describe_sandbox(agent: AgentSpec, *, is_one_process: bool) -> str:
    is_object = is_one_process and not agent.start.is_behind_gateway
    if agent.start.attach or is_object:
        _raise_problem(agent, next(_find_demands_without_process(agent), None))
        return NONE_STARTED_ELSEWHERE if agent.start.attach else NONE_IN_THIS_PROCESS
    return _describe_started(agent)


def _describe_started(agent: ConfinementSpec) -> str:
    kind = choose_sandbox(agent)
    _raise_problem(agent, _find_missing_limits(agent))
    gaps = list_open_gaps(kind)
    name = f"landlock {confinement.read_landlock_version()}" if kind == "landlock" else kind
    return f"{name} (open: {', '.join(gaps)})" if gaps else name


def list_open_gaps(kind: SandboxKind) -> list[str]:
    """Return in words what a sandbox leaves open on this machine that it closes on others."""
    if kind == "landlock":
        return confinement.list_missing_protections(confinement.read_landlock_version())
    if kind == "bubblewrap" and not confinement.can_filter():
        return ["keys of the user, perf, watching of files and io_uring are not refused on this kind of processor"]
    return []


def build_environment_variables(
    agent: ConfinementSpec, command: Sequence[str], surroundings: Mapping[str, str] | None = None
) -> dict[str, str]:
    """Return the variables with which the process of an agent or participant starts; those of the run come on top.

    Args:
        surroundings: From which variables are taken; absent: this process's own.
    """
    around = os.environ if surroundings is None else surroundings
    variables = build_short_environment(command, around)
    _raise_problem(agent, _find_unset_variable(agent, around))
    for name, value in (agent.environment or {}).items():
        variables[name] = around[name] if value is None else value
    return variables


def build_confinement(
    agent: ConfinementSpec,
    command: Sequence[str],
    setup: RunSetup,
    *,
    directory: Path,
    private_dir: Path,
    address: str = "",
) -> Confinement:
    """Return how the process of an agent or participant is confined, which reaches the run at an address, if at one.

    Args:
        address: `unix:PATH` or `tcp:HOST:PORT`.
    """
    kind = choose_sandbox(agent)
    door, _, place = address.partition(":")
    environment = build_environment_variables(agent, command)
    if kind == "none":
        return Confinement(limits=agent.limits, environment=environment)
    scratch = private_dir / f"scratch-{agent.name}"
    scratch.mkdir(mode=0o700)
    own = find_own_folders(command, directory)
    granted = [(directory / Path(path).expanduser()).absolute() for path in agent.may_read]
    sources = [*setup.sources, *list_input_files(setup.scenario, directory)]
    _check_program(agent, [folder for folder in own if folder not in granted], setup, sources)
    of_python = list_python_folders()
    searched = {*own, *granted}.difference(of_python)
    needed = (*own, *granted, *of_python)
    private = [path for path in list_private_system_paths() if not any(map(path.is_relative_to, needed))]
    hidden = [
        *private,
        *list_hidden_folders(),
        *_truth_within(agent, searched, sources),
        *_list_run_folders(setup),
        *sources,
    ]
    hidden = [path for path in hidden if path not in (*own, *granted)]
    is_python = Path(command[0]).name.startswith("python") and NUMBA_VARIABLE in os.environ
    kernels = Path(os.environ[NUMBA_VARIABLE]) if is_python else None
    writes = [(directory / Path(path).expanduser()).absolute() for path in agent.may_write]
    _check_writes(agent, writes, setup, directory)
    readable = [*own, *granted, *of_python, *map(Path, SYSTEM_FOLDERS)]
    hidden += [path.resolve() for path in hidden]
    cell = SandboxPolicy(
        directory=directory.absolute(),
        reads=_keep_existing([*readable, *([kernels] if kernels is not None else [])]),
        hidden=_keep_existing([*hidden, *_under_other_names(hidden, readable)]),
        writes=_keep_existing(writes),
        sockets=(Path(place),) if door == "unix" else (),
        tcp_port=int(place.rpartition(":")[2]) if door == "tcp" else None,
        kernels=kernels,
        scratch=scratch,
    )
    return Confinement(kind=kind, policy=cell, limits=agent.limits, environment=environment)


# What stands beside a program is seen by it.
def _check_program(agent: ConfinementSpec, own: Sequence[Path], setup: RunSetup, sources: Sequence[Path]) -> None:
    runs, temporary = setup.run_dir.path.absolute().parent, Path(tempfile.gettempdir())
    for folder in own:
        place = folder.resolve()
        if is_truth_folder(folder) or any(place.is_relative_to(each.resolve()) for each in sources):
            raise UsageError(
                f"{agent.place}.start: expected a command that names no file of a run, of results or of an "
                f"environment, which an agent in a sandbox does not see, was one in {folder}. Move the program "
                "elsewhere, or name the folder in may_read."
            )
        if place == runs.resolve() or temporary.resolve().is_relative_to(place):
            what = "runs are made" if place == runs.resolve() else "other processes keep their temporary files"
            raise UsageError(
                f"{agent.place}.start: expected a program in a folder of its own, which the agent in a sandbox sees "
                f"with all that comes to lie there, was one in {folder}, where {what}. Move the program, or name "
                "the folder in may_read."
            )


def _truth_within(agent: ConfinementSpec, searched: Collection[Path], sources: Collection[Path]) -> list[Path]:
    try:
        return find_exposed_truth(searched, sources)
    except TooMuchToSearchError as error:
        raise UsageError(
            f"{agent.place}: expected at most {MAX_ENTRIES} files of {MAX_BYTES >> 20} MB in folders that the agent "
            f"reads, which are searched for scenarios and runs that it must not see, was more in {error.folder}. Move "
            "the program into a folder of its own, or name smaller folders in may_read."
        ) from error


# Where code or runs are nothing may be written, nor around it; agents may share a folder within that of their programs.
def _check_writes(agent: ConfinementSpec, writes: Sequence[Path], setup: RunSetup, directory: Path) -> None:
    closed = [*list_code_folders(), *list_hidden_folders(), *_list_run_folders(setup)]
    programs = _list_other_programs(agent, setup, directory)
    for given, folder in zip(agent.may_write, writes, strict=True):
        for place in dict.fromkeys((folder, folder.resolve())):
            within = (each for each in (*closed, *programs) if each.is_relative_to(place))
            around = (each for each in closed if place.is_relative_to(each))
            if (other := next(itertools.chain(within, around), None)) is not None:
                raise UsageError(
                    f"{agent.place}.may_write: expected a folder from which no other process reads code and which "
                    f"holds nothing of runs, was {given!r}, which is part of {other} or has it within. Name a folder "
                    "of its own."
                )


def _list_other_programs(agent: ConfinementSpec, setup: RunSetup, directory: Path) -> list[Path]:
    scenario = setup.scenario
    commands = [build_start_command(each, directory) for each in scenario.agents if each.name != agent.name]
    commands += [
        resolve_command(each.start.words, directory) for each in scenario.participants if each.name != agent.name
    ]
    own = [folder for command in commands if command is not None for folder in find_own_folders(command, directory)]
    return [*own, *(folder.resolve() for folder in own)]


def _list_run_folders(setup: RunSetup) -> list[Path]:
    run = setup.run_dir.path.absolute()
    return [run.parent, run, setup.environment_dir]


# Where a folder is read by way of a link, what is hidden in it has that name too.
def _under_other_names(hidden: Sequence[Path], readable: Sequence[Path]) -> list[Path]:
    return [
        folder / path.relative_to(folder.resolve())
        for folder in readable
        if folder.resolve() != folder
        for path in hidden
        if path.is_relative_to(folder.resolve())
    ]


def _keep_existing(paths: Sequence[Path]) -> tuple[Path, ...]:
    return tuple(path for path in dict.fromkeys(paths) if path.exists())
