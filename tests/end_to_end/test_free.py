"""Agents that time does not wait for: their commands take effect when they come, and the run repeats to the bit."""

import contextlib
import io
import json
import random
import sys

import pytest
from real_runs import AGENTS, ROOT, TINY_ROOM, fly, fly_here
from repeated_runs import replayed
from test_replay import assert_equal

from gslcosim.cli.main import main

SWARM = ROOT / "scenarios" / "swarm_tiny.yaml"
SHORT = ("--set", "referee.stop.time_limit_s=8")
FREE = ("--set", "agents[0].mode=free", "--pace", "20")


def commands_of(run_dir, agent=None):
    lines = [json.loads(line) for line in (run_dir / "inputs.log").read_text().splitlines()]
    return [line for line in lines if agent is None or line["agent"] == agent]


@pytest.mark.parametrize("processes", ["one", pytest.param("separate", marks=pytest.mark.tour)])
def test_a_free_run_repeats_to_the_bit(tmp_path, processes):
    """The same method as ever; every tick has an input, and the method's own are among them."""
    past = fly(TINY_ROOM, tmp_path / "past", *FREE[:2], "--pace", "4", *SHORT, "--processes", processes)
    assert past.exit_code in (0, 1), past.errors
    commands = commands_of(past.run_dir)
    assert [command["tick"] for command in commands] == list(range(len(commands)))
    assert len(commands) >= past.result["ticks"]
    assert past.result["agents"][0]["steps"] == sum(
        command["kind"] != "noop" for command in commands if command["tick"] < past.result["ticks"]
    )
    assert past.result["agents"][0]["steps"] >= 1
    assert past.result["pace"]["factor"] == 4
    assert_equal(past, replayed(past.run_dir, tmp_path / "again"))


@pytest.mark.parametrize("processes", ["one", "grouped"])
def test_agents_of_all_modes_run_together(tmp_path, processes):
    """One is waited for at its waypoints, one at every tick, one never; they talk by radio."""
    modes = ("--set", "agents[0].mode=free", "--set", "agents[1].mode=lockstep", "--pace", "20")
    past = fly(SWARM, tmp_path / "past", *modes, *SHORT, "--processes", processes)
    assert past.exit_code in (0, 1), past.errors
    assert_equal(past, replayed(past.run_dir, tmp_path / "again"))


def test_agents_of_one_process_may_be_free(tmp_path):
    free = ("--set", "agents[0].mode=free", "--set", "agents[1].mode=free", "--pace", "20")
    shared = ("--set", "agents[1].start={process_of: a}")
    names = ("--set", "agents[0].name=a")
    past = fly_here(SWARM, tmp_path / "past", *names, *shared, *free, *SHORT)
    assert past.exit_code in (0, 1), past.errors
    assert_equal(past, replayed(past.run_dir, tmp_path / "again"))


def test_time_does_not_wait_for_a_slow_agent(tmp_path):
    """Half a second for a decision is ten seconds of run at this pace: most ticks go by unanswered."""
    slow = ("--set", f"agents[0].start={{python: {AGENTS / 'slow_listener.py'}}}")
    past = fly_here(TINY_ROOM, tmp_path / "past", *FREE, *slow)
    assert past.exit_code == 1, past.errors
    assert past.result["sim_time_s"] == 20
    assert past.result["agents"][0]["steps"] < past.result["ticks"] / 4
    assert_equal(past, replayed(past.run_dir, tmp_path / "again"))


def test_pace_alone_changes_no_digest(tmp_path):
    fast = fly_here(TINY_ROOM, tmp_path / "fast", *SHORT)
    for processes in ("one", "grouped"):
        paced = fly(TINY_ROOM, tmp_path / processes, *SHORT, "--pace", "20", "--processes", processes)
        assert paced.result["digest"] == fast.result["digest"]
        assert paced.result["pace"]["factor"] == 20
        assert set(paced.result["pace"]) == {"factor", "worst_lag_s", "late_share", "lost_s"}


def test_a_machine_that_cannot_keep_pace_is_reported(tmp_path):
    paced = fly_here(TINY_ROOM, tmp_path, *SHORT, "--pace", "1000")
    assert paced.result["pace"]["late_share"] > 0.5
    assert paced.result["real_time_factor"] < 1000


def test_a_free_run_is_forked_where_another_method_is_waited_for(tmp_path):
    """The past is not held back by the clock, and repeats."""
    past = fly_here(TINY_ROOM, tmp_path / "past", *FREE, *SHORT)
    output = io.StringIO()
    words = ["fork", str(past.run_dir), "--at", "4", "--agent", "casting", "--json", "--in-process"]
    with contextlib.redirect_stdout(output), contextlib.redirect_stderr(io.StringIO()):
        assert main([*words, "--runs-dir", str(tmp_path / "fork"), "--set", "pace=40"]) in (0, 1)
    forked = json.loads(output.getvalue())
    assert forked["fork_of"]["divergence"] is None
    assert forked["pace"]["factor"] == 40


def test_free_without_a_pace_is_refused(tmp_path, capfd):
    assert main(["up", str(TINY_ROOM), "--set", "agents[0].mode=free", "--runs-dir", str(tmp_path)]) == 2
    assert "agents[0].mode: expected free only where simulated time follows the clock" in capfd.readouterr().err


def random_free_run(case, folder):
    """Fly free agents of a random scenario, pace and mix of modes; return what was chosen, the run and its replay."""
    draw = random.Random(f"free {case}")
    scenario, n_agents = draw.choice([(TINY_ROOM, 1), (SWARM, 3)])
    modes = [draw.choice(["free", "on_request", "lockstep", "{latency: 3}"]) for _ in range(n_agents)]
    modes[draw.randrange(n_agents)] = "free"
    pace, seed = draw.choice([10, 30, 100]), draw.randrange(1000)
    words = [word for i, mode in enumerate(modes) for word in ("--set", f"agents[{i}].mode={mode}")]
    words += ["--seed", str(seed), "--pace", str(pace), "--set", f"referee.stop.time_limit_s={draw.randint(3, 9)}"]
    past = fly_here(scenario, folder / "past", *words)
    return f"{scenario.stem} {modes} pace {pace}", past, replayed(past.run_dir, folder / "again")


@pytest.mark.parametrize("case", range(6))
def test_random_free_runs_repeat(tmp_path, case):
    chosen, past, again = random_free_run(case, tmp_path)
    assert past.exit_code in (0, 1), (chosen, past.errors)
    assert_equal(past, again)


@pytest.mark.soak
def test_200_random_free_runs_repeat(tmp_path, capsys):
    differ = []
    for case in range(200):
        chosen, past, again = random_free_run(case, tmp_path / str(case))
        is_equal = again.exit_code == 0 and again.result["digest"] == past.result["digest"]
        differ += [] if is_equal else [chosen]
        with capsys.disabled():
            ended = "equal" if is_equal else "DIFFERENT"
            sys.stdout.write(f"{case:3d} {past.result['ticks']:4d} ticks  {ended}  {chosen}\n")
    assert not differ
