"""`gslcosim validate`"""

import json
import os

import pytest

from gslcosim.cli import arguments
from gslcosim.cli.main import main
from gslcosim.scenario import Scenario, load_scenario


def test_a_valid_scenario_is_confirmed(capsys):
    assert main(["validate", "tiny_room"]) == 0
    assert capsys.readouterr().out == "tiny_room: valid. Scenario tiny_room, seed 1, agents: beetle.\n"


def test_problems_are_reported_on_stderr(capsys):
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
    printed = json.loads(capsys.readouterr().out)
    assert printed["valid"] is True
    assert Scenario.model_validate_json(json.dumps(printed["scenario"])) == load_scenario("tiny_room", seed=9).scenario


def test_the_resolved_scenario_is_printed_as_yaml(capsys, tmp_path):
    assert main(["validate", "tiny_room", "--resolved"]) == 0
    file = tmp_path / "resolved.yaml"
    file.write_text(capsys.readouterr().out)
    assert load_scenario(file).scenario == load_scenario("tiny_room").scenario


@pytest.mark.parametrize(
    ("change", "place", "expected"),
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
def test_places_are_checked_against_the_room(capsys, change, place, expected):
    assert main(["validate", "tiny_room", "--set", change]) == 2
    error = capsys.readouterr().err
    assert f"{place}: expected " in error
    assert expected in error


def test_problems_of_places_and_others_come_together(capsys):
    changes = ["gas.sources[0].position_m=[60, 2, 1]", "agents[0].sensors[0].model=nose", "name=A B"]
    assert main(["validate", "tiny_room", *(f"--set={change}" for change in changes)]) == 2
    lines = capsys.readouterr().err.splitlines()
    assert [line.partition(": expected")[0] for line in lines[1:]] == [
        "--set: agents[0].sensors[0].model", "--set: gas.sources[0].position_m", "--set: name"
    ]  # fmt: skip


CAMERAS = ["agents[0].sensors[0]={model: camera, name: eye}", "agents[0].sensors[1]={model: depth_camera, name: depth}"]


@pytest.mark.slow
@pytest.mark.parametrize("command", ["validate", "up"])
def test_cameras_where_nothing_draws_are_problems_of_the_scenario(capsys, monkeypatch, command):
    """With a screen's driver chosen there is neither EGL nor OSMesa."""
    monkeypatch.setenv("PYOPENGL_PLATFORM", "glx")
    changes = [f"--set={change}" for change in (*CAMERAS, "agents[0].start={attach: true}")]
    assert main([command, "tiny_room", *changes]) == 2
    lines = capsys.readouterr().err.splitlines()
    assert [line.partition(", was")[0] for line in lines[1:]] == [
        f"--set: agents[0].sensors[{i}].model: expected no {model} on a machine without EGL and OSMesa, which draw its "
        "pictures"
        for i, model in enumerate(("camera", "depth_camera"))
    ]
    assert "apt-get install" in lines[1]


def test_a_driver_that_crashes_is_reported(monkeypatch):
    monkeypatch.setattr(arguments.sys, "executable", "false")
    assert arguments.rendering_unavailable_reason() == "The driver crashed; `gslcosim doctor` tells more."


@pytest.mark.parametrize("command", ["validate", "up"])
def test_vehicles_that_start_within_each_other_and_programs_are_reported_together(capsys, command):
    changes = [
        "agents[1].vehicle.start_m=[3, 3, 0.2]", "agents[0].vehicle.start_m=[3.1, 3, 0.2]",
        "agents[0].start={command: [no-such-program]}",
    ]  # fmt: skip
    assert main([command, "swarm_tiny", *(f"--set={change}" for change in changes)]) == 2
    lines = capsys.readouterr().err.splitlines()
    assert "--set: agents[1].vehicle.start_m: expected at least 0.14 m" in "\n".join(lines)
    assert "--set: agents[0].start.command[0]: expected a program on the PATH" in "\n".join(lines)


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        pytest.param("name: nose", "name: {}", "agents[0].sensors[0].name: expected a name: a small letter, then small "
                     "letters, digits and _, at most 40 in all, was {}.", id="block"),
        pytest.param("seed: 1", f"seed: 0x{'f' * 4000}", "seed: expected a whole number from 0 to 2147483648, was "
                     f"'0x{'f' * 54}....", id="digits"),
        pytest.param("seed: 1", f"seed: {'[' * 100_000}", "expected lists and blocks at most 32 deep, was a nest of "
                     "more than 64 levels.", id="brackets"),
        pytest.param("seed: 1", f"seed: 1 #{'x' * 2_000_000}", "expected a file that can be read, was one that cannot "
                     "(more than 2000000 bytes).", id="bytes"),
    ],
)  # fmt: skip
def test_values_of_any_kind_and_size_are_reported_in_one_sentence(tmp_path, capsys, old, new, expected):
    text = load_scenario("tiny_room").text
    assert old in text
    path = tmp_path / "a.yaml"
    path.write_text(text.replace(old, new, 1))
    assert main(["validate", str(path)]) == 2
    output = capsys.readouterr()
    assert output.out == ""
    assert len(output.err.splitlines()) == 1
    assert output.err.endswith(f": {expected}\n")


def test_a_pipe_is_no_scenario(tmp_path, capsys):
    os.mkfifo(tmp_path / "a.yaml")
    assert main(["validate", str(tmp_path / "a.yaml")]) == 2
    assert "expected a scenario file, was a pipe" in capsys.readouterr().err


def test_of_thousands_of_problems_the_first_are_reported(tmp_path, capsys):
    path = tmp_path / "a.yaml"
    path.write_text("".join(f"k{i}: 1\n" for i in range(2000)))
    assert main(["validate", str(path)]) == 2
    lines = capsys.readouterr().err.splitlines()
    assert 100 < len(lines) < 110
    assert "expected fewer problems, was 190" in "".join(lines[:2])
