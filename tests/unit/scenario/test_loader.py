"""Loading a scenario: where it comes from, and all of its problems at once."""

import pytest

from gslcosim.base.bundled import bundled_scenarios
from gslcosim.base.errors import ScenarioError
from gslcosim.base.problems import Problem
from gslcosim.scenario.loader import load_scenario
from gslcosim.scenario.problems import InvalidScenarioError


def test_a_loaded_scenario_says_where_it_came_from(scenario_file, tmp_path):
    path = scenario_file()
    loaded = load_scenario(path)
    assert (loaded.path, loaded.directory, loaded.name) == (path, tmp_path, "hall")
    assert loaded.text == path.read_text()


def test_a_bundled_scenario_is_loaded_by_name():
    loaded = load_scenario("warehouse_empty")
    assert loaded.scenario.agents[0].name == "beetle"
    assert loaded.path.name == "warehouse_empty.yaml"


def test_a_file_is_preferred_to_a_bundled_scenario_of_the_same_name(scenario_file, monkeypatch, tmp_path):
    scenario_file(name="tiny_room")
    monkeypatch.chdir(tmp_path)
    assert load_scenario("tiny_room").name == "hall"


@pytest.mark.parametrize(
    ("source", "expected"),
    [
        ("warehouse_emty", "warehouse_emty: expected a file or a bundled scenario (BUNDLED), found "
         "neither. Did you mean warehouse_empty?"),
        ("hal.yaml", "hal.yaml: expected a scenario file, found none. Did you mean hall.yaml?"),
        ("none/hall.yml", "none/hall.yml: expected a scenario file, found none."),
        ("warehouse_empty.yaml", "warehouse_empty.yaml: expected a scenario file, found none. warehouse_empty is "
         "bundled: give its name alone."),
        ("folder", "folder: expected a scenario file, was a folder."),
        ("latin", "latin: expected UTF-8 text, was something else from byte 7 on. Save the file as UTF-8."),
        ("empty.yaml", "empty.yaml:1: expected a block with the keys schema, name, seed, tick_ms, environment, wind, "
         "gas, agents, referee, recording, channels, services, participants, probes, events, pace, snapshots, "
         "restart, processes and ros2, was nothing."),
        ("list.yaml", "list.yaml:1: expected a block with the keys schema, name, seed, tick_ms, environment, wind, "
         "gas, agents, referee, recording, channels, services, participants, probes, events, pace, snapshots, "
         "restart, processes and ros2, was [1, 2]."),
    ],
)  # fmt: skip
def test_a_source_that_is_no_scenario_is_refused_with_a_remedy(scenario_file, tmp_path, monkeypatch, source, expected):
    scenario_file()
    (tmp_path / "folder").mkdir()
    (tmp_path / "latin").write_bytes(b"name: h\xe4ll")
    (tmp_path / "empty.yaml").write_text("# nothing\n")
    (tmp_path / "list.yaml").write_text("[1, 2]")
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ScenarioError) as refusal:
        load_scenario(source)
    assert str(refusal.value) == expected.replace("BUNDLED", ", ".join(bundled_scenarios()))


def test_a_byte_order_mark_is_not_part_of_the_text(scenario_file):
    path = scenario_file()
    path.write_bytes(b"\xef\xbb\xbf" + path.read_bytes())
    assert load_scenario(path).name == "hall"


def test_line_ends_may_be_those_of_windows(scenario_file):
    path = scenario_file()
    path.write_bytes(path.read_bytes().replace(b"\n", b"\r\n"))
    assert load_scenario(path).scenario == load_scenario(scenario_file(name="other.yaml")).scenario
    path.write_bytes(path.read_bytes().replace(b"name: hall", b"name: 5"))
    with pytest.raises(InvalidScenarioError) as refusal:
        load_scenario(path)
    assert refusal.value.problems[0].place.line == 2


def test_problems_come_in_the_order_of_the_file(problem_lines):
    lines = problem_lines(
        ("name: hall", "name: 5"), ("15, 10", "-15, 10"), ("name: nose", "name: 6"), ("[5, 1, 2]", "[5, 1]")
    )
    assert [line.split(":")[1] for line in lines[1:]] == ["2", "4", "7", "13"]


def far_away(scenario, directory):
    """A check of places that does not like any of them."""
    assert directory.is_dir()
    for i, agent in enumerate(scenario.agents):
        yield Problem(where=f"agents[{i}].vehicle.start_m", expected="home", found=f"{agent.vehicle.start_m}")


def test_further_checks_are_reported_with_their_lines_among_the_others(problem_lines):
    lines = problem_lines(("name: hall", "name: 5"), checks=[far_away])
    assert [line.partition(": expected")[0] for line in lines[1:]] == [
        "hall.yaml:2: name", "hall.yaml:11: agents[0].vehicle.start_m"
    ]  # fmt: skip
    assert problem_lines(checks=[far_away]) == [
        "hall.yaml:11: agents[0].vehicle.start_m: expected home, was (12.0, 9.0, 0.2)."
    ]


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("0.2]", "high]"), ("size_m", "size"), ("[5, 1, 2]", "[5]"), ("agents:\n  -", "agents:\n  - 5\n  -"),
        ("gas:\n", "gas: 5\nx:\n"), ("agents:", "agent:"), ("name: hall", "name: hall\nwind: {cell_m: -1}"),
    ],
)  # fmt: skip
def test_places_are_not_guessed_when_something_that_says_where_is_wrong(problem_lines, old, new):
    assert "expected home" not in "\n".join(problem_lines((old, new), checks=[far_away]))
