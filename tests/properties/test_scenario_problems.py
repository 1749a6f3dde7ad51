"""Whatever a scenario's text says, the answer is a scenario or its problems with their places."""

import json

from hypothesis import given, settings
from hypothesis import strategies as st

from gslcosim.errors import ScenarioError
from gslcosim.scenario import LoadedScenario, load_scenario
from gslcosim.scenario.problems import InvalidScenarioError
from gslcosim.scenario.yaml_tree import read_yaml

PATHS = (
    "schema", "name", "seed", "tick_ms", "environment", "environment.layout", "environment.layout.size_m",
    "environment.layout.obstacles", "environment.path", "wind", "wind.cell_m", "wind.average_from_s", "gas",
    "gas.gas", "agents[0]",
    "gas.step_s", "gas.warm_up_s", "gas.sources", "gas.sources[0]", "gas.sources[0].position_m[1]", "agents",
    "agents[0].name", "agents[0].start", "agents[0].start.python", "agents[0].start.command", "agents[0].mode",
    "agents[0].vehicle", "agents[0].vehicle.start_m", "agents[0].sensors", "agents[0].sensors[0].model", "referee.stop",
    "recording", "recording.gas_every_s", "unknown", "wind.unknown.deeper[0]",
)  # fmt: skip
SCALARS = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(),
    st.floats(),
    st.text(max_size=8),
    st.sampled_from(["2 m", "", "a b", "../x"]),
)
VALUES = st.recursive(
    SCALARS,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=6,
)


def answer_to(source, **options):
    """Return the scenario, or the text of its problems."""
    try:
        return load_scenario(source, **options)
    except ScenarioError as error:
        return str(error)


@settings(max_examples=100)
@given(st.dictionaries(st.sampled_from(PATHS), VALUES, max_size=4))
def test_any_values_anywhere_give_a_scenario_or_problems(changes):
    answer = answer_to("tiny_room", overrides=[f"{path}={json.dumps(value)}" for path, value in changes.items()])
    if not isinstance(answer, LoadedScenario):
        lines = answer.splitlines()
        assert all(": expected " in line and ", was " in line for line in (lines[1:] or lines))


@settings(max_examples=200)
@given(st.text(st.characters(codec="utf-8"), max_size=60))
def test_any_text_gives_values_or_problems(text):
    told = "any.yaml:"
    try:
        read_yaml(text, source="any.yaml")
    except InvalidScenarioError as error:
        told = str(error)
    assert told.startswith("any.yaml:")


@settings(max_examples=100)
@given(data=st.data())
def test_a_file_with_a_piece_cut_out_gives_a_scenario_or_problems(tmp_path_factory, data):
    text = load_scenario("tiny_room").text
    start = data.draw(st.integers(0, len(text)))
    length = data.draw(st.integers(0, 40))
    path = tmp_path_factory.mktemp("cut") / "cut.yaml"
    path.write_text(text[:start] + text[start + length :])
    assert answer_to(path)
