"""The work that a pool hands to its workers, and what comes back."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, Protocol

from gslcosim.benchmark.execution.flying import Rooms, fly_trial, record_trial
from gslcosim.benchmark.execution.preparing import Progress, map_of, prepare_room, record_tape
from gslcosim.benchmark.suite.trials import Trial

# How long to wait before a person is told again how things stand.
LOOK_EVERY_S = 0.5

Failure = Literal["crashed", "hung", "out_of_memory", "fault"]


@dataclass(frozen=True, kw_only=True)
class Job:
    """One piece of work on a trial; `key` names it in the pool."""

    key: str
    kind: Literal["room", "tape", "map", "fly", "record"]
    trial: Trial
    environment_dir: Path | None = None
    varied: str = "{}"
    runs_dir: Path | None = None

    def do(self, rooms: Rooms, progress: Progress) -> Any:
        """Do it in this process and return its result."""
        if self.kind == "room":
            return prepare_room(self.trial, progress)
        assert self.environment_dir is not None, "rooms come first"
        if self.kind == "tape":
            return record_tape(self.trial, self.environment_dir)
        if self.kind == "map":
            return map_of(self.trial, self.environment_dir, varied=self.varied)
        if self.kind == "record":
            assert self.runs_dir is not None, "a recording is left somewhere"
            return record_trial(self.trial, self.runs_dir)
        return fly_trial(self.trial, self.environment_dir, rooms)


@dataclass(frozen=True, kw_only=True)
class Ended:
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
        """How many jobs are done at the same time."""
        ...

    @property
    def peak_mb(self) -> float:
        """The most memory that a worker had for itself, with its agents [MB]; 0 where nobody knows."""
        ...

    @property
    def reference_loops_s(self) -> list[float]:
        """Times of the reference loop between flights [s]."""
        ...

    def submit(self, job: Job) -> None:
        """Take a job; it is done when a worker is free, in the order of submission."""
        ...

    def wait(self, timeout_s: float) -> list[Ended]:
        """Return the jobs that have ended since, after at most so long."""
        ...

    def close(self) -> None:
        """End all workers at once; jobs in the air are lost."""
        ...


def each_ended(pool: Pool, jobs: Sequence[Job]) -> Iterator[Ended]:
    """Hand jobs to a pool, and yield each when it has ended."""
    for job in jobs:
        pool.submit(job)
    left = len(jobs)
    while left:
        for ended in pool.wait(LOOK_EVERY_S):
            left -= 1
            yield ended
