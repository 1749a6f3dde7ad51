"""Whatever a scenario's text says, the answer is a scenario or its problems with their places."""

import json

from hypothesis import given, settings
from hypothesis import strategies as st

from gslcosim.base.bundled import bundled_scenarios
from gslcosim.base.errors import ScenarioError
from gslcosim.cli.main import main
from gslcosim.scenario import LoadedScenario, load_scenario
from gslcosim.scenario.problems import InvalidScenarioError
from gslcosim.scenario.serialization import read_yaml

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
# What paths, numbers and sets stumble over.
TRAPS = st.sampled_from(
    ["a\0b", "~nobody_here/x", "x" * 5000, "/dev/zero", "\x1b[2J", 10**30, "random", {"a": {}}, [[]], [{}], 1e300]
)
VALUES = st.recursive(
    SCALARS | TRAPS,
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


def paths_in(value, at=()):
    """Yield the keys and indices that lead to each value of a tree, its root first."""
    yield at
    inner = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, item in inner:
        yield from paths_in(item, (*at, key))


def replaced(value, at, other):
    """Return a tree with another value at a place."""
    if not at:
        return other
    pairs = value.items() if isinstance(value, dict) else enumerate(value)
    content = {key: replaced(item, at[1:], other) if key == at[0] else item for key, item in pairs}
    return content if isinstance(value, dict) else list(content.values())


@settings(max_examples=80)
@given(data=st.data())
def test_any_value_in_place_of_any_other_gives_a_scenario_or_problems(tmp_path_factory, data):
    bundled = bundled_scenarios()
    file = bundled[data.draw(st.sampled_from(sorted(bundled)))]
    values = read_yaml(file.read_text(encoding="utf-8"), source=str(file)).values
    for _ in range(data.draw(st.integers(1, 3))):
        values = replaced(values, data.draw(st.sampled_from(list(paths_in(values)))), data.draw(VALUES))
    path = tmp_path_factory.mktemp("replaced") / "replaced.yaml"
    path.write_text(json.dumps(values))
    assert main(["validate", str(path)]) in (0, 2)


@settings(max_examples=200)
@given(st.text(st.characters(codec="utf-8"), max_size=60))
def test_any_text_gives_values_or_problems(text):
    message = "any.yaml:"
    try:
        read_yaml(text, source="any.yaml")
    except InvalidScenarioError as error:
        message = str(error)
    assert message.startswith("any.yaml:")


@settings(max_examples=100)
@given(data=st.data())
def test_a_file_with_a_piece_cut_out_gives_a_scenario_or_problems(tmp_path_factory, data):
    text = load_scenario("tiny_room").text
    start = data.draw(st.integers(0, len(text)))
    length = data.draw(st.integers(0, 40))
    path = tmp_path_factory.mktemp("cut") / "cut.yaml"
    path.write_text(text[:start] + text[start + length :])
    assert answer_to(path)
