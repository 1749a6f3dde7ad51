"""Ray worker actor: the code that runs on the nodes of a cluster, and the bundle of files that it gets."""

import hashlib
import json
import os
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import gslcosim
from gslcosim.base.bundled import bundled_agents
from gslcosim.base.disk_cache import mark_used
from gslcosim.base.errors import EnvironmentDataError, GslCosimError
from gslcosim.base.files import ScratchFolder, list_files
from gslcosim.base.kernel_cache import get_cache_root
from gslcosim.environment.store import load_environment
from gslcosim.runtime.status import RunResult
from gslcosim.scenario import Scenario
from gslcosim.scenario.models.scenario import StartSpec
from gslcosim_bench.cases.models import EntrySpec, LimitsSpec, Trial
from gslcosim_bench.cases.suite_files import list_entry_files, list_program_files, software_hash
from gslcosim_bench.execution.pool import Failure, Job, JobResult, LocalPool
from gslcosim_bench.execution.trial import TrialResult

# Programs of the system are the node's own.
_OF_THE_SYSTEM = tuple(Path(each) for each in ("/usr", "/bin", "/sbin", "/lib", "/opt", sys.prefix, sys.base_prefix))
# What is larger is put on the nodes by hand; and of such files their beginnings distinguish them.
_MOST_BYTES = 1 << 30
_READ_BYTES = 1 << 26
# What a file of geometry draws in from beside it.
_BESIDE = {".gltf": ("*.bin",), ".xml": ("**/*.stl", "**/*.obj", "**/*.xml", "**/*.msh")}

Contents = dict[str, tuple[int, bytes]]
"""Files by their absolute paths: mode and bytes."""
_LOOK_EVERY_S = 0.5
_DIGITS = 24


@dataclass(frozen=True)
class FileBundle:
    """The files of a trial: where its relative paths start, and each file's absolute path with a hash.

    `names` are the absolute paths that the scenario itself mentions, as it writes them.
    """

    directory: str
    files: tuple[tuple[str, str], ...]
    names: tuple[tuple[str, str], ...]

    @cached_property
    def key(self) -> str:
        """Equal for equal files in equal places."""
        text = json.dumps([self.directory, self.files])
        return hashlib.blake2b(text.encode(), digest_size=12).hexdigest()

    def is_here(self) -> bool:
        """True where this machine has the same files at the same paths."""
        return Path(self.directory).is_dir() and all(_hash_of(Path(path)) == known for path, known in self.files)

    def contents(self) -> Contents | None:
        """Return the files themselves; None where they are too much to carry."""
        paths = [Path(path) for path, _ in self.files]
        if sum(path.stat().st_size for path in paths) > _MOST_BYTES:
            return None
        return {str(path): (path.stat().st_mode & 0o777, path.read_bytes()) for path in paths}


class BundleBuilder:
    """Finds what trials need; trials of one program and one room need the same."""

    def __init__(self) -> None:
        self._known: dict[str, FileBundle] = {}

    def build_bundle(self, trial: Trial) -> FileBundle:
        """Return the file bundle of a trial."""
        values = json.loads(trial.scenario_json)
        starts = [agent["start"] for agent in values["agents"]]
        decides = [values["environment"], values["wind"].get("solver"), values["gas"].get("playback"), starts]
        key = f"{trial.directory}\n{json.dumps(decides)}"
        if key not in self._known:
            self._known[key] = _collect_scenario_files(trial.resolved, trial.directory)
        return self._known[key]


def unpack_bundle(bundle: FileBundle, contents: Contents | None) -> Path:
    """Return a folder of this machine below which all files lie as they do on the machine that they come from.

    It is kept in the cache, for all workers of the machine and for later.
    """
    if contents is None:
        first = next((path for path, known in bundle.files if _hash_of(Path(path)) != known), bundle.directory)
        raise EnvironmentDataError(
            f"{first}: expected on this node the same file as where the benchmark was started, found none or another. "
            f"The files of this trial are more than {_MOST_BYTES >> 30} GB: copy them to the same place on each node."
        )
    root = get_cache_root() / "shipped" / bundle.key
    mark_used(root)
    if root.is_dir():
        return root
    root.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=root.parent, ignore_cleanup_errors=True) as beside:
        filling = Path(beside) / "files"
        (path_below(filling, bundle.directory)).mkdir(parents=True)
        for path, (mode, content) in contents.items():
            target = path_below(filling, path)
            target.parent.mkdir(parents=True, exist_ok=True)
            target.write_bytes(content)
            target.chmod(mode)
        try:
            filling.rename(root)
        except OSError:
            if not root.is_dir():  # otherwise another worker was faster
                raise
    return root


def relocate_trial(trial: Trial, bundle: FileBundle, root: Path) -> Trial:
    """Return a trial that reads its files below a folder, see `unpack_bundle`."""
    names = {name: str(path_below(root, path)) for name, path in bundle.names}
    values = json.loads(trial.scenario_json)
    for key in ("environment", "wind", "gas"):
        values[key] = _renamed(values[key], names)
    for agent in values["agents"]:
        agent["start"] = _renamed(agent["start"], names)
    return replace(trial, scenario_json=json.dumps(values), directory=path_below(root, trial.directory))


def path_below(root: Path, path: Path | str) -> Path:
    """Return where a file with an absolute path lies below a folder."""
    return root / os.path.abspath(path).lstrip("/")  # noqa: PTH100 - `..` goes, links stay


def _renamed(value: Any, names: Mapping[str, str]) -> Any:
    if isinstance(value, str):
        return names.get(value, value)
    if isinstance(value, list):
        return [_renamed(each, names) for each in value]
    if isinstance(value, dict):
        return {key: _renamed(each, names) for key, each in value.items()}
    return value


def _collect_scenario_files(scenario: Scenario, directory: Path) -> FileBundle:
    names: dict[str, str] = {}
    files: set[Path] = set()
    for name, place in _places_in(scenario, directory):
        if Path(name).expanduser().is_absolute():
            names[name] = _absolute(place)
        files |= set(_files_at(place))
    for agent in scenario.agents:
        found = _program_files(agent.start, directory)
        files |= found
        for word in (agent.start.python or "", *(agent.start.command or ())):
            if Path(word).is_absolute() and _absolute(Path(word)) in {_absolute(path) for path in found}:
                names[word] = _absolute(Path(word))
    absolute = sorted(_absolute(path) for path in files)
    return FileBundle(
        directory=_absolute(directory),
        files=tuple((path, _hash_of(Path(path)) or "") for path in absolute),
        names=tuple(sorted(names.items())),
    )


# As the scenario writes it, and where that is.
def _places_in(scenario: Scenario, directory: Path) -> Iterator[tuple[str, Path]]:
    for text in (*scenario.environment.inputs, scenario.wind.file, scenario.gas.stored_folder):
        if text is not None:
            yield text, directory / Path(text).expanduser()


def _files_at(place: Path) -> Iterator[Path]:
    if place.is_dir():
        yield from list_files(place)
    elif place.is_file():
        yield place
        for pattern in _BESIDE.get(place.suffix.lower(), ()):
            yield from place.parent.glob(pattern)


# A program is what its hash counts; bundled ones are part of what is installed.
def _program_files(start: StartSpec, directory: Path) -> set[Path]:
    if start.process_of is not None or start.attach:
        return set()
    if start.python is not None and not (directory / start.python).is_file():
        return set()
    words = (directory / word for word in (start.python, *(start.command or ())) if word)
    # Words longer than the name of any file are none.
    named = {word for word in words if os.path.isfile(word)}  # noqa: PTH113
    found = named | set(list_entry_files(EntrySpec(name="program", start=start), directory))
    return {path for path in found if not any(path.is_relative_to(each) for each in _OF_THE_SYSTEM)}


def _absolute(path: Path) -> str:
    return os.path.abspath(path)  # noqa: PTH100 - `..` goes, links stay


def _hash_of(path: Path) -> str | None:
    try:
        with path.open("rb") as file:
            size = os.fstat(file.fileno()).st_size
            return hashlib.blake2b(file.read(_READ_BYTES) + str(size).encode(), digest_size=12).hexdigest()
    except OSError:
        return None


@dataclass(frozen=True, kw_only=True)
class NodeEnvironment:
    """A room on a node: where it is there, and what it holds."""

    folder: Path
    content_hash: str


@dataclass(frozen=True, kw_only=True)
class RecordedTrial:
    """A run with a recording: its result, and the files of its run directory by their relative paths."""

    flight: RunResult
    files: dict[str, bytes]


@dataclass(frozen=True, kw_only=True)
class NodeJobResult:
    """A job that has ended on a node, and what its worker has measured since the last."""

    taken_s: float
    result: Any = None
    failure: Failure | None = None
    text: str = ""
    peak_mb: float = 0.0
    reference_loops_s: tuple[float, ...] = ()


def installed_software() -> dict[str, str]:
    """Return which software this machine flies with; runs of machines that differ in it cannot be compared."""
    # Files of bundled agents are not part of the software's hash: each entry has its own.
    digest = hashlib.blake2b(digest_size=_DIGITS // 2)
    for name, program in bundled_agents().items():
        for path in list_program_files(program):
            digest.update(f"{name}/{path.name}".encode())
            digest.update(path.read_bytes())
    return {"version": gslcosim.__version__, "software": software_hash(), "agents": digest.hexdigest()}


class RayWorker:
    """An actor that does one job after the other in a process of its own, which it can end and replace.

    The process is a worker of `LocalPool`, so that limits, crashes and logs are what they are on one machine.
    """

    def __init__(self, limits: LimitsSpec, fetch: Callable[[Any], Contents | None]) -> None:
        """Start the process.

        Args:
            fetch: Gets the files of a bundle from the cluster.
        """
        self._pool = LocalPool(1, limits)
        self._fetch = fetch
        self._rooms: dict[str, Path] = {}
        self._roots: dict[str, Path | None] = {}
        self._n_loops_told = 0

    def ready(self) -> int:
        """Answer with the number of this process, so that the caller knows it is there."""
        return os.getpid()

    def do(self, job: Job, bundle: FileBundle, parcel: Any) -> NodeJobResult:
        """Do a job with the files, the room and the tape of this node; what is missing is made or unpacked here.

        Args:
            parcel: What `fetch` makes their contents of.
        """
        try:
            root = self._root_of(bundle, parcel)
        except (GslCosimError, OSError) as error:
            return NodeJobResult(taken_s=0.0, failure="fault", text=str(error))
        trial = job.trial if root is None else relocate_trial(job.trial, bundle, root)
        if job.kind == "record":
            return self._record(replace(job, trial=trial), root)
        return self._do(replace(job, trial=trial), root)

    def end(self) -> None:
        """End the process and its agents."""
        self._pool.close()

    # None: they are on this machine where they are on the other.
    def _root_of(self, bundle: FileBundle, parcel: Any) -> Path | None:
        if bundle.key not in self._roots:
            self._roots[bundle.key] = None if bundle.is_here() else unpack_bundle(bundle, self._fetch(parcel))
        return self._roots[bundle.key]

    def _do(self, job: Job, root: Path | None) -> NodeJobResult:
        if job.kind == "room" or job.trial.room not in self._rooms:
            ended = self._ended(Job(key=job.trial.room, kind="room", trial=job.trial))
            if ended.failure is not None:
                return self._build_result(ended, root)
            self._rooms[job.trial.room] = ended.result
            if job.kind == "room":
                folder = ended.result
                room = NodeEnvironment(folder=folder, content_hash=load_environment(folder).content_hash)
                return self._build_result(replace(ended, result=room), root)
        return self._build_result(self._ended(replace(job, environment_dir=self._rooms[job.trial.room])), root)

    def _record(self, job: Job, root: Path | None) -> NodeJobResult:
        with ScratchFolder("bench") as scratch:
            done = self._do(replace(job, runs_dir=scratch.path), root)
            if done.failure is not None:
                return done
            run_dir = done.result.run_dir
            files = {path.relative_to(run_dir).as_posix(): path.read_bytes() for path in list_files(run_dir)}
            return replace(done, result=RecordedTrial(flight=done.result, files=files))

    def _ended(self, job: Job) -> JobResult:
        self._pool.submit(job)
        while True:
            for ended in self._pool.wait(_LOOK_EVERY_S):
                return ended

    # What agents say of themselves names files as they are called where the benchmark was started.
    def _build_result(self, ended: JobResult, root: Path | None) -> NodeJobResult:
        loops_s = tuple(self._pool.reference_loops_s[self._n_loops_told :])
        self._n_loops_told += len(loops_s)
        done = NodeJobResult(
            taken_s=ended.taken_s,
            result=ended.result,
            failure=ended.failure,
            text=ended.text,
            peak_mb=self._pool.peak_mb,
            reference_loops_s=loops_s,
        )
        if root is None:
            return done
        plain = partial(_without, f"{root}{os.sep}")
        if isinstance(done.result, TrialResult):
            row = {key: plain(value) if isinstance(value, str) else value for key, value in done.result.row.items()}
            done = replace(done, result=replace(done.result, row=row))
        return replace(done, text=plain(done.text))


def _without(root: str, text: str) -> str:
    return text.replace(root, os.sep)
