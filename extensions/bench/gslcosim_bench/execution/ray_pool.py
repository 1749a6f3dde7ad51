"""Ray worker pool: connection to a cluster, and workers on its nodes that make and keep their own environments."""

import importlib
import logging
import os
import secrets
import signal
import socket
import time
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from gslcosim.base.errors import GslCosimError, SimulationFault, UsageError
from gslcosim.base.files import ScratchFolder
from gslcosim.runtime.processes.stop_detection import StopDetector, describe_stop, is_stopped_itself
from gslcosim_bench.cases.models import LimitsSpec
from gslcosim_bench.execution.pool import Failure, Job, JobResult, n_cores
from gslcosim_bench.execution.ray_worker import (
    BundleBuilder,
    Contents,
    FileBundle,
    NodeEnvironment,
    NodeJobResult,
    RayWorker,
    RecordedTrial,
    installed_software,
)

AUTO, LOCAL = "auto", "local"
_LISTENS_S = 10.0
# As in `LocalPool`: the next run waits at the worker.
_AHEAD = 2
_LOOK_EVERY_S = 0.5
_START_S = 60.0
_END_S = 3.0
# Of a worker on another machine, whose state this one cannot see: as long as a run waits for a lost host.
_SILENCE_S = 15.0
_MOST_FAILED_STARTS = 3
# Rows travel through it, and the files of agents.
_LOCAL_STORE_BYTES = 200_000_000
# Calls of this group are answered while a worker does its job.
_BESIDE = "beside"


def load_ray(address: str) -> Any:
    """Return the module `ray`, set to be quiet, and to be heard on this machine alone where the cluster is."""
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    # What nodes say goes to standard output otherwise, in the middle of ours.
    os.environ.setdefault("RAY_DEDUP_LOGS_SKIP_REGEX", ".*")
    # Ray announces a change to come otherwise.
    os.environ.setdefault("RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO", "0")
    if address == LOCAL:
        # Ray's way not to be heard outside of this machine; it is read when Ray is imported.
        os.environ["RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER"] = "0"
        # Other users of the machine stay out; Ray would leave a token in the home folder instead.
        os.environ.setdefault("RAY_AUTH_MODE", "token")
        os.environ.setdefault("RAY_AUTH_TOKEN", secrets.token_hex(32))
    try:
        ray = importlib.import_module("ray")
    except ModuleNotFoundError:
        ray = None
    # A folder that happens to be called ray can be imported too.
    if not hasattr(ray, "init"):
        raise UsageError("--ray: expected Ray to be installed, was not. Install it: pip install 'gslcosim-bench[ray]'")
    return ray


def check_address(address: str) -> None:
    """Refuse an address where nobody listens; Ray itself asks there for minutes."""
    host, _, port = address.rpartition(":")
    try:
        socket.create_connection((host.strip("[]"), int(port)), timeout=_LISTENS_S).close()
    except ValueError as error:
        raise UsageError("it has no port.") from error
    except OSError as error:
        raise UsageError(f"nobody listens there ({error.strerror or error}).") from error


def software_query() -> Callable[[], dict[str, str]]:
    """Return what a node is asked for its software.

    Made here, so that it travels as code: a node without gslcosim can still say so.
    """

    def find_software() -> dict[str, str]:
        try:
            from gslcosim_bench.execution.ray_worker import installed_software as found

            return found()
        except ImportError as error:
            return {"missing": str(error)}

    return find_software


def software_text(found: dict[str, str]) -> str:
    """Return the software of a machine in words."""
    if "missing" in found:
        return f"none that can be used ({found['missing']})"
    return f"gslcosim {found['version']} with the hashes {found['software']} and, of its agents, {found['agents']}"


def shorten_error(error: BaseException) -> str:
    """Return the lines of an error that tell its cause; Ray's own are long."""
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    return " ".join(lines[-3:] if isinstance(error, GslCosimError) else lines[:3])[:600]


@dataclass(frozen=True)
class _Node:
    """A machine of the cluster."""

    id: str
    address: str
    n_cpus: int


@dataclass(eq=False)
class _Order:
    """A job as it was submitted: done once, or once on every node."""

    job: Job
    bundle: FileBundle
    n_left: int
    taken_s: float = 0.0
    results: dict[str, Any] = field(default_factory=dict[str, Any])
    is_over: bool = False


@dataclass(eq=False)
class _Task:
    """A part of an order: for one node, or for any that is free."""

    order: _Order
    node: _Node | None


@dataclass(eq=False)
class _Worker:
    """An actor with the tasks it was given, oldest first; one that does not fly prepares for this machine only."""

    name: str
    node: _Node
    actor: Any
    first_answer: Any
    flies: bool
    is_up: bool = False
    pid: int = 0
    sign_of_life: Any = None
    since: float = 0.0
    tasks: "deque[tuple[Any, _Task]]" = field(default_factory=deque)

    @property
    def next_answer(self) -> Any:
        """Next object to wait for; None when the worker is idle."""
        if not self.is_up:
            return self.first_answer
        return self.tasks[0][0] if self.tasks else None


class RayPool:
    """One worker for each CPU of a Ray cluster; see `Pool`.

    Files that trials read travel to the nodes, rooms and tapes are made on each, and recordings travel back, so that
    nodes need no disk in common. The software must be the same on all.
    """

    def __init__(self, address: str, limits: LimitsSpec) -> None:
        """Connect and start the workers.

        Args:
            address: `auto` for the cluster that this machine is part of, its `host:port`, or `local` to start one here
                that ends with the pool.
            limits: What a job may take; preparing has no limit of time.
        """
        self.peak_mb = 0.0
        self.cpu_s = 0.0
        self.reference_loops_s: list[float] = []
        self._address = address
        self._limits = limits
        self._queue: deque[_Task] = deque()
        self._ended: list[JobResult] = []
        self._workers: list[_Worker] = []
        self._bundle_builder = BundleBuilder()
        self._parcels: dict[str, Any] = {}
        self._n_workers = 0
        self._n_started = 0
        self._n_failed_starts = 0
        self._stopped, self._silent = StopDetector(), StopDetector(_SILENCE_S)
        self._scratch: ScratchFolder | None = None
        self._ray = load_ray(address)
        try:
            self._connect()
            self._here = self._ray.get_runtime_context().get_node_id()
            nodes = self._nodes()
            if address != LOCAL:
                self._check_software(nodes)
            self._start_all(nodes)
        except BaseException:
            self.close()
            raise

    @property
    def n_workers(self) -> int:
        """Number of jobs done at the same time, counting all nodes that have ever been there."""
        return self._n_workers

    def submit(self, job: Job) -> None:
        """Take a job; see `Pool`."""
        # Without what the trial has worked out of itself, which is large.
        bundle = self._bundle_builder.build_bundle(job.trial)
        order = _Order(job, bundle, n_left=1)
        if job.kind in ("room", "tape"):
            nodes = {w.node.id: w.node for w in self._workers if w.is_up and (w.flies or job.kind == "room")}
            order.n_left = len(nodes)
            self._queue += [_Task(order, node) for node in nodes.values()]
        else:
            self._queue.append(_Task(order, None))
        self._hand_out()

    def wait(self, timeout_s: float) -> list[JobResult]:
        """Return the jobs that have ended; see `Pool`."""
        deadline = time.monotonic() + timeout_s
        while not self._ended:
            left_s = deadline - time.monotonic()
            self._receive_all(max(0.0, min(left_s, _LOOK_EVERY_S)))
            self._look_after()
            self._hand_out()
            if left_s <= 0:
                break
        ended, self._ended = self._ended, []
        return ended

    def close(self) -> None:
        """End all workers; see `Pool`."""
        with suppress(Exception):
            up = [worker.actor for worker in self._workers if worker.is_up]
            answers = [actor.end.options(concurrency_group=_BESIDE).remote() for actor in up]
            if answers:
                self._ray.wait(answers, num_returns=len(answers), timeout=_END_S)
        for worker in self._workers:
            with suppress(Exception):
                self._ray.kill(worker.actor)
        self._workers = []
        self._ray.shutdown()
        if self._scratch is not None:
            self._scratch.close()

    def _connect(self) -> None:
        quiet: dict[str, Any] = {"log_to_driver": False, "logging_level": logging.ERROR}
        if self._address == LOCAL:
            # Not the usual place for temporary files: names of sockets must be short.
            self._scratch = ScratchFolder("ray", parent=Path("/tmp"))
            self._ray.init(
                num_cpus=n_cores(),
                include_dashboard=False,
                object_store_memory=_LOCAL_STORE_BYTES,
                _temp_dir=str(self._scratch.path),
                **quiet,
            )
            return
        try:
            if self._address != AUTO:
                check_address(self._address)
            self._ray.init(address=self._address, **quiet)
        except Exception as error:  # of many kinds, none of them Ray's own
            raise UsageError(
                f"--ray {self._address}: expected auto, local, or the host:port of a Ray cluster that this machine is "
                f"part of, was none: {shorten_error(error)} Start one with `ray start --head` here, and "
                "`ray start --address=HERE:6379` on the other machines; or take --ray local."
            ) from error

    def _nodes(self) -> list[_Node]:
        return [
            _Node(each["NodeID"], each["NodeManagerAddress"], int(each["Resources"].get("CPU", 0)))
            for each in self._ray.nodes()
            if each["Alive"]
        ]

    def _check_software(self, nodes: Sequence[_Node]) -> None:
        here, ask = installed_software(), self._ray.remote(software_query())
        asked = {
            ask.options(num_cpus=0, max_retries=0, scheduling_strategy=self._on(node)).remote(): node for node in nodes
        }
        for answer, node in asked.items():
            try:
                found = self._ray.get(answer, timeout=_START_S)
            except self._ray.exceptions.RayError as error:
                raise UsageError(
                    f"--ray {self._address}: node {node.address} does not answer: {shorten_error(error)}"
                ) from error
            if found != here:
                raise UsageError(
                    f"--ray {self._address}: expected on node {node.address} the same software as here, "
                    f"{software_text(here)}, found {software_text(found)}. Install there what is installed here, "
                    "with the same Python, numpy, numba and mujoco, into the Python that runs Ray."
                )

    def _start_all(self, nodes: Sequence[_Node]) -> None:
        for node in nodes:
            self._workers += [self._start(node) for _ in range(node.n_cpus)]
        # Somebody must make the rooms that this machine reads.
        self._workers += [
            self._start(node, flies=False) for node in nodes if node.id == self._here and node.n_cpus == 0
        ]
        deadline = time.monotonic() + _START_S
        while any(not worker.is_up for worker in self._workers) and time.monotonic() < deadline:
            self._receive_all(_LOOK_EVERY_S)
        if not self.n_workers:
            raise UsageError(
                f"--ray {self._address}: expected free CPUs in the cluster, none was within {_START_S:g} s. Wait for "
                "the other work on it, or start Ray with --num-cpus=N of at least 1."
            )

    def _start(self, node: _Node, *, flies: bool = True) -> _Worker:
        self._n_started += 1
        actor_type = self._ray.remote(
            num_cpus=1 if flies else 0,
            max_restarts=0,
            max_task_retries=0,
            concurrency_groups={_BESIDE: 2},
            scheduling_strategy=self._on(node),
        )(RayWorker)
        actor = actor_type.remote(self._limits, _fetched)
        name = f"{node.address}/worker_{self._n_started}"
        return _Worker(name=name, node=node, actor=actor, first_answer=actor.ready.remote(), flies=flies)

    def _on(self, node: _Node) -> Any:
        strategies = importlib.import_module("ray.util.scheduling_strategies")
        return strategies.NodeAffinitySchedulingStrategy(node.id, soft=False)

    def _hand_out(self) -> None:
        for ahead in range(1, _AHEAD + 1):
            for worker in self._workers:
                if worker.is_up and len(worker.tasks) < ahead:
                    self._give(worker, is_ahead=ahead > 1)

    # What prepares for others is never queued behind something else.
    def _give(self, worker: _Worker, *, is_ahead: bool) -> None:
        for i, task in enumerate(self._queue):
            if is_ahead and task.order.job.kind != "fly":
                return
            if task.node is worker.node or (task.node is None and worker.flies):
                del self._queue[i]
                job, bundle = task.order.job, task.order.bundle
                slim = replace(job, trial=replace(job.trial))
                if not worker.tasks:
                    worker.since = time.monotonic()
                worker.tasks.append((worker.actor.do.remote(slim, bundle, self._parcel(bundle)), task))
                return

    # Wrapped, so that a node fetches it only when it needs it.
    def _parcel(self, bundle: FileBundle) -> list[Any]:
        if bundle.key not in self._parcels:
            self._parcels[bundle.key] = [self._ray.put(bundle.contents())]
        return self._parcels[bundle.key]

    def _receive_all(self, timeout_s: float) -> None:
        by_answer = {worker.next_answer: worker for worker in self._workers if worker.next_answer is not None}
        if not by_answer:
            time.sleep(timeout_s)
            return
        ready, _ = self._ray.wait(list(by_answer), timeout=timeout_s)
        if ready:
            ready, _ = self._ray.wait(list(by_answer), num_returns=len(by_answer), timeout=0)
        for answer in ready:
            self._receive(by_answer[answer], answer)

    def _receive(self, worker: _Worker, answer: Any) -> None:
        try:
            received: Any = self._ray.get(answer)
        except GslCosimError as error:
            raise SimulationFault(
                f"--ray {self._address}: node {worker.node.address}: {shorten_error(error)}"
            ) from error
        except self._ray.exceptions.RayTaskError as error:
            if not worker.is_up:
                self._lose(worker, shorten_error(error))
                return
            received = NodeJobResult(taken_s=0.0, failure="fault", text=str(error))
        except self._ray.exceptions.RayError as error:
            self._lose(worker, shorten_error(error))
            return
        if not worker.is_up:
            worker.is_up, worker.pid, self._n_failed_starts = True, int(received), 0
            self._n_workers = max(self._n_workers, sum(each.flies and each.is_up for each in self._workers))
            return
        _, task = worker.tasks.popleft()
        worker.since = time.monotonic()
        self.peak_mb = max(self.peak_mb, received.peak_mb)
        self.reference_loops_s += received.reference_loops_s
        self._take(task, worker, received)

    # Ray waits for ever for a worker that is stopped, since its process is there.
    def _look_after(self) -> None:
        now, up = time.monotonic(), [worker for worker in self._workers if worker.is_up]
        here = [worker.name for worker in up if worker.node.id == self._here and is_stopped_itself(worker.pid)]
        stopped = self._stopped.look(here, now)
        silent = self._silent.look([worker.name for worker in up if not self._has_answered(worker)], now)
        for worker in up:
            if worker.name in stopped:
                with suppress(ProcessLookupError):
                    os.kill(worker.pid, signal.SIGKILL)
                self._lose(worker, describe_stop())
            elif worker.name in silent:
                self._lose(
                    worker, f"has not answered for {_SILENCE_S:g} s; it was stopped, or its node cannot be reached"
                )

    # Asks again as soon as it has.
    def _has_answered(self, worker: _Worker) -> bool:
        if worker.sign_of_life is not None and not self._ray.wait([worker.sign_of_life], timeout=0)[0]:
            return False
        worker.sign_of_life = worker.actor.ready.options(concurrency_group=_BESIDE).remote()
        return True

    # One task of an order has come to its end.
    def _take(self, task: _Task, worker: _Worker, done: NodeJobResult) -> None:
        order = task.order
        order.n_left -= 1
        order.taken_s = max(order.taken_s, done.taken_s)
        if done.failure is not None:
            self._end(order, worker.name, failure=done.failure, text=done.text)
            return
        order.results[worker.node.id] = done.result
        if order.n_left == 0:
            self._finish(order, worker.name)

    def _finish(self, order: _Order, worker: str) -> None:
        if order.job.kind == "room":
            self._finish_room(order, worker)
            return
        result = next(iter(order.results.values()))
        if isinstance(result, RecordedTrial):
            assert order.job.runs_dir is not None, "a recording is left somewhere"
            run_dir = order.job.runs_dir / result.flight.run_dir.name
            for name, content in result.files.items():
                path = run_dir / name
                path.parent.mkdir(parents=True, exist_ok=True)
                path.write_bytes(content)
            result = replace(result.flight, run_dir=run_dir)
        self._end(order, worker, result=result)

    def _finish_room(self, order: _Order, worker: str) -> None:
        rooms: dict[str, NodeEnvironment] = order.results
        if len({room.content_hash for room in rooms.values()}) > 1:
            addresses = {each.node.id: each.node.address for each in self._workers}
            hashes = ", ".join(f"{addresses.get(node, node)}: {room.content_hash}" for node, room in rooms.items())
            text = f"nodes make different rooms of one recipe ({hashes}). Install the same packages on all nodes."
            self._end(order, worker, failure="fault", text=text)
        elif self._here not in rooms:
            self._end(order, worker, failure="crashed", text="the workers of this machine are gone")
        else:
            self._end(order, worker, result=rooms[self._here].folder)

    def _end(
        self, order: _Order, worker: str, *, result: Any = None, failure: Failure | None = None, text: str = ""
    ) -> None:
        if not order.is_over:
            order.is_over = True
            self._ended.append(
                JobResult(
                    job=order.job, worker=worker, taken_s=order.taken_s, result=result, failure=failure, text=text
                )
            )

    # The job in the air is lost, those that waited behind it are not; of a node that is gone nothing is expected.
    def _lose(self, worker: _Worker, text: str) -> None:
        with suppress(Exception):
            self._ray.kill(worker.actor)
        tasks = [task for _, task in worker.tasks]
        is_there = any(node.id == worker.node.id for node in self._nodes())
        at = self._workers.index(worker)
        self._workers[at : at + 1] = [self._start(worker.node, flies=worker.flies)] if is_there else []
        if tasks and (is_there or tasks[0].node is None):
            lost = tasks.pop(0)
            taken_s = time.monotonic() - worker.since
            self._take(lost, worker, NodeJobResult(taken_s=taken_s, failure="crashed", text=f"{worker.name}: {text}"))
        self._queue.extendleft(reversed(tasks))
        if not is_there:
            self._forget(worker)
        elif not worker.is_up:
            self._n_failed_starts += 1
            if self._n_failed_starts >= _MOST_FAILED_STARTS:
                raise SimulationFault(f"--ray {self._address}: node {worker.node.address}: no worker starts: {text}")
        if not any(each.flies for each in self._workers):
            raise SimulationFault(
                f"--ray {self._address}: expected at least one node, the last is gone: {text} The same command goes on "
                "when the cluster is there again."
            )

    def _forget(self, worker: _Worker) -> None:
        if any(each.node is worker.node for each in self._workers):
            return
        gone = [task for task in self._queue if task.node is worker.node]
        self._queue = deque(task for task in self._queue if task.node is not worker.node)
        for task in gone:
            task.order.n_left -= 1
            if task.order.n_left == 0:
                self._finish(task.order, worker.name)


def _fetched(parcel: list[Any]) -> Contents | None:
    return importlib.import_module("ray").get(parcel[0])
