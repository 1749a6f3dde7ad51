"""A fork repeats a run up to a tick and goes on another way; without a change it is the run itself."""

import contextlib
import io
import json
import os
import random
import re
import signal
import sys

import pytest
from page_commands import type_on_runs
from real_runs import AGENTS, AROUND_A_WALL, ROOT, TINY_ROOM, fly, fly_here, start, with_agent
from repeated_runs import assert_same, compared, forked

from gslcosim.base.checksums import write_checksums
from gslcosim.base.errors import RecordingError, UsageError
from gslcosim.cli.main import main
from gslcosim_data.run_views import record_runs

SWARM = ROOT / "scenarios" / "swarm_tiny.yaml"
PAGE = ROOT / "docs" / "fork.md"
# Python waits at its end for the threads of a session that was not closed: an agent that has crashed is silent.
QUICK_TO_FAIL = ("--set", "agents[0].answer_within_s=10")


@pytest.fixture(scope="module")
def past(tmp_path_factory):
    return fly(TINY_ROOM, tmp_path_factory.mktemp("past"))


def test_another_method_goes_on_where_the_run_is_forked(past, tmp_path):
    """Up to the tick nothing differs, and what differs first is the new agent's command; it can be run again."""
    fork = forked(past.run_dir, tmp_path, 5, "--agent", "infotaxis", in_process=False)
    assert fork.exit_code in (0, 1), fork.errors
    found = compared(past.run_dir, fork.run_dir)
    assert found["divergence"]["participant"] == "agent_beetle"
    assert found["divergence"]["port"] == "command/beetle"
    assert found["divergence"]["tick"] >= 50
    assert found["fork"] == {"fork": "b", "tick": 50}
    origin = json.loads((fork.run_dir / "manifest.json").read_text())["fork_of"]
    assert origin == {
        "run": past.run_dir.name, "digest": past.result["digest"], "tick": 50, "at_s": 5.0,
        "changed": ["agents[0].start.python"],
    }  # fmt: skip
    output = io.StringIO()
    with contextlib.redirect_stdout(output):
        assert main(["replay", str(fork.run_dir), "--json", "--runs-dir", str(tmp_path / "again")]) == 0
    assert json.loads(output.getvalue())["digest"] == fork.result["digest"]


@pytest.mark.parametrize("in_process", [True, False])
def test_without_a_change_it_is_the_run(past, tmp_path, in_process):
    assert_same(past, forked(past.run_dir, tmp_path, 5, in_process=in_process))


@pytest.mark.parametrize("mode", ["lockstep", "{latency: 3}"])
def test_agents_that_are_asked_every_tick_are_forked(tmp_path, mode):
    change = ("--set", f"agents[0].mode={mode}", "--set", "referee.stop.time_limit_s=8")
    past = fly_here(TINY_ROOM, tmp_path / "past", *change)
    assert_same(past, forked(past.run_dir, tmp_path / "fork", 3, in_process=False))
    other = forked(past.run_dir, tmp_path / "other", 3, "--agent", str(AGENTS / "holding.py"))
    assert compared(past.run_dir, other.run_dir)["divergence"]["tick"] == 30


@pytest.mark.parametrize("door", ["zenoh", "stdio"])
def test_a_program_of_its_own_lives_through_the_past(past, tmp_path, door):
    """Whatever transport it comes by, it answers from tick 0 on, and the log has the past agent's commands before."""
    program = {"zenoh": "holding.py", "stdio": "framed.py"}[door]
    start_block = f"{{command: [{sys.executable}, {AGENTS / program}], door: {door}}}"
    fork = forked(past.run_dir, tmp_path, 5, "--agent", start_block, in_process=False)
    assert fork.exit_code in (0, 1), fork.errors
    lines, old = ((folder / "inputs.log").read_text().splitlines() for folder in (fork.run_dir, past.run_dir))
    ticks = [json.loads(line)["tick"] for line in old]
    n_kept = sum(tick < 50 for tick in ticks)
    assert lines[:n_kept] == old[:n_kept]
    assert compared(past.run_dir, fork.run_dir)["divergence"]["tick"] == ticks[n_kept]


def test_one_of_several_agents_is_replaced(tmp_path):
    past = fly_here(SWARM, tmp_path / "past", "--set", "referee.stop.time_limit_s=20")
    assert_same(past, forked(past.run_dir, tmp_path / "same", 8))
    name = past.result["agents"][1]["name"]
    fork = forked(past.run_dir, tmp_path / "other", 8, "--agent", f"{name}={AGENTS / 'holding.py'}")
    assert compared(past.run_dir, fork.run_dir)["divergence"]["participant"] == f"agent_{name}"
    unnamed = forked(past.run_dir, tmp_path / "none", 8, "--agent", "infotaxis")
    assert (unnamed.exit_code, unnamed.run_dir) == (2, None)
    assert "expected NAME=infotaxis with one of " in unnamed.errors


@pytest.mark.parametrize("in_process", [True, False])
def test_other_wind_and_gas_blow_from_the_fork_on(past, tmp_path, in_process):
    """The past repeats although the run had no events; afterwards the fork is another run, which replays."""
    turned = ("--event", "{what: wind_changes, at_s: 5.1, inlet_velocity_m_s: [0, 0.5, 0]}")
    more = ("--event", "{what: source_rate, at_s: 6, filaments_per_s: 30}")
    fork = forked(past.run_dir, tmp_path / "fork", 5, *turned, *more, in_process=in_process)
    assert fork.exit_code in (0, 1), fork.errors
    assert fork.result["fork_of"]["divergence"] is None
    assert fork.result["fork_of"]["changed"] == ["events"]
    assert [event["tick"] for event in fork.result["events"]] == [51, 60]
    assert fork.result["digest"] != past.result["digest"]
    found = compared(past.run_dir, fork.run_dir)["divergence"]
    assert found["tick"] == 51
    assert found["port"] != "truth/events"
    with contextlib.redirect_stdout(io.StringIO()):
        assert main(["replay", str(fork.run_dir), "--json", "--runs-dir", str(tmp_path / "again")]) == 0


def test_another_seed_is_reported_and_named(past, tmp_path):
    fork = forked(past.run_dir, tmp_path, 5, "--set", "agents[0].seed=3", "--agent", "infotaxis")
    assert fork.result["fork_of"]["divergence"] is None
    assert compared(past.run_dir, fork.run_dir)["changed_agents"] == ["beetle"]
    assert compared(past.run_dir, fork.run_dir)["divergence"]["tick"] >= 50


def test_an_agent_that_crashes_in_the_past_fails_at_the_fork(past, tmp_path):
    start_block = f"{{command: [{sys.executable}, {AGENTS / 'crashing.py'}]}}"
    fork = forked(past.run_dir, tmp_path, 5, "--agent", start_block, *QUICK_TO_FAIL, in_process=False)
    assert fork.exit_code == 1
    assert fork.result["end_reason"] == "agent_failed"
    assert fork.result["sim_time_s"] >= 5


def test_a_fork_of_a_fork_knows_its_run(past, tmp_path):
    first = forked(past.run_dir, tmp_path / "first", 5, "--agent", str(AGENTS / "holding.py"))
    second = forked(first.run_dir, tmp_path / "second", 7, "--agent", "infotaxis")
    assert second.result["fork_of"]["run"] == first.run_dir.name
    assert compared(past.run_dir, second.run_dir)["divergence"]["tick"] < 70


def test_an_interrupted_run_is_forked_as_far_as_it_came(tmp_path):
    flight = start(TINY_ROOM, tmp_path / "past", "--set", "referee.success.within_m=0.001")
    flight.wait_until_flying()
    os.kill(flight.process.pid, signal.SIGINT)
    past = flight.end()
    late = forked(past.run_dir, tmp_path / "late", past.result["sim_time_s"] + 1)
    assert (late.exit_code, late.run_dir) == (2, None)
    if past.result["sim_time_s"] > 0:
        fork = forked(past.run_dir, tmp_path / "fork", past.result["sim_time_s"])
        assert fork.exit_code in (0, 1), fork.errors


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (("--at", "300"), "expected a time above 0 and up to the end of"),
        (("--at", "5", "--set", "gas.warm_up_s=3"), "gas.warm_up_s: expected as in the run"),
        (("--at", "5", "--agent", "moth=infotaxis"), "expected one of beetle, which took part, was 'moth'"),
        (("--at", "5", "--agent", "nobody"), "expected a bundled agent"),
        (("--at", "5", "--agent", "'"), "a command line, was one that cannot be read"),
        (("--at", "5", "--set", "agents[0].start.python=./none.py"), "expected a Python file"),
    ],
)
def test_what_cannot_be_forked_is_refused_before_anything_runs(past, tmp_path, arguments, text):
    refused = forked(past.run_dir, tmp_path, *arguments[1:2], *arguments[2:])
    assert (refused.exit_code, refused.run_dir) == (2, None)
    assert text in refused.errors


CHANGES = {
    "another contract": ("manifest.json", lambda text: re.sub(r'(?<="contract_hash": ")', "other", text)),
    "a log cut short": ("inputs.log", lambda text: "".join(text.splitlines(keepends=True)[:2])),
    "a log of other ticks": ("inputs.log", lambda text: re.sub(r'(?<="tick": )', "1", text)),
    "a log that is none": ("inputs.log", lambda text: text[:60]),
    "no result": ("result.json", lambda text: text[:40]),
}


@pytest.mark.parametrize("change", CHANGES)
def test_a_run_that_is_not_whole_is_refused(past, tmp_path, change):
    name, spoil = CHANGES[change]
    kept = (past.run_dir / name).read_text()
    (past.run_dir / name).write_text(spoil(kept))
    refused = forked(past.run_dir, tmp_path, 5)
    (past.run_dir / name).write_text(kept)
    assert (refused.exit_code, refused.run_dir) == (2, None), refused.errors
    assert name.replace("manifest.json", "expected a run of contract") in refused.errors


def test_a_failed_agent_is_replaced_before_it_failed_only(tmp_path):
    past = fly(TINY_ROOM, tmp_path / "past", *with_agent("crashing"), *QUICK_TO_FAIL)
    failed_s = past.result["sim_time_s"]
    late = forked(past.run_dir, tmp_path / "late", failed_s, "--agent", "infotaxis")
    commands = [json.loads(line) for line in (past.run_dir / "inputs.log").read_text().splitlines()]
    if commands[-1]["tick"] < past.result["ticks"]:
        assert (late.exit_code, late.run_dir) == (2, None)
        assert "at which beetle failed" in late.errors
    sooner = forked(past.run_dir, tmp_path / "sooner", commands[-1]["tick"] / 10, "--agent", "dung_beetle")
    assert sooner.result["end_reason"] != "agent_failed", sooner.errors


def test_a_past_that_does_not_repeat_is_reported(past, tmp_path):
    """As after other code: the digests of the run are of something else."""
    digest = past.run_dir / "digest.json"
    kept = digest.read_text()
    fields = json.loads(kept)
    samples = fields["ports"]["truth/samples"]
    samples["links"] = "AAAA" + samples["links"][4:]
    digest.write_text(json.dumps(fields))
    write_checksums(past.run_dir, digest.name)
    fork = forked(past.run_dir, tmp_path, 5)
    digest.write_text(kept)
    assert fork.exit_code == 5
    assert "The past did not repeat" in fork.errors
    assert "participant fields, port truth/samples" in fork.errors


@pytest.mark.parametrize("case", [0, 1, *(pytest.param(case, marks=pytest.mark.soak) for case in range(2, 12))])
def test_random_runs_are_forked(tmp_path, case):
    """Seeds, methods, modes and ticks drawn at random; half of the runs in many processes, and half of the forks."""
    rng = random.Random(case)
    change = [f"agents[0].mode={rng.choice(['on_request', 'lockstep', '{latency: 2}'])}"]
    change += ["referee.stop.time_limit_s=6", f"gas.step_s={rng.choice([0.1, 0.05])}"]
    scenario, method = rng.choice([TINY_ROOM, AROUND_A_WALL]), rng.choice(["dung_beetle", "infotaxis", "casting"])
    change += [f"agents[0].start.python={method}"] if scenario is TINY_ROOM else []
    arguments = [word for item in change for word in ("--set", item)]
    past = (fly if case % 2 else fly_here)(scenario, tmp_path / "past", "--seed", str(rng.randrange(99)), *arguments)
    at_s = rng.randrange(1, past.result["ticks"]) / 10
    assert_same(past, forked(past.run_dir, tmp_path / "fork", at_s, in_process=rng.random() < 0.5))


def test_both_are_seen_in_one_recording(tmp_path):
    """Each has its track, its curves and its notes; where they part is reported once."""
    from rerun.chunk import RrdReader

    past = fly_here(TINY_ROOM, tmp_path / "past", is_recorded=True)
    fork = forked(past.run_dir, tmp_path / "fork", 5, "--agent", "infotaxis", "--set", "recording.enabled=true")
    path = tmp_path / "both.rrd"
    record_runs([run_dir / "recording.rrd" for run_dir in (past.run_dir, fork.run_dir)], path)
    chunks = [*RrdReader(path).store().stream().to_chunks()]
    found = {str(chunk.entity_path) for chunk in chunks if not chunk.is_static}
    assert found >= {
        "/tracks/A_dung_beetle", "/tracks/B_infotaxis", "/plots/distance_m/A_dung_beetle",
        "/plots/distance_m/B_infotaxis", "/beliefs/B_infotaxis", "/events/A", "/events/B", "/gas/filaments",
    }  # fmt: skip
    (row,) = (chunk.to_record_batch() for chunk in chunks if str(chunk.entity_path) == "/events/parting")
    tick = compared(past.run_dir, fork.run_dir)["divergence"]["tick"]
    assert row.column("tick").to_pylist() == [tick]
    text = row.column("TextLog:text").to_pylist()[0][0]
    assert text == f"They part at {tick / 10:g} s (forked at 5 s): agent_beetle, command/beetle"
    marks = [chunk for chunk in chunks if str(chunk.entity_path).endswith("/they_part") and not chunk.is_static]
    assert {str(chunk.entity_path) for chunk in marks} == {
        "/markers/A_dung_beetle/they_part", "/plots/distance_m/they_part", "/plots/gas_ppm/they_part",
    }  # fmt: skip


def test_runs_of_other_rooms_are_not_seen_together(past, tmp_path):
    a = fly_here(TINY_ROOM, tmp_path / "a", is_recorded=True)
    b = fly_here(AROUND_A_WALL, tmp_path / "b", "--set", "referee.stop.time_limit_s=2", is_recorded=True)
    with pytest.raises(UsageError, match="expected a run in the room of"):
        record_runs([ended.run_dir / "recording.rrd" for ended in (a, b)], tmp_path / "both.rrd")
    with pytest.raises(RecordingError, match="expected at most 8 runs at once, was 9"):
        record_runs([a.run_dir / "recording.rrd"] * 9, tmp_path / "both.rrd")
    (b.run_dir / "recording.rrd").write_bytes(b"nothing")
    (a.run_dir / "recording.rrd").write_bytes(b"nothing")
    with pytest.raises(RecordingError, match="expected a whole one, was one that was cut off"):
        record_runs([a.run_dir / "recording.rrd"] * 2, tmp_path / "both.rrd")


def test_the_commands_of_the_page_work(tmp_path):
    text = PAGE.read_text()
    lines = [line for block in re.findall(r"```sh\n(.*?)```", text, re.DOTALL) for line in block.splitlines()]
    assert len(lines) >= 3
    for line in lines:
        line = line.replace("gslcosim view", "gslcosim view --screenshot view.png")
        line = line.replace("warehouse_empty --seed 7", str(TINY_ROOM)).replace("--at 30", "--at 5")
        ended = type_on_runs(line, tmp_path)
        expected = (5,) if "compare" in line else (0, 1)
        assert ended.returncode in expected, f"{line}\n{ended.stdout}\n{ended.stderr}"
