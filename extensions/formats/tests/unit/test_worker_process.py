"""Worker processes: tasks in any number of them, and what comes of one that dies."""

import os
import signal
from pathlib import Path

import pytest

from gslcosim_formats import worker_process
from gslcosim_formats.worker_process import WorkerProcess, list_descendants, run_tasks

N_TASKS = 7


@pytest.fixture(autouse=True)
def importable(monkeypatch):
    """Workers can import this module, whose functions are their tasks."""
    monkeypatch.syspath_prepend(str(Path(__file__).parents[4]))


def square(number):
    return number * number, os.getpid()


def die_at_three(number):
    if number == 3:
        print("no room for number 3", flush=True)  # noqa: T201
        os.kill(os.getpid(), signal.SIGKILL)
    return number


def raise_at_one(number):
    if number == 1:
        raise RuntimeError("one is none")
    return number


def test_every_task_has_a_result_of_a_worker():
    results = {result.index: result for result in run_tasks(square, range(N_TASKS), 2)}
    assert [results[i].value[0] for i in range(N_TASKS)] == [i * i for i in range(N_TASKS)]
    workers = {result.value[1] for result in results.values()}
    assert len(workers) == 2
    assert os.getpid() not in workers


def test_a_worker_that_dies_costs_its_task_and_is_replaced():
    """With one worker the tasks after it need the next one."""
    results = {result.index: result for result in run_tasks(die_at_three, range(N_TASKS), 1)}
    assert {i for i, result in results.items() if result.failure} == {3}
    assert results[3].failure == "its process was killed by SIGKILL. no room for number 3"
    assert [results[i].value for i in range(N_TASKS) if i != 3] == [0, 1, 2, 4, 5, 6]


def test_an_error_is_told_with_its_trace():
    results = {result.index: result for result in run_tasks(raise_at_one, range(3), 2)}
    assert "RuntimeError: one is none" in results[1].failure
    assert results[2].value == 2


def find_package(_):
    import gslcosim

    return gslcosim.__file__


def test_a_folder_named_like_the_package_does_not_take_its_place(tmp_path, monkeypatch):
    """Whoever has cloned the repository works beside such a folder."""
    (tmp_path / "gslcosim").mkdir()
    monkeypatch.chdir(tmp_path)
    [result] = run_tasks(find_package, range(1), 1)
    assert result.value == find_package(0)


# Workers import this module too, and know nothing of what tests share.
@pytest.fixture
def has_ended():
    from deadlines import has_ended

    return has_ended


def test_workers_end_with_whoever_leaves_the_results(has_ended):
    results = run_tasks(square, range(N_TASKS), 1)
    worker = next(results).value[1]
    results.close()
    assert has_ended(worker)


def test_a_worker_takes_what_it_has_started_along(has_ended):
    worker = WorkerProcess("worker_1", f"{worker_process.__name__}:_do_tasks")
    worker.connection.send((_start_sleeper, None))
    child = worker.connection.recv()
    assert child in list_descendants(worker.pid)
    worker.close()
    assert not worker.is_running
    assert has_ended(child)


def _start_sleeper(_):
    import subprocess

    return subprocess.Popen(["sleep", "600"]).pid
