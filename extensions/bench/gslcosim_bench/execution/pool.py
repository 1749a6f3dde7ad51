"""Local worker pool: jobs, and processes that are started, watched and replaced, so that no trial takes others down."""

import os
import time
from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import Any, Literal, Protocol, cast

from gslcosim.base.errors import SimulationFault
from gslcosim.runtime.processes.stop_detection import StopDetector, describe_stop, is_stopped_itself
from gslcosim_bench.cases.models import LimitsSpec, Trial
from gslcosim_bench.execution.trial import (
    EnvironmentCache,
    Progress,
    build_map,
    prepare_room,
    record_tape,
    record_trial,
    run_trial,
)
from gslcosim_formats.worker_process import WorkerProcess

# How long to wait before a person gets the status again.
POLL_PERIOD_S = 0.5

Failure = Literal["crashed", "hung", "out_of_memory", "fault"]
# The next job waits at the worker while it does the one before, so that it is never idle in between.
_AHEAD = 2
_LOOK_EVERY_S = 0.25
_PAGE_BYTES = os.sysconf("SC_PAGE_SIZE")
_TICKS_PER_S = os.sysconf("SC_CLK_TCK")
_MOST_FAILED_STARTS = 3
_WORKER = "gslcosim_bench.execution.worker:do_jobs"


@dataclass(frozen=True, kw_only=True)
class Job:
    """One piece of work on a trial; `key` names it in the pool."""

    key: str
    kind: Literal["room", "tape", "map", "fly", "record"]
    trial: Trial
    environment_dir: Path | None = None
    varied: str = "{}"
    runs_dir: Path | None = None

    def do(self, rooms: EnvironmentCache, progress: Progress) -> Any:
        """Do it in this process and return its result."""
        if self.kind == "room":
            return prepare_room(self.trial, progress)
        assert self.environment_dir is not None, "rooms come first"
        if self.kind == "tape":
            return record_tape(self.trial, self.environment_dir)
        if self.kind == "map":
            return build_map(self.trial, self.environment_dir, varied=self.varied)
        if self.kind == "record":
            assert self.runs_dir is not None, "a recording is left somewhere"
            return record_trial(self.trial, self.runs_dir)
        return run_trial(self.trial, self.environment_dir, rooms)


@dataclass(frozen=True, kw_only=True)
class JobResult:
    """A job that has ended: with a result, or a failure and what is known of it."""

    job: Job
    worker: str
    taken_s: float
    result: Any = None
    failure: Failure | None = None
    text: str = ""


class Pool(Protocol):
    """Workers that do jobs, wherever they are."""

    @property
    def n_workers(self) -> int:
        """Number of jobs done at the same time."""
        ...

    @property
    def peak_mb(self) -> float:
        """The most memory that a worker had for itself, with its agents [MB]; 0 where nobody knows."""
        ...

    @property
    def cpu_s(self) -> float:
        """Processor time of all workers so far, with what they started [s]; 0 where nobody knows."""
        ...

    @property
    def reference_loops_s(self) -> list[float]:
        """Times of the reference loop between runs [s]."""
        ...

    def submit(self, job: Job) -> None:
        """Take a job; it is done when a worker is free, in the order of submission."""
        ...

    def wait(self, timeout_s: float) -> list[JobResult]:
        """Return the jobs that have ended since, after at most so long."""
        ...

    def close(self) -> None:
        """End all workers at once; jobs in the air are lost."""
        ...


def iterate_results(pool: Pool, jobs: Sequence[Job]) -> Iterator[JobResult]:
    """Hand jobs to a pool, and yield each when it has ended."""
    for job in jobs:
        pool.submit(job)
    left = len(jobs)
    while left:
        for ended in pool.wait(POLL_PERIOD_S):
            left -= 1
            yield ended


def n_cores() -> int:
    """Return the number of cores that this process may use, which is the default number of workers."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@dataclass(eq=False)
class _Worker:
    """A process with the jobs it was given, oldest first."""

    process: WorkerProcess
    jobs: "deque[Job]" = field(default_factory=deque)
    started_at: float | None = None
    peak_mb: float = 0.0
    cpu_s: float = 0.0
    is_up: bool = False

    @property
    def name(self) -> str:
        return self.process.name


class LocalPool:
    """As many worker processes as asked for; see `Pool`."""

    def __init__(self, n_workers: int, limits: LimitsSpec) -> None:
        """Start the workers.

        Args:
            limits: What a job may take; preparing has no limit of time.
        """
        self.n_workers = n_workers
        self.peak_mb = 0.0
        self._limits = limits
        self._queue: deque[Job] = deque()
        self._ended: list[JobResult] = []
        self.reference_loops_s: list[float] = []
        self._ended_cpu_s = 0.0
        self._n_started = 0
        self._n_failed_starts = 0
        self._workers = [self._start() for _ in range(n_workers)]
        self._looked_at = 0.0
        self._stops = StopDetector()

    @property
    def cpu_s(self) -> float:
        """Processor time as last looked at; see `Pool`."""
        return self._ended_cpu_s + sum(worker.cpu_s for worker in self._workers)

    def submit(self, job: Job) -> None:
        """Take a job; see `Pool`."""
        self._queue.append(job)
        self._hand_out()

    def wait(self, timeout_s: float) -> list[JobResult]:
        """Return the jobs that have ended; see `Pool`."""
        deadline = time.monotonic() + timeout_s
        while not self._ended:
            left_s = deadline - time.monotonic()
            by_connection = {worker.process.connection: worker for worker in self._workers}
            for connection in wait(list(by_connection), timeout=max(0.0, min(left_s, _LOOK_EVERY_S))):
                self._receive(by_connection[cast("Connection[Any, Any]", connection)])
            if time.monotonic() - self._looked_at >= _LOOK_EVERY_S:
                self._looked_at = time.monotonic()
                self._look_after()
            if left_s <= 0:
                break
        ended, self._ended = self._ended, []
        return ended

    def close(self) -> None:
        """End all workers; see `Pool`."""
        for worker in self._workers:
            worker.process.close()
        self._workers = []

    def _start(self) -> _Worker:
        self._n_started += 1
        return _Worker(WorkerProcess(f"worker_{self._n_started}", _WORKER))

    def _hand_out(self) -> None:
        for ahead in range(1, _AHEAD + 1):
            for worker in self._workers:
                # What prepares for others is never queued behind something else.
                if self._queue and len(worker.jobs) < ahead and (ahead == 1 or self._queue[0].kind == "fly"):
                    job = self._queue.popleft()
                    worker.jobs.append(job)
                    try:
                        worker.process.connection.send(job)
                    except OSError:
                        continue  # it is gone; its end is seen when it is looked after

    def _receive(self, worker: _Worker) -> None:
        try:
            kind, key, content = worker.process.connection.recv()
        except (EOFError, OSError):
            self._lose(worker, "crashed", f"the worker {worker.process.describe_end()}")
            return
        if kind == "started":
            worker.started_at = time.monotonic()
            worker.is_up = True
            worker.process.forget_output()
            self._n_failed_starts = 0
        elif kind == "reference":
            self.reference_loops_s.append(content)
        elif kind in ("done", "failed"):
            assert worker.jobs[0].key == key, "a worker answers in order"
            job = worker.jobs.popleft()
            worker.started_at = None
            result, taken_s = content
            if kind == "done":
                self._ended.append(JobResult(job=job, worker=worker.name, taken_s=taken_s, result=result))
            else:
                failure, text = result
                self._ended.append(JobResult(job=job, worker=worker.name, taken_s=taken_s, failure=failure, text=text))
            self._hand_out()

    def _look_after(self) -> None:
        now = time.monotonic()
        # What a worker has started, its own run watches.
        stopped = self._stops.look([w.name for w in self._workers if is_stopped_itself(w.process.pid)], now)
        for worker in list(self._workers):
            if worker.name in stopped:
                self._lose(worker, "crashed", f"{worker.name} {describe_stop()}")
                continue
            pids = worker.process.pids
            worker.peak_mb = sum(map(_resident_mb, pids))
            # What has ended meanwhile counts until its parent has waited for it.
            worker.cpu_s = max(worker.cpu_s, sum(map(_cpu_s, pids)))
            self.peak_mb = max(self.peak_mb, worker.peak_mb)
            if not worker.process.is_running and not worker.process.connection.poll():
                self._lose(worker, "crashed", f"the worker {worker.process.describe_end()}")
            elif worker.peak_mb > self._limits.memory_mb:
                text = f"it took {worker.peak_mb:.0f} MB with its agents, allowed are {self._limits.memory_mb:g} MB"
                self._lose(worker, "out_of_memory", text)
            elif (
                worker.started_at is not None
                and worker.jobs[0].kind == "fly"
                and now - worker.started_at > self._limits.wall_s
            ):
                self._lose(worker, "hung", f"it was not over after {self._limits.wall_s:g} s by the clock")

    # The job in the air is lost, those that waited behind it are not.
    def _lose(self, worker: _Worker, failure: Failure, text: str) -> None:
        if worker not in self._workers:
            return
        taken_s = time.monotonic() - worker.started_at if worker.started_at is not None else 0.0
        worker.process.close()
        words = worker.process.log_tail()
        reason = f"{text}. The end of its log: {words}" if words else f"{text}."
        if not worker.is_up:
            self._n_failed_starts += 1
            if self._n_failed_starts >= _MOST_FAILED_STARTS:
                raise SimulationFault(f"benchmark: expected workers that start, was one that does not: {reason}")
        elif worker.started_at is not None:
            job = worker.jobs.popleft()
            self._ended.append(JobResult(job=job, worker=worker.name, taken_s=taken_s, failure=failure, text=reason))
        self._queue.extendleft(reversed(worker.jobs))
        self._ended_cpu_s += worker.cpu_s
        self._workers[self._workers.index(worker)] = self._start()
        self._hand_out()


# Of a process and of the children that it has waited for.
def _cpu_s(pid: int) -> float:
    try:
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return 0.0
    return sum(map(int, fields[11:15])) / _TICKS_PER_S


# What a process has for itself: rooms and tapes are mapped files that all workers share.
def _resident_mb(pid: int) -> float:
    try:
        fields = Path(f"/proc/{pid}/statm").read_text().split()
    except OSError:
        return 0.0
    return (int(fields[1]) - int(fields[2])) * _PAGE_BYTES / 1e6
