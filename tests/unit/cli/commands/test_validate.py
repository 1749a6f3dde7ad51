"""`gslcosim validate`"""

import json
import os

import pytest

from gslcosim.base.bundled import bundled_agents
from gslcosim.cli.main import main
from gslcosim.runtime import rendering
from gslcosim.runtime.processes.sandbox.bubblewrap import find_bubblewrap_failure
from gslcosim.scenario import Scenario, load_scenario


def test_a_valid_scenario_is_confirmed(capsys):
    assert main(["validate", "tiny_room"]) == 0
    assert capsys.readouterr().out == "tiny_room: valid. Scenario tiny_room, seed 1, agents: beetle.\n"


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
    monkeypatch.setattr(rendering, "build_python_command", lambda *words: ["false", *words])
    assert rendering.rendering_unavailable_reason() == "The driver crashed; `gslcosim doctor` tells more."


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


WIND_FILE = ["--set=wind.solver={file: WIND}", "--set=wind.cell_m=0.5"]


@pytest.mark.parametrize(
    ("content", "told"),
    [(None, "was missing"), ("1,2\n", "expected"), ("u,v,w\nx,0,0\n", "expected")],
)
def test_wind_that_cannot_be_read_is_a_problem_of_the_scenario(capsys, tmp_path, content, told):
    path = tmp_path / "wind.csv"
    if content is not None:
        path.write_text(content)
    assert main(["validate", "tiny_room", *(each.replace("WIND", str(path)) for each in WIND_FILE)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("--set: wind.solver.file: expected wind that fits the room, was ")
    assert told in line


@pytest.fixture
def without_bubblewrap(monkeypatch):
    """A machine on which bubblewrap is not found, whatever this process knows of it already."""
    monkeypatch.setenv("PATH", "")
    find_bubblewrap_failure.cache_clear()
    yield
    find_bubblewrap_failure.cache_clear()


@pytest.mark.usefixtures("without_bubblewrap")
@pytest.mark.parametrize("command", ["validate", "up"])
def test_demands_that_cannot_be_met_are_reported_together(capsys, monkeypatch, command):
    monkeypatch.delenv("GONE", raising=False)
    changes = ["agents[0].sandbox=bubblewrap", "agents[0].environment={GONE: null}"]
    assert main([command, "tiny_room", *(f"--set={change}" for change in changes)]) == 2
    lines = capsys.readouterr().err.splitlines()
    assert [line.partition(", ")[0] for line in lines[1:]] == [
        "--set: agents[0].environment.GONE: expected a variable that is set where gslcosim starts",
        "--set: agents[0].sandbox: expected bubblewrap on this machine",
    ]


SUITE = """schema: gslcosim/suite/1
name: s
scenarios: [tiny_rom, tiny_room]
entries:
  - {name: a, start: {python: bad.py}}
  - {name: b, start: {python: dung_beetl}}
  - {name: c, start: {python: dung_beetle}, parameters: {leg: 1}, parameters_in: {tiny_room: {eps: x}}}
"""


@pytest.mark.parametrize("command", [["validate"], ["bench", "plan"], ["bench", "run"]])
def test_a_suite_tells_all_problems_of_scenarios_and_entries_at_once(capsys, tmp_path, command):
    (tmp_path / "bad.py").write_text("def step(:\n")
    (tmp_path / "suite.yaml").write_text(SUITE)
    assert main([*command, str(tmp_path / "suite.yaml")]) == 2
    _, *lines = capsys.readouterr().err.splitlines()
    assert [line.removeprefix(f"{tmp_path}/").partition(": expected")[0] for line in lines] == [
        "suite.yaml:3: scenarios[0]",
        "suite.yaml:5: entries[0].start.python",
        "suite.yaml:6: entries[1].start.python",
        "suite.yaml:7: entries[2].parameters.leg",
        "suite.yaml:7: entries[2].parameters_in.tiny_room.eps",
    ]


@pytest.mark.parametrize("command", [["validate"], ["bench", "plan"]])
def test_a_suite_tells_what_is_wrong_in_all_cases_at_once(capsys, tmp_path, command):
    entries = (
        "[{name: a, start: {python: oracle}, knows: {}}, {name: b, start: {python: surge_cast}, sensors: by_method}]"
    )
    (tmp_path / "suite.yaml").write_text(
        "schema: gslcosim/suite/1\nname: s\nanchors: []\n"
        f"scenarios: [tiny_room, {{source: warehouse_empty, set: {{wind.cell: 1}}}}]\nentries: {entries}\n"
    )
    assert main([*command, str(tmp_path / "suite.yaml")]) == 2
    _, *lines = capsys.readouterr().err.splitlines()
    assert [line.partition("scenarios")[2].partition(": expected")[0] for line in lines] == [
        "[0] tiny_room: entry a: agents[0].knows", "[1] warehouse_empty: wind.cell"
    ]  # fmt: skip


CARD = """schema: gslcosim/method/1
title: X
family: reactiv
summary: flies
paper: none
needs: {sensors: [gaz]}
includes: [nope]
parameters:
  a: {default: null, origin: x, meaning: y}
  b: {default: 3, max: 2, origin: x, meaning: y}
"""


def test_a_card_tells_all_its_problems_with_their_lines(capsys, tmp_path):
    (tmp_path / "method.yaml").write_text(CARD)
    assert main(["validate", str(tmp_path), "--json"]) == 2
    printed = json.loads(capsys.readouterr().out)
    assert [(each["line"], each["path"]) for each in printed["problems"]] == [
        (3, "family"), (6, "needs.sensors"), (7, "includes"), (9, "parameters.a.type"), (10, "parameters.b.default")
    ]  # fmt: skip
    assert printed["problems"][0]["remedy"] == "Did you mean reactive?"


def test_a_program_beside_a_card_is_parsed(capsys, tmp_path):
    (tmp_path / "method.yaml").write_text(bundled_agents()["surge_cast"].with_name("method.yaml").read_text())
    assert main(["validate", str(tmp_path / "method.yaml")]) == 0
    (tmp_path / "agent.py").write_text("def step(:\n")
    assert main(["validate", str(tmp_path / "method.yaml")]) == 2
    assert "expected a Python file that can be parsed, was 'agent.py'" in capsys.readouterr().err


TRAINING = """schema: gslcosim/train/1
name: t
family: open_halls
trainer: {kind: method, method: c_pso, robots: 90, ranges: {inertia: [1, 0]}}
cases: {training: 30000}
"""


@pytest.mark.parametrize("command", [["validate"], ["train"]])
def test_a_train_file_tells_all_its_problems_at_once(capsys, tmp_path, command):
    path = tmp_path / "t.train.yaml"
    path.write_text(TRAINING)
    assert main([*command, str(path)]) == 2
    _, *lines = capsys.readouterr().err.splitlines()
    assert [line.removeprefix(f"{tmp_path}/").partition(": expected")[0] for line in lines] == [
        "t.train.yaml:4: trainer.ranges.inertia",
        "t.train.yaml:4: trainer.robots",
        "t.train.yaml:5: cases.training",
    ]


@pytest.mark.parametrize("name", ["smoke", "surge_cast", "open_halls", "open_halls_table"])
def test_bundled_files_of_each_kind_are_valid(capsys, name):
    assert main(["validate", name]) == 0
    assert capsys.readouterr().out.startswith(f"{name}: valid. ")


def test_options_that_change_a_scenario_are_refused_with_other_files(capsys):
    assert main(["validate", "surge_cast", "--resolved"]) == 2
    assert "--resolved: expected a scenario with it, was the file of a method card" in capsys.readouterr().err
