"""A run that goes on at a snapshot is the run itself: every core's state, at random ticks, over both hostings."""

import contextlib
import hashlib
import io
import json
import random
import re
import shutil
import zlib

import msgpack
import pytest
from page_commands import type_on_runs
from real_runs import AGENTS, ROOT, TINY_ROOM, fly, fly_here
from repeated_runs import assert_same, compared, forked
from snapshot_cases import CASES, write_movie

from gslcosim.cli.main import main

SWARM = ROOT / "scenarios" / "swarm_tiny.yaml"


def replayed(run_dir, runs_dir, from_s, *arguments):
    """Replay a run from a time on, in this process; return the exit code, what came of it, and what was said."""
    words = ["replay", str(run_dir), "--from", f"{from_s:g}", "--json", "--runs-dir", str(runs_dir), *arguments]
    output, errors = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(output), contextlib.redirect_stderr(errors):
        exit_code = main(words)
    return exit_code, json.loads(output.getvalue()), errors.getvalue()


def snapshots_of(run_dir):
    return sorted(int(folder.name) for folder in (run_dir / "snapshots").iterdir() if folder.name.isdecimal())


@pytest.fixture(scope="module")
def past(tmp_path_factory):
    """A run in one process with a snapshot every two seconds."""
    return fly_here(TINY_ROOM, tmp_path_factory.mktemp("past"), "--set", "snapshots.every_s=2")


# Of releases, and of rooms with walls, others are among those that are always flown.
REPEATS = ("avoidance", "poisson", "scheduled", "downwash")


@pytest.mark.slow
@pytest.mark.parametrize(
    "name",
    [pytest.param(name, marks=pytest.mark.soak) if name in REPEATS else name for name in [*CASES, "playback"]],
)
def test_a_run_from_a_snapshot_has_the_digest_of_the_whole(tmp_path, name):
    """All gas models, releases, sensors, vehicles, events, radio, modes of agents; at ticks that the name draws."""
    rng = random.Random(name)
    scenario, changes = (TINY_ROOM, write_movie(tmp_path)) if name == "playback" else CASES[name]
    every_s = rng.randint(3, 15) / 10
    run = fly_here(scenario, tmp_path / "a", *changes, "--set", f"snapshots.every_s={every_s}")
    whole = fly_here(scenario, tmp_path / "whole", *changes)
    assert run.result["digest"] == whole.result["digest"] is not None
    for i in range(2):
        from_s = rng.uniform(every_s, run.result["ticks"] / 10)
        exit_code, again, errors = replayed(run.run_dir, tmp_path / f"b{i}", from_s, "--no-recording")
        assert (exit_code, again["digest"]) == (0, run.result["digest"]), errors
        tick = again["comparison"]["snapshot_tick"]
        assert from_s * 10 - every_s * 10 - 1 <= tick <= from_s * 10 + 1


@pytest.mark.tour
def test_a_fork_begins_at_the_last_snapshot_before_it(past, tmp_path):
    assert snapshots_of(past.run_dir)[:3] == [20, 40, 60]
    fork = forked(past.run_dir, tmp_path / "same", 5)
    assert_same(past, fork)
    assert fork.result["fork_of"]["snapshot_tick"] == 40
    assert (fork.run_dir / "inputs.log").read_text() == (past.run_dir / "inputs.log").read_text()
    whole = forked(past.run_dir, tmp_path / "whole", 5, "--from-start")
    assert_same(past, whole)
    assert "snapshot_tick" not in whole.result["fork_of"]


@pytest.mark.parametrize(("scenario", "processes"), [(TINY_ROOM, "separate"), (SWARM, "grouped")])
def test_processes_write_snapshots_and_go_on_at_them(tmp_path, scenario, processes):
    """Each service writes its own part, and all are of one run anyone who wrote them and goes on with them."""
    options = ("--set", "snapshots.every_s=3", "--processes", processes)
    run = fly(scenario, tmp_path / "a", *options)
    here = forked(run.run_dir, tmp_path / "here", 8)
    assert_same(run, here)
    apart = forked(run.run_dir, tmp_path / "apart", 8, "--processes", processes, in_process=False)
    assert_same(run, apart)
    assert here.result["fork_of"]["snapshot_tick"] == apart.result["fork_of"]["snapshot_tick"] == 60


@pytest.mark.parametrize("in_process", [True, False])
def test_the_new_agent_has_lived_through_the_past(past, tmp_path, in_process):
    """It is sent and asked the same as in a fork that repeats the run: so it answers the same."""
    whole = forked(past.run_dir, tmp_path / "whole", 6, "--agent", "infotaxis", "--from-start")
    fork = forked(past.run_dir, tmp_path / "fork", 6, "--agent", "infotaxis", in_process=in_process)
    assert fork.result["fork_of"]["snapshot_tick"] == 60
    assert fork.result["digest"] == whole.result["digest"] != past.result["digest"]


@pytest.mark.parametrize("door", ["zenoh", "stdio"])
def test_programs_get_past_observations_over_both_transports(past, tmp_path, door):
    program = {"zenoh": "holding.py", "stdio": "framed.py"}[door]
    block = f"{{command: [python3, {AGENTS / program}], door: {door}}}"
    options = ("--agent", block, "--set", "referee.stop.time_limit_s=9")
    whole = forked(past.run_dir, tmp_path / "whole", 6, *options, "--from-start", in_process=False)
    fork = forked(past.run_dir, tmp_path / "fork", 6, *options, in_process=False)
    assert fork.result["digest"] == whole.result["digest"]


def test_what_a_fork_changes_is_not_what_the_snapshot_remembers(past, tmp_path):
    """The time limit and how it is recorded are the fork's; what it is granted is given in its briefing."""
    changes = ("--agent", str(AGENTS / "holding.py"), "--set", "referee.stop.time_limit_s=12")
    more = ("--set", "recording.gas_every_s=0.5", "--set", "agents[0].seed=3")
    whole = forked(past.run_dir, tmp_path / "whole", 9, *changes, *more, "--from-start")
    fork = forked(past.run_dir, tmp_path / "fork", 9, *changes, *more)
    assert fork.result["fork_of"]["snapshot_tick"] == 80
    assert (fork.result["ticks"], fork.result["end_reason"]) == (120, "time_limit")
    assert compared(whole.run_dir, fork.run_dir)["divergence"]["port"] == "truth/filaments"


def test_a_replay_takes_snapshots_of_a_run_that_took_none(tmp_path):
    run = fly_here(TINY_ROOM, tmp_path / "run", "--set", "referee.stop.time_limit_s=8")
    assert not (run.run_dir / "snapshots").exists()
    _, again, _ = replayed(run.run_dir, tmp_path / "b", 0, "--snapshots-every", "3", "--no-recording")
    again_dir = tmp_path / "b" / again["run_id"]
    assert snapshots_of(again_dir)[0] == 30
    fork = forked(again_dir, tmp_path / "c", 4)
    assert (fork.result["digest"], fork.result["fork_of"]["snapshot_tick"]) == (run.result["digest"], 30)


def test_snapshots_of_a_fork_that_began_at_one_are_whole(past, tmp_path):
    first = forked(past.run_dir, tmp_path / "first", 7)
    second = forked(first.run_dir, tmp_path / "second", 11)
    assert second.result["fork_of"]["snapshot_tick"] == 100
    assert second.result["digest"] == past.result["digest"]


def put_command(part, log):
    """Let a part call a program where it is read, with hashes as anyone can make them."""
    head, body = msgpack.unpackb(part.read_bytes())
    fields = msgpack.unpackb(zlib.decompress(body), strict_map_key=False)
    node = {"k": "b", "t": "gslcosim.base.spawn:os.system", "v": [f"touch {part.with_name('called')}"]}
    fields["state"]["nodes"].append(node)
    body = zlib.compress(msgpack.packb(fields))
    head["hash"] = hashlib.blake2b(body, digest_size=16).hexdigest()
    part.write_bytes(msgpack.packb([head, body]))


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (put_command, "not signed with the key of this cache"),
        (lambda part, log: part.write_bytes(part.read_bytes()[:-9]), "damaged"),
        (lambda part, log: part.unlink(), "without the part of world (No such file or directory)"),
        (lambda part, log: log.write_bytes(log.read_bytes()[:40]), "without "),
    ],
)
def test_a_snapshot_that_cannot_be_used_is_reported_and_the_run_repeated(past, tmp_path, spoil, words):
    run_dir = tmp_path / "runs" / past.run_dir.name
    shutil.copytree(past.run_dir, run_dir)
    for tick in snapshots_of(run_dir)[1:]:
        shutil.rmtree(run_dir / "snapshots" / f"{tick:09d}")
    spoil(run_dir / "snapshots" / "000000020" / "world.snap", run_dir / "snapshots" / "told" / "beetle.log")
    fork = forked(run_dir, tmp_path / "fork", 5)
    assert fork.errors.startswith(f"The snapshot of {run_dir.name} at tick 20 cannot be used: it is {words}")
    assert fork.errors.rstrip().endswith("The run is repeated from its start.")
    assert_same(past, fork)
    assert not list(run_dir.rglob("called"))


def test_a_snapshot_of_other_code_is_refused_in_a_sentence(past, tmp_path, monkeypatch):
    from gslcosim.runtime.replay import snapshot

    monkeypatch.setattr(snapshot, "hash_code", lambda paths: "0123456789abcdef")
    snapshot.CodeIdentity.read_own.cache_clear()
    try:
        fork = forked(past.run_dir, tmp_path, 5)
    finally:
        snapshot.CodeIdentity.read_own.cache_clear()
    assert "at tick 40 cannot be used: it is of other code (gslcosim " in fork.errors
    assert fork.errors.count("\n") == 1
    assert_same(past, fork)


def test_a_fork_with_other_events_says_that_it_cannot_use_a_snapshot(past, tmp_path):
    sticks = ("--event", "{what: sensor_sticks, at_s: 6, agent: beetle, sensor: nose}")
    fork = forked(past.run_dir, tmp_path / "fork", 5, *sticks)
    log = f"The snapshot of {past.run_dir.name} at tick 40 cannot be used: it knows of the run's events only"
    assert fork.errors.startswith(log)
    assert fork.errors.rstrip().endswith("The run is repeated from its start.")
    assert "snapshot_tick" not in fork.result["fork_of"]
    assert forked(past.run_dir, tmp_path / "early", 1, *sticks).errors == ""


def test_a_run_is_the_same_with_snapshots_and_without(past, tmp_path):
    assert fly_here(TINY_ROOM, tmp_path).result["digest"] == past.result["digest"]


def test_a_recording_begins_at_the_snapshot(past, tmp_path):
    words = ["fork", str(past.run_dir), "--at", "5", "--in-process", "--runs-dir", str(tmp_path)]
    output = io.StringIO()
    with contextlib.redirect_stdout(output):
        assert main([*words, "--set", "recording.enabled=true"]) == past.exit_code
    assert "begun at   the snapshot of tick 40; the recording begins there" in output.getvalue()
    assert next(tmp_path.glob("*/recording.rrd")).stat().st_size > 10_000


def test_the_commands_of_the_page_work(tmp_path):
    lines = re.findall(r"^gslcosim .*$", (ROOT / "docs" / "snapshots.md").read_text(), re.MULTILINE)
    assert len(lines) == 4
    for line in lines:
        # A shorter run in a smaller room; what comes of it is in runs, as on the page.
        line = line.replace("warehouse_empty --seed 7", str(TINY_ROOM)).replace("every_s=10", "every_s=2")
        line = line.replace("--at 30", "--at 5").replace("--from 35", "--from 5").replace("-every 10", "-every 2")
        ended = type_on_runs(line, tmp_path)
        assert ended.returncode in (0, 1), f"{line}\n{ended.stdout}\n{ended.stderr}"
