"""Services that die are started again where the scenario asks for it, and the run is the same."""

import json
import os
import random
import signal
import sys

import pytest
from real_runs import ROOT, SHARED, TINY_ROOM, fly_here, start

SWARM, EVENTS = (ROOT / "scenarios" / f"{name}.yaml" for name in ("swarm_tiny", "event_source"))
# Nobody comes that near: the run lasts long enough to be disturbed.
LONG = ("--set", "referee.success.within_m=0.02", "--set", "referee.stop.time_limit_s=60")
RESTART = (*LONG, "--set", "snapshots.every_s=5", "--set", "restart={tries: 2}")


@pytest.fixture(scope="module")
def digests(tmp_path_factory):
    """Of the runs that nobody disturbs."""
    folder = tmp_path_factory.mktemp("whole")
    return {path: fly_here(path, folder / path.stem, *LONG).result["digest"] for path in (TINY_ROOM, SWARM, EVENTS)}


def killed(scenario, runs_dir, service, *options, tick=0):
    """Fly, kill a service once a snapshot of that tick is there, and return how it ended."""
    flight = start(scenario, runs_dir, *RESTART, *options)
    pid = flight.child(f"gslcosim_services {service}")
    if tick:
        flight.wait_for(lambda: any(runs_dir.glob(f"*/snapshots/{tick:09d}/{service}.snap")))
    else:
        flight.wait_until_flying()
    os.kill(pid, signal.SIGKILL)
    return flight.end()


@pytest.mark.parametrize(
    ("scenario", "service"),
    [
        *((TINY_ROOM, name) for name in ("world", "fields")),
        (SWARM, "radio"),
        (EVENTS, "events"),
        *(pytest.param(TINY_ROOM, name, marks=pytest.mark.soak) for name in ("sensing", "referee")),
        *(pytest.param(SWARM, name, marks=pytest.mark.soak) for name in ("world", "sensing")),
        *(pytest.param(EVENTS, name, marks=pytest.mark.soak) for name in ("fields", "referee")),
    ],
    ids=lambda value: getattr(value, "stem", value),
)
def test_a_service_that_is_killed_is_started_again(digests, tmp_path, scenario, service):
    """Before its first snapshot or behind one, as the name draws it."""
    tick = random.Random(f"{scenario.stem} {service}").choice([0, 50, 100, 150])
    ended = killed(scenario, tmp_path, service, tick=tick)
    assert ended.result["digest"] == digests[scenario], ended.errors
    (restart,) = ended.result["restarts"]
    assert (restart["process"], restart["how"]) == (service, "was killed by SIGKILL")
    assert ended.result["valid"]
    assert ended.result["faults"] == []


def test_the_whole_run_is_recorded_once_and_the_restart_reported(digests, tmp_path):
    """The recorder lives on: it sees each message once, anyone who has sent it twice."""
    ended = killed(TINY_ROOM, tmp_path, "fields", "--set", "recording.enabled=true", tick=50)
    assert ended.result["digest"] == digests[TINY_ROOM], ended.errors
    assert len(ended.result["restarts"]) == 1
    assert "was killed by SIGKILL; it is started again" in (ended.run_dir / "logs" / "fields.log").read_text()
    assert (ended.run_dir / "recording.rrd").stat().st_size > 10_000


def test_services_that_share_a_process_go_on_together(digests, tmp_path):
    ended = killed(TINY_ROOM, tmp_path, "world fields", "--set", "processes=[[world, fields]]")
    assert ended.result["digest"] == digests[TINY_ROOM], ended.errors
    assert ended.result["restarts"][0]["process"] == "world+fields"


def test_the_recorder_is_not_started_again(tmp_path):
    ended = killed(TINY_ROOM, tmp_path, "recorder", "--set", "recording.enabled=true")
    assert ended.exit_code == 3
    assert "recorder: was killed by SIGKILL; the run is not valid without it. It is not started again" in ended.errors


def test_one_that_dies_at_the_same_tick_again_and_again_is_a_fault(tmp_path):
    """Nothing is gained by a third try."""
    flight = start(TINY_ROOM, tmp_path, *RESTART)
    flight.wait_until_flying()
    pids = set()

    def has_died_again() -> bool:
        pid = flight.child("gslcosim_services sensing")
        if pid not in pids:
            pids.add(pid)
            os.kill(pid, signal.SIGKILL)
        return len(pids) > 2 or flight.process.poll() is not None

    flight.wait_for(has_died_again)
    ended = flight.end()
    if len(ended.result.get("restarts", [])) == len(pids):
        assert ended.result["valid"]
    else:
        assert ended.exit_code == 3
        assert "It was started again 2 times, and has come no further." in ended.errors


def with_program(*words, **more):
    """Return what adds a participant whose program fails: its core raises an error in the midst of a step."""
    start = {"command": [sys.executable, str(SHARED / "foreign_program.py"), *words], "format": "json"}
    block = {"name": "model", "start": start, "reads": [{"port": "truth/samples"}], "writes": ["state"], **more}
    return ("--set", f"participants=[{json.dumps(block)}]")


def test_a_core_that_raises_an_error_once_is_started_again(tmp_path):
    """Not only a process that is killed: an error in a step ends the process too, and the next one has none."""
    marks = tmp_path / "marks"
    marks.mkdir()
    once = with_program("exits_once", f"120:{marks / 'has_failed'}", may_write=[str(marks)])
    ended = start(TINY_ROOM, tmp_path / "once", *RESTART, *once).end()
    assert ended.result["valid"], ended.errors
    assert ended.result["faults"] == []
    (restart,) = ended.result["restarts"]
    assert restart["process"] == "model"
    assert "its process ended with exit code 7" in restart["how"]
    whole = fly_here(TINY_ROOM, tmp_path / "whole", *LONG, *once)
    assert whole.result["valid"], whole.errors
    assert ended.result["digest"] == whole.result["digest"]


def test_a_core_that_raises_the_same_error_each_time_is_the_fault_of_the_run(tmp_path):
    ended = start(TINY_ROOM, tmp_path, *RESTART, *with_program("exits", "120")).end()
    assert ended.exit_code == 3
    assert [restart["process"] for restart in ended.result["restarts"]] == ["model", "model"]
    (fault,) = ended.result["faults"]
    assert fault["participant"] == "model"
    assert "expected an answer to the inputs of tick 120, but its process ended with exit code 7" in fault["text"]
    assert "It was started again 2 times, and has come no further." in fault["text"]


def test_restart_without_snapshots_is_refused(tmp_path):
    ended = fly_here(TINY_ROOM, tmp_path, "--set", "restart={}")
    assert ended.exit_code == 2
    assert "restart: expected snapshots with it, at which a service goes on, was none." in ended.errors
