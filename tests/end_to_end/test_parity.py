"""One scenario and seed have one digest: in many processes, on one loaded core, in one process."""

import random
import subprocess
import sys

import pytest
from real_runs import AGENTS, AROUND_A_WALL, EVERY_VEHICLE, ON_BOARD, TINY_ROOM, fly, fly_here, start


def digest_of(ended):
    assert ended.result["valid"], ended.errors
    return ended.result["digest"]


@pytest.fixture
def busy_process():
    """Keep core 0 busy, as a second program would."""
    process = subprocess.Popen(["taskset", "-c", "0", sys.executable, "-c", "while True: pass"])
    yield
    process.kill()
    process.wait()


@pytest.mark.tour
def test_the_digest_does_not_depend_on_how_a_run_is_executed(tmp_path, busy_process):
    """Processes with a recorder, without one on a loaded core, and one process agree; another seed does not."""
    multi = fly(TINY_ROOM, tmp_path / "multi", is_recorded=True)
    pinned = fly(TINY_ROOM, tmp_path / "pinned", prefix=("taskset", "-c", "0"))
    single = fly_here(TINY_ROOM, tmp_path / "single")
    other = fly_here(TINY_ROOM, tmp_path / "other", "--seed", "8")
    assert digest_of(multi) == digest_of(pinned) == digest_of(single)
    assert digest_of(other) != digest_of(multi)
    assert (multi.result["agents"], multi.result["ticks"]) == (single.result["agents"], single.result["ticks"])


def test_services_that_share_a_process_give_the_same_digest(tmp_path):
    """All services in one process, and some of them in two, agree with one process; agents stay apart."""
    grouped = fly(TINY_ROOM, tmp_path / "grouped", "--processes", "grouped", is_recorded=True)
    lists = "processes=[[referee, world], [recorder, sensing]]"
    listed = fly(TINY_ROOM, tmp_path / "listed", "--set", lists, is_recorded=True)
    single = fly_here(TINY_ROOM, tmp_path / "single")
    assert digest_of(grouped) == digest_of(listed) == digest_of(single)
    logs = {log.stem for log in (listed.run_dir / "logs").iterdir()}
    assert {"world+referee", "fields", "sensing+recorder"} <= logs


@pytest.mark.parametrize("seed", [0, 1, *(pytest.param(seed, marks=pytest.mark.soak) for seed in range(2, 12))])
def test_random_groups_of_services_give_the_same_digest(tmp_path, seed):
    """In lockstep, where each tick waits for the agent, any grouping is the same run."""
    rng = random.Random(seed)
    names = ["world", "fields", "sensing", "referee"]
    rng.shuffle(names)
    cut = rng.randrange(1, len(names))
    change = ("--set", "agents[0].mode=lockstep", "--set", "referee.stop.time_limit_s=6")
    lists = f"processes=[[{', '.join(names[:cut])}], [{', '.join(names[cut:])}]]"
    grouped = fly(TINY_ROOM, tmp_path / "grouped", *change, "--set", lists)
    single = fly_here(TINY_ROOM, tmp_path / "single", *change)
    assert digest_of(grouped) == digest_of(single)


@pytest.mark.parametrize("mode", ["lockstep", "{latency: 3}"])
def test_parity_holds_in_every_mode(tmp_path, mode):
    """Agents that are asked every tick give the same digest in one process and in many."""
    change = ("--set", f"agents[0].mode={mode}", "--set", "referee.stop.time_limit_s=8")
    multi = fly(TINY_ROOM, tmp_path / "multi", *change)
    single = fly_here(TINY_ROOM, tmp_path / "single", *change)
    assert digest_of(multi) == digest_of(single)


def test_a_python_agent_behind_the_gateway_runs_the_same_run(tmp_path):
    """With `door: stdio` it is a process where everything else is in one; its prints go to the log."""
    apart = ("--set", f"agents[0].start={{python: {AGENTS / 'talkative.py'}, door: stdio}}")
    single = fly_here(TINY_ROOM, tmp_path / "single", *apart)
    multi = fly(TINY_ROOM, tmp_path / "multi", *apart, "--set", "agents[0].start.observations=asked")
    native = fly(TINY_ROOM, tmp_path / "native", "--set", f"agents[0].start={{python: {AGENTS / 'talkative.py'}}}")
    assert digest_of(single) == digest_of(multi) == digest_of(native)
    assert "looking around" in (single.run_dir / "logs" / "agent_beetle.log").read_text()


def test_runs_at_the_same_time_never_meet(tmp_path):
    """Two runs on one machine have their own routers and the same digests as alone."""
    flights = [start(TINY_ROOM, tmp_path / str(i)) for i in range(2)]
    first, second = (digest_of(flight.end()) for flight in flights)
    assert first == second


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
