"""`gslcosim up`, with a run that is only told."""

import json

import pytest

from gslcosim.base.errors import SimulationFault
from gslcosim.cli.main import main
from gslcosim.runtime.status import RunResult, RunStatus

RESULT = {
    "run_id": "tiny_room-seed1-now",
    "valid": True,
    "end_reason": "success",
    "sim_time_s": 12.3,
    "wall_time_s": 3.2,
    "preparation_s": 2.5,
    "start_up_s": 0.4,
    "flight_wall_s": 0.1,
    "real_time_factor": 123.0,
    "faults": [],
    "sandboxes": {"beetle": "none"},
    "agents": [
        {
            "name": "beetle", "method": "dung_beetle", "success": True, "outcome": "success", "time_to_source_s": 12.3,
            "steps": 9, "path_length_m": 6.54, "straight_line_m": 3.1, "shortest_path_m": 3.2,
            "movement_overhead": 2.04, "directness": 0.49, "final_distance_m": 0.79, "declared_error_m": None,
        }
    ],
}  # fmt: skip


@pytest.fixture
def flight(monkeypatch, tmp_path):
    """A run that takes no time: keeps its arguments, reports three states, and ends as it is set to."""
    result = {"result": RESULT, "exit_code": 0}
    run_dir = tmp_path / "runs" / "tiny_room-seed1-now"
    run_dir.mkdir(parents=True)
    (run_dir / "recording.rrd").touch()

    def fly(loaded, *, report, **arguments):
        result.update(arguments, loaded=loaded)
        for state, fraction, sim_time_s in (("preparing", 0.5, 0.0), ("flying", None, 3.0), ("flying", None, 12.0)):
            report(RunStatus(state=state, fraction=fraction, sim_time_s=sim_time_s, real_time_factor=200.4))
        if result.get("error"):
            raise result["error"]
        return RunResult(exit_code=result["exit_code"], run_dir=run_dir, result=result["result"])

    monkeypatch.setattr("gslcosim.runtime.run.run_scenario", fly)
    return result


def test_the_scenario_is_run_as_the_options_say(flight, tmp_path):
    options = ["--seed", "8", "--set", "name=other", "--in-process", "--runs-dir", str(tmp_path)]
    assert main(["up", "tiny_room", *options]) == 0
    assert flight["loaded"].scenario.seed == 8
    assert flight["loaded"].scenario.name == "other"
    assert flight["processes"] == "one"
    assert flight["runs_dir"] == tmp_path


def test_other_hosts_are_let_in_as_the_options_say(flight, tmp_path):
    options = ["--listen", "tcp/0.0.0.0:1", "--listen", "tcp/0.0.0.0:2", "--no-services", "--join-dir", str(tmp_path)]
    assert main(["up", "tiny_room", *options]) == 0
    assert flight["network"].listen == ("tcp/0.0.0.0:1", "tcp/0.0.0.0:2")
    assert flight["network"].elsewhere == ("all",)
    assert flight["network"].join_dir == tmp_path


def test_services_elsewhere_are_named_in_one_word_or_several(flight):
    assert main(["up", "tiny_room", "--elsewhere", "fields,sensing", "--elsewhere", "referee", "--lease-s", "30"]) == 0
    assert flight["network"].elsewhere == ("fields", "sensing", "referee")
    assert flight["network"].lease_s == 30


def test_a_certificate_of_clients_alone_is_refused(flight, capsys):
    assert main(["up", "tiny_room", "--tls-client-ca", "ca.pem"]) == 2
    assert "--tls-certificate and --tls-key" in capsys.readouterr().err


def test_a_pipe_gets_a_line_for_each_state_and_the_figures_at_the_end(flight, capsys, tmp_path):
    assert main(["up", "tiny_room"]) == 0
    output = capsys.readouterr()
    run = tmp_path / "runs" / "tiny_room-seed1-now"
    assert output.err.splitlines() == [
        "tiny_room, seed 1: preparing",
        "tiny_room, seed 1: flying, 3.0 s simulated, 200 x real time",
    ]
    assert output.out.splitlines() == [
        "The source was found after 12.3 s of simulated time.",
        "",
        "agent    method        outcome   time to source   commands   path    overhead   distance at the end   sandbox",
        "beetle   dung_beetle   success   12.3 s           9          6.5 m   2.04       0.79 m                none",
        "",
        "speed      123 x real time",
        "time       3.2 s: 2.5 s room and wind, 0.1 s run, 0.6 s start and end",
        f"run        {run}",
        f"recording  {run}/recording.rrd",
        f"open it    gslcosim view {run}",
    ]


def test_json_is_the_result_and_nothing_else(flight, capsys):
    assert main(["up", "tiny_room", "--json"]) == 0
    output = capsys.readouterr()
    assert json.loads(output.out) == RESULT
    assert output.err == ""


def test_quiet_says_nothing_when_all_is_well(flight, capsys):
    assert main(["up", "tiny_room", "--quiet"]) == 0
    output = capsys.readouterr()
    assert (output.out, output.err) == ("", "")


@pytest.mark.parametrize("option", ["--quiet", "--json"])
def test_a_fault_is_reported_in_any_case_and_returns_the_runs_exit_code(flight, capsys, option):
    faults = [{"participant": "fields", "tick": 7, "text": "was killed by SIGKILL"}]
    flight.update(result={**RESULT, "valid": False, "faults": faults, "agents": []}, exit_code=3)
    assert main(["up", "tiny_room", option]) == 3
    assert capsys.readouterr().err == "fields: was killed by SIGKILL\n"


def test_a_fault_of_an_agent_is_part_of_a_valid_run(flight, capsys):
    faults = [{"participant": "agent beetle", "tick": 7, "text": "ended with exit code 1"}]
    agent = {**RESULT["agents"][0], "outcome": "agent_failed", "time_to_source_s": None, "movement_overhead": None}
    flight.update(result={**RESULT, "end_reason": "agent_failed", "faults": faults, "agents": [agent]}, exit_code=1)
    assert main(["up", "tiny_room"]) == 1
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "The agent failed after 12.3 s of simulated time."
    assert lines[3].split("   ")[:3] == ["beetle", "dung_beetle", "agent failed"]
    assert "agent beetle, tick 7: ended with exit code 1" in lines
    assert lines[-1].startswith("logs       ")


def test_an_error_before_the_run_is_reported_without_a_traceback(flight, capsys):
    flight["error"] = SimulationFault("router: expected to listen, could not.")
    assert main(["up", "tiny_room", "--quiet"]) == 3
    assert capsys.readouterr().err == "router: expected to listen, could not.\n"


def test_problems_of_the_scenario_are_reported_before_anything_starts(flight, capsys):
    assert main(["up", "tiny_room", "--set", "gas.sources[0].position_m=[99, 1, 1]"]) == 2
    assert "outside the room" in capsys.readouterr().err
    assert "loaded" not in flight
