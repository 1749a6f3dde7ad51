"""One scenario and seed have one digest: in many processes, on one loaded core, in one process."""

import contextlib
import random
import subprocess
import sys
from functools import cache

import pytest
from real_runs import AGENTS, AROUND_A_WALL, EVERY_VEHICLE, ON_BOARD, TINY_ROOM, fly, fly_command, fly_here, start


def digest_of(ended):
    assert ended.result["valid"], ended.errors
    return ended.result["digest"]


@contextlib.contextmanager
def busy_core():
    """Keep core 0 busy, as a second program would."""
    process = subprocess.Popen(["taskset", "-c", "0", sys.executable, "-c", "while True: pass"])
    try:
        yield
    finally:
        process.kill()
        process.wait()


@pytest.fixture(scope="module")
def fly_alone(tmp_path_factory):
    """Fly the tiny room in one process, with changes, once for all tests."""

    @cache
    def fly_once(*changes):
        return fly_here(TINY_ROOM, tmp_path_factory.mktemp("single"), *changes)

    return fly_once


@pytest.mark.tour
def test_the_digest_does_not_depend_on_how_a_run_is_executed(tmp_path, fly_alone):
    """Processes with a recorder, without one on a loaded core, and one process agree; another seed does not."""
    multi = fly(TINY_ROOM, tmp_path / "multi", is_recorded=True)
    with busy_core():
        pinned = fly_command(TINY_ROOM, tmp_path / "pinned", prefix=("taskset", "-c", "0"))
    single = fly_alone()
    other = fly_alone("--seed", "8")
    assert digest_of(multi) == digest_of(pinned) == digest_of(single)
    assert digest_of(other) != digest_of(multi)
    assert (multi.result["agents"], multi.result["ticks"]) == (single.result["agents"], single.result["ticks"])


def test_services_that_share_a_process_give_the_same_digest_beside_another_run(tmp_path, fly_alone):
    """All services in one process, and some of them in two, agree with one process; runs at one time never meet."""
    lists = "processes=[[referee, world], [recorder, sensing]]"
    flights = [
        start(TINY_ROOM, tmp_path / "grouped", "--processes", "grouped", is_recorded=True),
        start(TINY_ROOM, tmp_path / "listed", "--set", lists, is_recorded=True),
    ]
    grouped, listed = (flight.end() for flight in flights)
    assert digest_of(grouped) == digest_of(listed) == digest_of(fly_alone())
    logs = {log.stem for log in (listed.run_dir / "logs").iterdir()}
    assert {"world+referee", "fields", "sensing+recorder"} <= logs


@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.soak) for seed in range(1, 12))])
def test_random_groups_of_services_give_the_same_digest(tmp_path, fly_alone, seed):
    """In lockstep, where each tick waits for the agent, any grouping is the same run."""
    rng = random.Random(seed)
    names = ["world", "fields", "sensing", "referee"]
    rng.shuffle(names)
    cut = rng.randrange(1, len(names))
    change = ("--set", "agents[0].mode=lockstep", "--set", "referee.stop.time_limit_s=6")
    lists = f"processes=[[{', '.join(names[:cut])}], [{', '.join(names[cut:])}]]"
    grouped = fly(TINY_ROOM, tmp_path / "grouped", *change, "--set", lists)
    assert digest_of(grouped) == digest_of(fly_alone(*change))


@pytest.mark.parametrize("mode", ["lockstep", "{latency: 3}"])
def test_parity_holds_in_every_mode(tmp_path, fly_alone, mode):
    """Agents that are asked every tick give the same digest in one process and in many."""
    change = ("--set", f"agents[0].mode={mode}", "--set", "referee.stop.time_limit_s=6")
    assert digest_of(fly(TINY_ROOM, tmp_path, *change)) == digest_of(fly_alone(*change))


def test_a_python_agent_behind_the_gateway_runs_the_same_run(tmp_path):
    """With `door: stdio` it is a process where everything else is in one; its prints go to the log."""
    apart = ("--set", f"agents[0].start={{python: {AGENTS / 'talkative.py'}, door: stdio}}")
    single = fly_here(TINY_ROOM, tmp_path / "single", *apart)
    multi = fly(TINY_ROOM, tmp_path / "multi", *apart, "--set", "agents[0].start.observations=asked")
    native = fly(TINY_ROOM, tmp_path / "native", "--set", f"agents[0].start={{python: {AGENTS / 'talkative.py'}}}")
    assert digest_of(single) == digest_of(multi) == digest_of(native)
    assert "looking around" in (single.run_dir / "logs" / "agent_beetle.log").read_text()


def test_an_agent_that_fails_at_a_decision_has_one_digest_too(tmp_path):
    """How a process ended is reported in the faults; the run's digest does not depend on it."""
    change = ("--set", f"agents[0].start={{python: {AGENTS / 'giving_up.py'}}}")
    multi = fly(TINY_ROOM, tmp_path / "multi", *change)
    single = fly_here(TINY_ROOM, tmp_path / "single", *change)
    assert multi.result["end_reason"] == single.result["end_reason"] == "agent_failed"
    assert digest_of(multi) == digest_of(single)


def test_every_vehicle_obeys_every_command_alike(tmp_path):
    """Iris, Crazyflie, point robot and rover in one room, each with all commands that its kind obeys."""
    multi = fly(EVERY_VEHICLE, tmp_path / "multi")
    single = fly_here(EVERY_VEHICLE, tmp_path / "single")
    assert digest_of(multi) == digest_of(single)
    for agent in single.result["agents"]:
        assert agent["outcome"] == "time_limit"
        assert agent["path_length_m"] > 2.0


def test_ways_around_obstacles_and_each_other_are_alike(tmp_path):
    """Two vehicles change places across a wall, by planned ways that cross."""
    multi = fly(AROUND_A_WALL, tmp_path / "multi")
    single = fly_here(AROUND_A_WALL, tmp_path / "single")
    assert digest_of(multi) == digest_of(single)
    for agent in single.result["agents"]:
        assert agent["outcome"] == "time_limit"
        assert agent["path_length_m"] > 6.0


@pytest.mark.debian
def test_parity_holds_with_every_on_board_sensor(tmp_path):
    """Pictures, ranges and inertial samples are the same to the bit in one process and in many."""
    change = ("--set", "referee.stop.time_limit_s=6")
    multi = fly(ON_BOARD, tmp_path / "multi", *change, is_recorded=True)
    if "expected EGL or OSMesa" in multi.errors:
        pytest.skip("cameras need EGL or OSMesa")
    single = fly_here(ON_BOARD, tmp_path / "single", *change)
    assert digest_of(multi) == digest_of(single)
