"""A run is its inputs: run again without its agents it is the same to the bit, however it was run."""

import json
import os
import random
import signal

import pytest
from real_runs import AROUND_A_WALL, EVERY_VEHICLE, ROOT, TINY_ROOM, fly, fly_here, start, with_agent
from repeated_runs import replayed

SWARM = ROOT / "scenarios" / "swarm_tiny.yaml"
BELIEVER = ("--set", "agents[0].start={python: infotaxis}")


def assert_equal(past, again):
    assert again.exit_code == 0, again.errors
    assert again.result["comparison"]["equal"]
    assert again.result["comparison"]["ticks_compared"] == past.result["ticks"] + 1
    assert again.result["digest"] == past.result["digest"]
    assert again.result["agents"] == past.result["agents"]


@pytest.mark.tour
def test_a_run_of_many_processes_is_run_again_and_recorded_in_detail(tmp_path):
    """The gas is recorded ten times as often, for two seconds only; nothing else becomes another."""
    past = fly(TINY_ROOM, tmp_path / "past", is_recorded=True)
    assert_equal(past, replayed(past.run_dir, tmp_path / "again"))
    window = ("--gas-every", "0.1", "--from", "2", "--to", "4")
    detailed = replayed(past.run_dir, tmp_path / "detailed", *window, is_recorded=True)
    assert detailed.exit_code == 0
    assert detailed.result["comparison"]["equal"]
    assert detailed.result["agents"] == past.result["agents"]
    assert _ticks_of_gas(past.run_dir / "recording.rrd") >= {0, 10, 20, 30, 40, 50}
    assert _ticks_of_gas(detailed.run_dir / "recording.rrd") == set(range(20, 41))
    manifest = json.loads((detailed.run_dir / "manifest.json").read_text())
    assert manifest["replay_of"] == past.run_dir.name


def _ticks_of_gas(recording):
    from rerun.chunk import RrdReader

    from gslcosim_services.recorder.stream_table import FILAMENTS

    chunks = RrdReader(recording).store().stream().to_chunks()
    clouds = (chunk for chunk in chunks if str(chunk.entity_path) == f"/{FILAMENTS.entity}" and not chunk.is_static)
    return {tick for chunk in clouds for tick in chunk.to_record_batch().column("tick").to_pylist()}


@pytest.mark.parametrize("mode", ["lockstep", "{latency: 3}"])
def test_agents_that_are_asked_every_tick_are_replayed(tmp_path, mode):
    change = ("--set", f"agents[0].mode={mode}", "--set", "referee.stop.time_limit_s=8")
    past = fly_here(TINY_ROOM, tmp_path / "past", *change)
    assert_equal(past, replayed(past.run_dir, tmp_path / "again"))


@pytest.mark.parametrize("scenario", [EVERY_VEHICLE, AROUND_A_WALL, SWARM], ids=lambda path: path.stem)
def test_every_command_ways_and_radio_are_replayed(tmp_path, scenario):
    past = fly_here(scenario, tmp_path / "past", "--set", "referee.stop.time_limit_s=20")
    assert_equal(past, replayed(past.run_dir, tmp_path / "again"))


def test_beliefs_are_replayed(tmp_path):
    past = fly_here(TINY_ROOM, tmp_path / "past", *BELIEVER, "--set", "referee.stop.time_limit_s=10")
    assert any("belief" in line for line in (past.run_dir / "inputs.log").read_text().splitlines())
    assert_equal(past, replayed(past.run_dir, tmp_path / "again"))


@pytest.mark.parametrize("agent", ["giving_up", "crashing", "not_a_number"])
def test_what_agents_do_wrong_is_replayed(tmp_path, agent):
    """Refused answers and agents that are gone are inputs like any other."""
    # Python waits at its end for the threads of a session that was not closed: the crashed one is silent, too.
    change = ("--set", "referee.stop.time_limit_s=5", "--set", "agents[0].answer_within_s=10")
    past = fly(TINY_ROOM, tmp_path / "past", *with_agent(agent), *change)
    again = replayed(past.run_dir, tmp_path / "again")
    assert again.result["comparison"]["equal"], (past.result, again.result, again.errors)
    assert again.result["digest"] == past.result["digest"]


def test_a_run_that_was_interrupted_is_run_as_far_as_it_came(tmp_path):
    change = ("--set", "referee.success.within_m=0.001", "--set", "referee.stop.time_limit_s=3600")
    flight = start(TINY_ROOM, tmp_path / "past", *change)
    flight.wait_until_flying()
    os.kill(flight.process.pid, signal.SIGINT)
    past = flight.end()
    assert past.result["end_reason"] == "interrupted"
    again = replayed(past.run_dir, tmp_path / "again")
    assert again.exit_code == 0, again.errors
    assert again.result["ticks"] == past.result["ticks"]
    assert again.result["comparison"] == {
        "replay_of": past.run_dir.name, "ticks_compared": 0, "equal": False, "divergence": None, "snapshot_tick": None,
    }  # fmt: skip


@pytest.fixture(scope="module")
def past(tmp_path_factory):
    return fly_here(TINY_ROOM, tmp_path_factory.mktemp("past"))


def test_a_replay_may_end_sooner(past, tmp_path):
    again = replayed(past.run_dir, tmp_path, "--until", "3")
    assert again.exit_code == 0, again.errors
    assert again.result["end_reason"] == "cut"
    assert again.result["comparison"]["ticks_compared"] == 31
    assert again.result["comparison"]["equal"]


def test_a_log_that_was_changed_is_found_out(past, tmp_path):
    """One command is another, then one is missing: told with the tick at which the runs part."""
    log = past.run_dir / "inputs.log"
    kept = log.read_text()
    lines = kept.splitlines()
    fields = json.loads(lines[2])
    # With them the change would be named before the run is repeated.
    (past.run_dir / "checksums.json").rename(tmp_path / "checksums.json")
    log.write_text("\n".join([*lines[:2], json.dumps({**fields, "kind": "hold"}), *lines[3:]]) + "\n")
    changed = replayed(past.run_dir, tmp_path / "changed")
    log.write_text("\n".join(lines[:2]) + "\n")
    shorter = replayed(past.run_dir, tmp_path / "shorter")
    log.write_text(kept)
    (tmp_path / "checksums.json").rename(past.run_dir / "checksums.json")
    for again in (changed, shorter):
        assert again.exit_code == 5
        assert again.result["comparison"]["divergence"]["tick"] == fields["tick"]
        assert f"from tick {fields['tick']} on: participant agent_" in again.errors
    assert f"expected a command for tick {fields['tick']}, found none" in shorter.result["faults"][0]["text"]


def test_what_cannot_be_replayed_is_refused(past, tmp_path):
    manifest = past.run_dir / "manifest.json"
    kept = manifest.read_text()
    manifest.write_text(json.dumps({**json.loads(kept), "contract_hash": "another"}))
    refused = replayed(past.run_dir, tmp_path)
    manifest.write_text(kept)
    assert (refused.exit_code, refused.run_dir) == (2, None)
    assert "was another, flown by gslcosim" in refused.errors
    late = replayed(past.run_dir, tmp_path, "--until", "1e6")
    assert (late.exit_code, late.run_dir) == (2, None)
    assert "up to the run's end at" in late.errors


@pytest.mark.parametrize("case", [0, 1, *(pytest.param(case, marks=pytest.mark.soak) for case in range(2, 8))])
def test_random_runs_are_replayed(tmp_path, case):
    """Seeds, modes, vehicles and wind drawn at random, half of them in many processes."""
    rng = random.Random(case)
    change = [f"agents[0].mode={rng.choice(['on_request', 'lockstep', '{latency: 2}'])}"]
    change += [f"agents[0].vehicle.model={rng.choice(['iris', 'crazyflie'])}", "referee.stop.time_limit_s=6"]
    change += [f"gas.step_s={rng.choice([0.1, 0.05])}", f"tick_ms={rng.choice([100, 200])}"]
    arguments = [word for item in change for word in ("--set", item)]
    past = (fly if case % 2 else fly_here)(TINY_ROOM, tmp_path / "past", "--seed", str(rng.randrange(99)), *arguments)
    assert_equal(past, replayed(past.run_dir, tmp_path / "again"))
