"""Whatever a scenario holds, its resolved text reads back the same."""

import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from gslcosim.scenario import dump_resolved, load_scenario
from gslcosim.scenario.serialization import read_yaml

SCENARIO = load_scenario("tiny_room").scenario


@settings(max_examples=40)
@given(st.text(st.characters(codec="utf-8", exclude_categories=["Cc", "Cs"]), min_size=1))
def test_any_text_is_written_so_that_yaml_1_1_and_1_2_read_it_back(text):
    """Agents' arguments such as `yes`, `1e-3` or `12:30` stay text for every reader."""
    start = SCENARIO.agents[0].start.model_copy(update={"python": None, "command": ("sh", text)})
    agents = (SCENARIO.agents[0].model_copy(update={"start": start}),)
    dumped = dump_resolved(SCENARIO.model_copy(update={"agents": agents}))
    for values in (yaml.safe_load(dumped), read_yaml(dumped, source="dump").values):
        assert values["agents"][0]["start"]["command"] == ["sh", text]
