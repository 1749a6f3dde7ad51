"""`make bench-peers`: its own part runs, and what can go wrong is reported; HELICS and mosaik are not needed."""

import json
import subprocess
import sys
from pathlib import Path

import pytest
from deadlines import PROCESS_S

BENCHMARKS = Path(__file__).parents[1] / "benchmarks"
sys.path[:0] = [str(BENCHMARKS), str(BENCHMARKS / "peers")]

import bench_peers  # noqa: E402 - a script beside this folder
from in_memory_bus import InMemoryHub  # noqa: E402 - as above
from ring import NAMES, Participant, places, run_processes, text_of, ticks_per_s  # noqa: E402 - as above

from gslcosim.runtime.distributed import protocol  # noqa: E402 - as above
from gslcosim.runtime.run_dir import RunDir  # noqa: E402 - as above
from gslcosim_ring import Watch  # noqa: E402 - as above


def bench(*words):
    call = [sys.executable, BENCHMARKS / "bench_peers.py", *map(str, words)]
    return subprocess.run(call, capture_output=True, text=True, timeout=PROCESS_S)


def test_help_has_an_example():
    done = bench("--help")
    assert done.returncode == 0
    assert "bench_peers.py --n 9 --ticks 5000 --json" in done.stdout


def test_missing_peers_are_reported_with_what_to_do(tmp_path):
    done = bench("--peers-python", tmp_path / "python")
    assert done.returncode == 1
    assert "`make bench-peers` makes it" in done.stderr


@pytest.mark.slow
@pytest.mark.end_to_end
def test_our_own_participants_pass_both_loops():
    done = bench("--only", "gslcosim", "--n", 1, "--ticks", 40, "--json")
    assert done.returncode == 0, done.stderr
    output = json.loads(done.stdout)
    assert [(row["name"], row["shape"]) for row in output["ticks_per_s"]] == [
        ("gslcosim", "closed"),
        ("gslcosim", "open"),
    ]
    assert all(speed > 0 for row in output["ticks_per_s"] for speed in row["rounds"])
    assert output["ratios"] == []


def test_a_contestant_that_fails_is_named_with_what_it_said(tmp_path):
    python = tmp_path / "python"
    python.write_text("#!/bin/sh\necho 'no module' >&2\nexit 4\n")
    python.chmod(0o700)
    done = bench("--only", "mosaik", "--peers-python", python)
    assert done.returncode == 1
    assert done.stderr == "mosaik, closed loop: expected a speed, was:\nno module\n\n"


def test_a_contestant_that_hangs_is_ended(tmp_path):
    python = tmp_path / "python"
    python.write_text("#!/bin/sh\nread -r forever < /dev/zero\n")
    python.chmod(0o700)
    (mosaik,) = bench_peers.chosen(["mosaik"], python)
    with pytest.raises(SystemExit, match=r"mosaik, open loop: expected an end within 0.1 s, was none\."):
        bench_peers.measured(mosaik, python, "open", 5, limit_s=0.1)


@pytest.mark.parametrize("option", ["--n", "--ticks"])
def test_no_rounds_and_no_ticks_are_refused(option):
    done = bench(option, 0)
    assert done.returncode == 2
    assert f"argument {option}: expected a whole number of at least 1, was '0'." in done.stderr


def test_our_own_watch_ends_with_the_first_who_fails(tmp_path):
    ours, theirs = (hub := InMemoryHub()).open(), hub.open()
    watch = Watch(ours, RunDir(tmp_path))
    watch.listen()
    watch.exited("fields", 3)
    with pytest.raises(SystemExit, match="fields ended with exit code 3 before the end"):
        watch.fly(5)
    note = protocol.FaultReport(participant="sensing", tick=2, text="it broke")
    theirs.publish(protocol.FAULT_KEY, note.to_bytes())
    with pytest.raises(SystemExit, match="sensing: it broke"):
        watch.await_all()


def test_in_the_closed_loop_alone_the_first_one_waits_for_the_agent():
    closed, opened = places("closed"), places("open")
    assert [place.reads for place in closed] == [NAMES[-1], *NAMES[:-1]]
    assert [place.delay_ticks for place in closed] == [1, 0, 0, 0, 0]
    assert [place.reads for place in opened] == [None, *NAMES[:-1]]


@pytest.mark.parametrize("received", ["", text_of("agent", 3), text_of("world", 4)])
def test_a_participant_refuses_what_is_not_of_the_tick_before(received):
    first = Participant(places("closed")[0])
    assert first.step(5, text_of("agent", 4)) == text_of("world", 5)
    with pytest.raises(ValueError, match="world at tick 5: expected 'agent 4"):
        first.step(5, received)


def test_speed_counts_from_the_first_step_of_anybody_to_the_last(tmp_path):
    for i, name in enumerate(NAMES):
        times = {"began_ns": i * 10**9, "ended_ns": 10 * 10**9 - i * 10**9}
        (tmp_path / f"{name}.json").write_text(json.dumps(times))
    assert ticks_per_s(tmp_path, 200) == pytest.approx(20)


def test_a_participant_that_fails_takes_the_others_with_it():
    lasting, failing = ([sys.executable, "-c", text] for text in ("input()", "raise SystemExit(3)"))
    with pytest.raises(RuntimeError, match="expected all participants to end well"):
        run_processes([lasting, failing])


def test_ratios_are_paired_with_the_best_of_a_family():
    speeds = {
        ("gslcosim", "closed"): [10.0, 40.0, 30.0],
        ("helics-zmq", "closed"): [1.0, 1.0, 100.0],
        ("helics-ipc", "closed"): [20.0, 20.0, 60.0],
    }
    assert bench_peers.ratios("HELICS", "closed", speeds) == ("helics-ipc", [0.5, 2.0, 0.5])
    assert bench_peers.ratios("mosaik", "closed", speeds) is None
    speeds |= {(name, "open"): rounds for (name, _), rounds in list(speeds.items())}
    assert "ipc 0.50 (0.50-2.00)" in bench_peers.table(speeds)
    assert json.loads(bench_peers.as_json(speeds))["ratios"][0]["median"] == 0.5
