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
