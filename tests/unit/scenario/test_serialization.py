"""A scenario as resolved."""

import pytest
import yaml

from gslcosim.base.bundled import bundled_scenarios
from gslcosim.scenario import Scenario, dump_resolved, load_scenario
from gslcosim.scenario.serialization import read_yaml


@pytest.mark.parametrize("name", sorted(bundled_scenarios()))
def test_a_resolved_scenario_loads_back_equal(name, tmp_path):
    overrides = ["wind.average_from_s=", "gas.step_s=1e-1", "agents[0].mode={latency: 2}"]
    scenario = load_scenario(name, overrides=overrides, seed=3).scenario
    file = tmp_path / "resolved.yaml"
    file.write_text(dump_resolved(scenario))
    assert load_scenario(file).scenario == scenario


def test_every_default_is_written(scenario_file):
    scenario = load_scenario(scenario_file()).scenario
    values = yaml.safe_load(dump_resolved(scenario))
    assert values["agents"][0]["vehicle"]["hold_s"] == 2.0
    assert values["wind"]["max_time_s"] == 120.0
    assert Scenario.model_validate(values) == scenario


@pytest.mark.parametrize("text", ["yes", "1e-3", "12:30", "2024-01-01", "~", "", "0o17", "1_000", "null", "=", "<<"])
def test_texts_that_look_like_other_things_are_quoted(text):
    scenario = load_scenario("tiny_room").scenario
    start = scenario.agents[0].start.model_copy(update={"python": None, "command": ("sh", text)})
    agents = (scenario.agents[0].model_copy(update={"start": start}),)
    dumped = dump_resolved(scenario.model_copy(update={"agents": agents}))
    for values in (yaml.safe_load(dumped), read_yaml(dumped, source="dump").values):
        assert values["agents"][0]["start"]["command"] == ["sh", text]


def test_with_a_folder_relative_paths_become_absolute(scenario_file, tmp_path):
    (tmp_path / "mine.py").touch()
    (tmp_path / "rooms").mkdir()
    loaded = load_scenario(
        scenario_file(
            ("{python: dung_beetle}", "{python: mine.py}"),
            ("layout: {kind: warehouse_empty, size_m: [15, 10, 8]}", "path: rooms"),
        )
    )
    values = yaml.safe_load(dump_resolved(loaded.scenario, directory=loaded.directory))
    assert values["agents"][0]["start"]["python"] == str(tmp_path / "mine.py")
    assert values["environment"]["path"] == str(tmp_path / "rooms")


def test_with_a_folder_programs_become_absolute_and_names_stay(scenario_file, tmp_path):
    (tmp_path / "prog").write_text("#!/bin/sh\n")
    (tmp_path / "prog").chmod(0o755)
    for start, key, expected in (
        ("{command: [./prog, ./x]}", "command", [str(tmp_path / "prog"), "./x"]),
        ("{command: [sh, ./x]}", "command", ["sh", "./x"]),
        ("{python: dung_beetle}", "python", "dung_beetle"),
    ):
        loaded = load_scenario(scenario_file(("{python: dung_beetle}", start)))
        values = yaml.safe_load(dump_resolved(loaded.scenario, directory=loaded.directory))
        assert values["agents"][0]["start"][key] == expected
