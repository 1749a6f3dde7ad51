"""Several agents: one digest however they are spread over processes, and nobody's end is another's."""

import json
import os
import signal
import sys

import pytest
import yaml
from real_runs import AGENTS, ROOT, fly, fly_here, start, wait_a_moment

SWARM = ROOT / "scenarios" / "swarm_tiny.yaml"


def digest_of(ended):
    assert ended.result.get("valid"), ended.errors
    assert ended.result["faults"] == []
    return ended.result["digest"]


def outcomes_of(ended):
    return {agent["name"]: agent["outcome"] for agent in ended.result["agents"]}


def starting(i, *command, **more):
    return ("--set", f"agents[{i}].start={json.dumps({'command': [sys.executable, *map(str, command)], **more})}")


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    """The bundled swarm as separate processes."""
    return fly(SWARM, tmp_path_factory.mktemp("swarm"))


def test_processes_and_one_process_agree(flown, tmp_path):
    assert digest_of(fly_here(SWARM, tmp_path)) == digest_of(flown)


def test_it_does_not_matter_who_shares_a_process(flown, tmp_path):
    """The three each in a process of their own, and all in one."""
    own = fly(SWARM, tmp_path / "own", "--set", "agents[1].start={python: calling_beetle}")
    shared = fly(SWARM, tmp_path / "shared", "--set", "agents[2].start={process_of: beetle_1}")
    assert digest_of(own) == digest_of(shared) == digest_of(flown)


@pytest.mark.parametrize("flying", [fly, fly_here])
def test_a_process_behind_the_gateway_runs_several(flown, tmp_path, flying):
    change = starting(0, AGENTS / "framed_swarm.py", door="stdio", format="json")
    assert digest_of(flying(SWARM, tmp_path, *change)) == digest_of(flown)


def test_agents_that_share_what_they_know_run_the_same_again(tmp_path):
    """What each says depends on all that the others have seen before."""
    change = ["--set", f"agents[0].start={{python: {AGENTS / 'sharing.py'}}}"]
    for i in range(3):
        change += ["--set", f"agents[{i}].mode=lockstep"]
    change += ["--set", "agents[2].start={process_of: beetle_1}", "--set", "referee.stop.time_limit_s=4"]
    several = fly(SWARM, tmp_path / "several", *change)
    assert digest_of(several) == digest_of(fly_here(SWARM, tmp_path / "one", *change))


def test_who_is_called_finds_the_source_and_who_is_not_does_not(flown, tmp_path):
    silent = fly_here(SWARM, tmp_path, "--set", "channels=[]")
    assert outcomes_of(flown)["beetle_2"] == "success"
    assert outcomes_of(silent)["beetle_2"] == "time_limit"


def test_what_is_sent_is_in_the_input_log(flown):
    commands = [json.loads(line) for line in (flown.run_dir / "inputs.log").read_text().splitlines()]
    sent = [message for command in commands for message in command.get("outgoing", ())]
    assert sent
    assert all(message["channel"] == "radio" and message["to"] == "all" for message in sent)


def test_one_agents_crash_does_not_end_the_others(tmp_path):
    ended = fly(SWARM, tmp_path, *starting(2, AGENTS / "crashing.py"), "--set", "agents[2].answer_within_s=10")
    assert ended.result["valid"], ended.errors
    assert outcomes_of(ended) | {"beetle_3": "agent_failed"} == outcomes_of(ended)
    assert outcomes_of(ended)["beetle_1"] == "success"
    assert "lost my way" in ended.result["faults"][0]["text"]


@pytest.mark.parametrize("flying", [fly, fly_here])
def test_one_agents_failure_does_not_end_those_in_its_process(tmp_path, flying):
    change = ("--set", f"agents[0].start={{python: {AGENTS / 'second_fails.py'}}}", "--set",
              "referee.stop.time_limit_s=15")  # fmt: skip
    ended = flying(SWARM, tmp_path, *change)
    assert ended.result["valid"], ended.errors
    assert {name: outcomes_of(ended)[name] for name in ("beetle_1", "beetle_2")} == {
        "beetle_1": "time_limit",
        "beetle_2": "agent_failed",
    }
    faults = ended.result["faults"]
    assert {fault["participant"] for fault in faults} == {"agent beetle_2"}
    assert "lost my way" in faults[0]["text"]


def test_a_killed_process_takes_its_own_agents_and_no_others(tmp_path):
    """The others go on: they are asked and answer."""
    flight = start(
        SWARM,
        tmp_path,
        *starting(0, AGENTS / "second_fails.py"),
        *("--set", "agents[1].start={process_of: beetle_3}", "--set", "agents[1].name=beetle_4"),
        *starting(2, AGENTS / "second_fails.py", "of_two"),
        *("--set", "referee.stop.time_limit_s=3000"),
    )
    flight.wait_until_flying()
    os.kill(flight.child("of_two"), signal.SIGKILL)
    log = next(tmp_path.glob("*/inputs.log"))
    while len(after_failures(log, n_failures=2)) < 10:
        assert flight.process.poll() is None, flight.process.communicate()
        wait_a_moment()
    assert {line["agent"] for line in after_failures(log, n_failures=2)} == {"beetle_1"}
    flight.process.send_signal(signal.SIGINT)
    faults = flight.end().result["faults"]
    assert {fault["participant"] for fault in faults} == {"agent beetle_3", "agent beetle_4"}
    assert all("SIGKILL" in fault["text"] for fault in faults)


def after_failures(log, n_failures):
    """Return what was commanded after that many agents had failed; nothing before."""
    lines = [json.loads(line) for line in log.read_text().splitlines() if line.endswith("}")]
    failed = [i for i, line in enumerate(lines) if line["kind"] == "failed"]
    return lines[failed[n_failures - 1] + 1 :] if len(failed) >= n_failures else []


def test_vehicles_that_start_in_each_other_are_refused(tmp_path):
    ended = fly_here(SWARM, tmp_path, "--set", "agents[1].vehicle.start_m=[5.2, 0.8, 0.05]")
    assert ended.exit_code == 2
    assert "agents[1].vehicle.start_m: expected at least 0.14 m" in ended.errors


@pytest.mark.slow
def test_a_hundred_agents_fly_to_the_end_in_one_process_and_in_several(tmp_path):
    """They keep apart above one another, and share four processes."""
    tree = yaml.safe_load((ROOT / "scenarios" / "warehouse_empty.yaml").read_text())
    (agent,) = tree["agents"]
    for i in range(100):
        start_m, height_m = [1.4 + 1.3 * (i % 10), 1.4 + 1.3 * (i // 10), 0.2], round(0.8 + 0.06 * i, 2)
        vehicle = {**agent["vehicle"], "start_m": start_m, "search_height_m": height_m, "separation_m": 0.6}
        shared = {"start": {"process_of": f"beetle_{i % 4}"}} if i >= 4 else {}
        tree["agents"] += [{**agent, "name": f"beetle_{i}", "vehicle": vehicle, **shared}]
    del tree["agents"][0]
    tree["referee"]["stop"]["time_limit_s"] = 15
    scenario = tmp_path / "hundred.yaml"
    scenario.write_text(yaml.safe_dump(tree))
    one = fly_here(scenario, tmp_path / "one")
    assert one.result["sim_time_s"] == 15
    assert digest_of(fly(scenario, tmp_path / "several")) == digest_of(one)
