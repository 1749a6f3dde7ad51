"""What the models allow at a place, in words."""

import pytest

from gslcosim.scenario.model_schema import find_schema_node, paths_of_key
from gslcosim_bench.cases.models import Suite

A_NAME = "a name: a small letter, then small letters, digits and _, at most 40 in all"


@pytest.mark.parametrize(
    ("location", "path", "words"),
    [
        (("seed",), "seed", "a whole number from 0 to 2147483648"),
        (("tick_ms",), "tick_ms", "a whole number from 1 to 1000 in milliseconds"),
        (("name",), "name", A_NAME),
        (("schema",), "schema", "gslcosim/scenario/1"),
        (("wind", "cell_m"), "wind.cell_m", "a number greater than 0 in metres"),
        (("wind", "average_from_s"), "wind.average_from_s", "a number of at least 0 in seconds"),
        (("wind", "solver"), "wind.solver", "auto, built_in, openfoam, uniform or stored or {file: a text}"),
        (("wind", "inlet_velocity_m_s", 2), "wind.inlet_velocity_m_s[2]", "a number in metres per second"),
        (("gas", "sources", 0, "position_m"), "gas.sources[0].position_m", "a list of 3 numbers in metres"),
        (("gas", "sources", 3, "filaments_per_s"), "gas.sources[3].filaments_per_s", "a number greater than 0 per "
         "second"),
        (("environment", "layout", "size_m"), "environment.layout.size_m", "a list of 3 numbers greater than 0 to "
         "10000 in metres"),
        (("environment", "layout", "inlet"), "environment.layout.inlet", "a block with the keys min_m and max_m"),
        (("environment", "path"), "environment.path", "a text"),
        (("agents", 0, "start", "command"), "agents[0].start.command", "a list of at least one text"),
        (("agents", 0, "start", "attach"), "agents[0].start.attach", "true or false"),
    ],
)  # fmt: skip
def test_a_place_is_described_from_its_model(location, path, words):
    slot = find_schema_node(location)
    assert (slot.path, slot.describe()) == (path, words)


def test_whole_bounds_keep_all_digits():
    assert find_schema_node(("seed",), root=Suite).describe() == "a whole number from 0 to 9223372036854775807"


def test_a_list_of_blocks_names_their_keys():
    words = find_schema_node(("gas", "sources")).describe()
    keys = "position_m, filaments_per_s, ppm, sigma_m, gas, shape and release"
    assert words == f"a list of at least one block with the keys {keys}"


def test_the_way_ends_at_what_the_models_do_not_know():
    assert find_schema_node(("agents", 0, "mode", "dict[literal['latency'],int]", "latency")).path == "agents[0].mode"
    assert find_schema_node(("agents", 0, "wings", 3)).path == "agents[0]"


def test_alternatives_of_several_kinds_are_joined():
    words = find_schema_node(("agents", 0, "mode")).describe()
    assert words == "on_request, lockstep or free or {latency: N} with N a whole number from 1 to 1000"


def test_the_homes_of_a_key_are_found():
    assert paths_of_key("time_limit_s") == ["referee.stop"]
    assert paths_of_key("mount_m") == ["agents[].sensors[]"]
    assert paths_of_key("wings") == []
