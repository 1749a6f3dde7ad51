"""`gslcosim validate`"""

import json

import pytest

from gslcosim.cli.main import main
from gslcosim.scenario import Scenario, load_scenario


def test_a_valid_scenario_is_confirmed(capsys):
    assert main(["validate", "tiny_room"]) == 0
    assert capsys.readouterr().out == "tiny_room: valid. Scenario tiny_room, seed 1, agents: beetle.\n"


def test_problems_are_told_on_stderr(capsys):
    assert main(["validate", "tiny_room", "--set", "wind.cell=1", "--set", "tick_ms=3"]) == 2
    output = capsys.readouterr()
    assert output.out == ""
    assert "--set: wind.cell: expected one of the keys" in output.err
    assert "--set: tick_ms: expected a multiple of the physics step of 4 ms, was 3. Nearest: 4 or 8." in output.err


def test_problems_as_json_are_the_whole_of_stdout(capsys):
    assert main(["validate", "tiny_room", "--json", "--set", "agents[0].vehicle.hold_s=-1"]) == 2
    output = capsys.readouterr()
    assert output.err == ""
    assert json.loads(output.out) == {
        "valid": False,
        "problems": [
            {
                "source": "--set",
                "line": None,
                "path": "agents[0].vehicle.hold_s",
                "expected": "a number of at least 0 in seconds",
                "found": "-1",
                "remedy": "",
            }
        ],
    }


def test_a_valid_scenario_as_json_is_resolved(capsys):
    assert main(["validate", "tiny_room", "--json", "--seed", "9"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["valid"] is True
    assert Scenario.model_validate_json(json.dumps(told["scenario"])) == load_scenario("tiny_room", seed=9).scenario


def test_the_resolved_scenario_is_printed_as_yaml(capsys, tmp_path):
    assert main(["validate", "tiny_room", "--resolved"]) == 0
    file = tmp_path / "resolved.yaml"
    file.write_text(capsys.readouterr().out)
    assert load_scenario(file).scenario == load_scenario("tiny_room").scenario


@pytest.mark.parametrize(
    ("change", "place", "told"),
    [
        ("gas.sources[0].position_m=[60, 2, 1]", "gas.sources[0].position_m", "outside the room"),
        ("environment.layout.obstacles=[{name: crate, min_m: [1, 1, 0], max_m: [2, 3, 2]}]",
         "gas.sources[0].position_m",
         "inside crate"),
        ("agents[0].vehicle.start_m=[60, 2, 1]", "agents[0].vehicle.start_m", "outside the room"),
        ("environment.layout.obstacles=[{name: crate, min_m: [4, 2, 0], max_m: [5, 3, 1]}]",
         "agents[0].vehicle.start_m",
         "crate"),
        ("agents[0].vehicle.search_height_m=5", "agents[0].vehicle.search_height_m", "ceiling"),
    ],
)  # fmt: skip
def test_places_are_checked_against_the_room(capsys, change, place, told):
    assert main(["validate", "tiny_room", "--set", change]) == 2
    error = capsys.readouterr().err
    assert f"{place}: expected " in error
    assert told in error


def test_problems_of_places_and_others_come_together(capsys):
    changes = ["gas.sources[0].position_m=[60, 2, 1]", "agents[0].sensors[0].model=nose", "name=A B"]
    assert main(["validate", "tiny_room", *(f"--set={change}" for change in changes)]) == 2
    lines = capsys.readouterr().err.splitlines()
    assert [line.partition(": expected")[0] for line in lines[1:]] == [
        "--set: agents[0].sensors[0].model", "--set: gas.sources[0].position_m", "--set: name"
    ]  # fmt: skip
