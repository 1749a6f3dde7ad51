"""The books of a Ray cluster's work, with a cluster that is only played: who gets what, and what an end means."""

import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from gslcosim.base.errors import SimulationFault, UsageError
from gslcosim_bench.cases import Trial, build_plan, load_suite
from gslcosim_bench.cases.models import LimitsSpec
from gslcosim_bench.execution import ray_pool
from gslcosim_bench.execution.pool import Job, JobResult
from gslcosim_bench.execution.ray_pool import RayPool
from gslcosim_bench.execution.ray_worker import NodeEnvironment, NodeJobResult

Act = Callable[[str, Job], NodeJobResult]


class PlayedError(Exception):
    """What Ray says of an actor that is gone."""


class Answer:
    """An answer of a node that is there at once, but made only when it is asked for."""

    def __init__(self, node: str, make: Callable[[], Any]) -> None:
        self.node, self.make = node, make


class PlayedRay:
    """As much of Ray as the pool uses: nodes by name with their CPUs, and `act` for what actors do."""

    exceptions = SimpleNamespace(RayTaskError=type("RayTaskError", (PlayedError,), {}), RayError=PlayedError)

    def __init__(self, n_cpus: dict[str, int], act: Act) -> None:
        self.n_cpus, self.act = n_cpus, act
        self.gone: set[str] = set()
        self.silent: set[str] = set()
        self.n_actors = 0
        self.is_shut_down = False

    def init(self, **options: Any) -> None:
        assert options["log_to_driver"] is False

    def get_runtime_context(self) -> Any:
        return SimpleNamespace(get_node_id=lambda: "here")

    def nodes(self) -> list[dict[str, Any]]:
        return [
            {"NodeID": name, "NodeManagerAddress": name, "Resources": {"CPU": float(n)}, "Alive": name not in self.gone}
            for name, n in self.n_cpus.items()
        ]

    def remote(self, **options: Any) -> Callable[[type], Any]:
        node = options["scheduling_strategy"]
        return lambda _: SimpleNamespace(remote=lambda *_: self._actor(node))

    def _actor(self, node: str) -> Any:
        self.n_actors += 1
        return SimpleNamespace(
            ready=SimpleNamespace(
                remote=lambda: Answer(node, lambda: self._checked(node, lambda: 0)),
                options=lambda **_: SimpleNamespace(remote=lambda: Answer(node, lambda: 0)),
            ),
            do=SimpleNamespace(
                remote=lambda job, *_: Answer(node, lambda: self._checked(node, lambda: self.act(node, job)))
            ),
            end=SimpleNamespace(options=lambda **_: SimpleNamespace(remote=lambda: Answer(node, lambda: None))),
        )

    def _checked(self, node: str, make: Callable[[], Any]) -> Any:
        if node in self.gone:
            raise PlayedError(f"{node} is gone")
        return make()

    def wait(self, answers: list[Any], **_: Any) -> tuple[list[Any], list[Any]]:
        answered = [answer for answer in answers if answer.node not in self.silent]
        return answered, [answer for answer in answers if answer not in answered]

    def get(self, answer: Answer) -> Any:
        return answer.make()

    def put(self, value: Any) -> Any:
        return value

    def kill(self, actor: Any) -> None: ...

    def shutdown(self) -> None:
        self.is_shut_down = True


@pytest.fixture(scope="module")
def trial() -> Trial:
    return build_plan(load_suite("smoke")).trials[0]


@pytest.fixture
def played(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., tuple[RayPool, PlayedRay]]]:
    monkeypatch.setattr(RayPool, "_on", lambda _, node: node.id)
    pools: list[RayPool] = []

    def make(act: Act, **n_cpus: int) -> tuple[RayPool, PlayedRay]:
        ray = PlayedRay(n_cpus, act)
        monkeypatch.setattr(ray_pool, "load_ray", lambda _: ray)
        pools.append(RayPool("local", LimitsSpec()))
        return pools[-1], ray

    yield make
    for pool in pools:
        pool.close()


def all_done(pool: RayPool, n: int) -> list[JobResult]:
    ended: list[JobResult] = []
    while len(ended) < n:
        ended += pool.wait(0.1)
    return ended


def flights(trial: Trial, n: int) -> list[Job]:
    return [Job(key=str(i), kind="fly", trial=trial, environment_dir=Path("/nowhere")) for i in range(n)]


def made(node: str, job: Job) -> NodeJobResult:
    room = NodeEnvironment(folder=Path("/rooms") / node, content_hash="the same")
    return NodeJobResult(
        taken_s=1.0, result=room if job.kind == "room" else node, peak_mb=100.0, reference_loops_s=(0.02,)
    )


def test_each_cpu_of_each_node_has_a_worker(played: Any, trial: Trial) -> None:
    pool, ray = played(made, here=2, there=3)
    assert pool.n_workers == 5
    for job in flights(trial, 20):
        pool.submit(job)
    ended = all_done(pool, 20)
    assert {each.result for each in ended} == {"here", "there"}
    assert all(each.worker.startswith(f"{each.result}/worker_") for each in ended)
    assert pool.peak_mb == 100.0
    assert pool.reference_loops_s == [0.02] * 20
    pool.close()
    assert ray.is_shut_down


def test_a_room_is_made_on_every_node_and_read_from_this_one(played: Any, trial: Trial) -> None:
    """Even where this machine has no CPU to fly with; its tapes are then of no use."""
    asked: list[tuple[str, str]] = []

    def act(node: str, job: Job) -> NodeJobResult:
        asked.append((node, job.kind))
        return made(node, job)

    pool, _ = played(act, here=0, there=1, yonder=2)
    assert pool.n_workers == 3
    for kind in ("room", "tape"):
        pool.submit(Job(key=kind, kind=kind, trial=trial, environment_dir=Path("/nowhere")))
    room, tape = sorted(all_done(pool, 2), key=lambda ended: ended.job.key)
    assert room.result == Path("/rooms/here")
    assert tape.failure is None
    assert sorted(asked) == [
        ("here", "room"), ("there", "room"), ("there", "tape"), ("yonder", "room"), ("yonder", "tape"),
    ]  # fmt: skip


def test_nodes_that_make_different_rooms_are_reported(played: Any, trial: Trial) -> None:
    def act(node: str, job: Job) -> NodeJobResult:
        return NodeJobResult(taken_s=1.0, result=NodeEnvironment(folder=Path("/rooms"), content_hash=f"of {node}"))

    pool, _ = played(act, here=1, there=1)
    pool.submit(Job(key="room", kind="room", trial=trial))
    (ended,) = all_done(pool, 1)
    assert ended.failure == "fault"
    assert "here: of here, there: of there" in ended.text


def test_a_worker_that_does_not_answer_is_lost(played, trial, monkeypatch):
    monkeypatch.setattr(ray_pool, "_SILENCE_S", 0.0)

    def act(node: str, job: Job) -> NodeJobResult:
        return NodeJobResult(taken_s=0.1, result=node)

    pool, ray = played(act, here=1, there=1)
    pool.wait(0.0)
    ray.silent.add("there")
    for job in flights(trial, 2):
        pool.submit(job)
    by_failure = {ended.failure: ended for ended in all_done(pool, 2)}
    assert by_failure[None].result == "here"
    assert by_failure["crashed"].text.startswith("there/worker_2: has not answered for 0 s")


def test_a_dead_node_costs_the_runs_in_the_air_and_no_others(played: Any, trial: Trial) -> None:
    pool, ray = played(made, here=1, there=1)
    for job in flights(trial, 10):
        pool.submit(job)
    ray.gone.add("there")
    ended = all_done(pool, 10)
    crashed = [each for each in ended if each.failure == "crashed"]
    assert len(crashed) == 1
    assert crashed[0].text.endswith("there is gone")
    assert {each.result for each in ended if each.failure is None} == {"here"}


def test_a_dead_actor_is_replaced(played: Any, trial: Trial) -> None:
    dies = iter([True])

    def act(node: str, job: Job) -> NodeJobResult:
        if next(dies, False):
            raise PlayedError("the actor died")
        return made(node, job)

    pool, ray = played(act, here=1)
    for job in flights(trial, 4):
        pool.submit(job)
    ended = all_done(pool, 4)
    assert [each.failure for each in ended].count("crashed") == 1
    assert (ray.n_actors, pool.n_workers) == (2, 1)


def test_a_room_is_there_although_another_node_has_gone(played: Any, trial: Trial) -> None:
    pool, ray = played(made, here=1, there=1)
    pool.submit(Job(key="room", kind="room", trial=trial))
    ray.gone.add("there")
    (ended,) = all_done(pool, 1)
    assert ended.result == Path("/rooms/here")


def test_a_cluster_without_nodes_is_reported(played: Any, trial: Trial) -> None:
    pool, ray = played(made, here=1)
    for job in flights(trial, 3):
        pool.submit(job)
    ray.gone.add("here")
    with pytest.raises(SimulationFault, match="the last is gone: here is gone"):
        all_done(pool, 3)


def test_an_actor_that_fails_for_good_ends_the_run_with_its_node(played: Any, trial: Trial) -> None:
    def act(node: str, job: Job) -> NodeJobResult:
        raise SimulationFault("benchmark: expected workers that start, was one that does not")

    pool, _ = played(act, here=1)
    pool.submit(*flights(trial, 1))
    with pytest.raises(SimulationFault, match="node here: benchmark: expected workers that start"):
        all_done(pool, 1)


def test_without_ray_the_remedy_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "ray", None)
    with pytest.raises(UsageError, match="pip install 'gslcosim-bench\\[ray\\]'"):
        RayPool("auto", LimitsSpec())
