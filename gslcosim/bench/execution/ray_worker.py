"""Ray worker actor: the code that runs on the nodes of a cluster."""

import hashlib
import os
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import gslcosim
from gslcosim.base.errors import GslCosimError
from gslcosim.base.scratch import ScratchFolder
from gslcosim.bench.cases.hashes import list_program_files, software_hash
from gslcosim.bench.cases.models import LimitsSpec
from gslcosim.bench.execution.file_bundle import Contents, FileBundle, relocate_trial, unpack_bundle
from gslcosim.bench.execution.pool import Failure, Job, JobResult, LocalPool
from gslcosim.bench.execution.trial import TrialResult
from gslcosim.environment.store import load_environment
from gslcosim.runtime.status import RunResult
from gslcosim.scenario.bundled import bundled_agents

_LOOK_EVERY_S = 0.5
_DIGITS = 24


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
    return {"version": gslcosim.__version__, "software": software_hash(), "agents": _agents_hash()}


class RayWorker:
    """An actor that does one job after the other in a process of its own, which it can end and replace.

    The process is a worker of `LocalPool`, so that limits, crashes and logs are what they are on one machine.
    """

    def __init__(self, limits: LimitsSpec, fetch: Callable[[Any], Contents | None]) -> None:
        """Start the process.

        Args:
            limits: What a job may take.
            fetch: Gets the files of a bundle from the cluster.
        """
        self._pool = LocalPool(1, limits)
        self._fetch = fetch
        self._rooms: dict[str, Path] = {}
        self._roots: dict[str, Path | None] = {}
        self._n_loops_told = 0

    def ready(self) -> bool:
        """Answer, so that the caller knows it is there."""
        return True

    def do(self, job: Job, bundle: FileBundle, parcel: Any) -> NodeJobResult:
        """Do a job with the files, the room and the tape of this node; what is missing is made or unpacked here.

        Args:
            job: What to do.
            bundle: The files that it reads.
            parcel: What `fetch` makes their contents of.

        Raises:
            SimulationFault: workers do not start on this node.
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
            paths = [path for path in run_dir.rglob("*") if path.is_file()]
            files = {path.relative_to(run_dir).as_posix(): path.read_bytes() for path in paths}
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


# Files of bundled agents are not part of the software's hash: each entry has its own.
def _agents_hash() -> str:
    digest = hashlib.blake2b(digest_size=_DIGITS // 2)
    for name, program in bundled_agents().items():
        for path in list_program_files(program):
            digest.update(f"{name}/{path.name}".encode())
            digest.update(path.read_bytes())
    return digest.hexdigest()
