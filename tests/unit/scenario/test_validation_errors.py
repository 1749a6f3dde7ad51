"""Wrong values and keys: each is reported once, with place, expected, found and remedy."""

import pytest

from gslcosim.base.gases import GASES
from gslcosim.scenario.model_schema import format_value, list_keys
from gslcosim.scenario.models.scenario import VehicleSpec
from gslcosim.scenario.models.sensors import SENSORS
from gslcosim.vehicles import list_vehicle_names

VEHICLE_KEYS = ", ".join(list_keys(VehicleSpec))


@pytest.mark.parametrize(
    ("old", "new", "line"),
    [
        ("name: hall", "name: The Hall",
         "hall.yaml:2: name: expected a name: a small letter, then small letters, digits and _, at most 40 in all, "
         "was 'The Hall'. For example the_hall."),
        ("name: hall", "name: hall\nseed: 7.0",
         "hall.yaml:3: seed: expected a whole number from 0 to 2147483648, was 7.0. Write 7."),
        ("name: hall", "name: hall\nseed: '7'",
         "hall.yaml:3: seed: expected a whole number from 0 to 2147483648, was '7'. Write it without quotes: 7."),
        ("name: hall", "name: hall\nseed: -1",
         "hall.yaml:3: seed: expected a whole number from 0 to 2147483648, was -1."),
        ("name: hall", "name: hall\nwind: {cell_m: 20 cm}",
         "hall.yaml:3: wind.cell_m: expected a number greater than 0 in metres, was '20 cm'. "
         "Give the number in metres without a unit: 0.2."),
        ("name: hall", "name: hall\nwind: {cell_m: 20 s}",
         "hall.yaml:3: wind.cell_m: expected a number greater than 0 in metres, was '20 s'. "
         "Give the number in metres without a unit."),
        ("name: hall", "name: hall\nwind: {cell_m: .inf}",
         "hall.yaml:3: wind.cell_m: expected a number greater than 0 in metres, was inf."),
        ("name: hall", "name: hall\nwind: {cell_m: }",
         "hall.yaml:3: wind.cell_m: expected a number greater than 0 in metres, was nothing."),
        ("name: hall", "name: hall\nwind: built_in",
         "hall.yaml:3: wind: expected a block with the key solver, one of auto, built_in, openfoam, uniform, stored, "
         "{file: PATH} or edited, was 'built_in'."),
        ("name: hall", "name: hall\nrecording: {enabled: yes}",
         "hall.yaml:3: recording.enabled: expected true or false, was 'yes'. Write true or false."),
        ("[5, 1, 2]", "[5, 1, 2 m]",
         "hall.yaml:7: gas.sources[0].position_m[2]: expected a number in metres, was '2 m'. "
         "Give the number in metres without a unit: 2."),
        ("[5, 1, 2]", "[5, 1]",
         "hall.yaml:7: gas.sources[0].position_m: expected a list of 3 numbers in metres, was [5, 1]."),
        ("[5, 1, 2]", "5",
         "hall.yaml:7: gas.sources[0].position_m: expected a list of 3 numbers in metres, was 5. Put it in "
         "brackets: [ … ]."),
        ("\n    - {position_m", " {position_m",
         "hall.yaml:6: gas.sources: expected a list of at least one block with the keys position_m, filaments_per_s, "
         'ppm, sigma_m, gas, shape and release, was {"position_m": [5, 1, 2]}. Begin each block with a dash.'),
        ("\n    - {position_m: [5, 1, 2]}", " []",
         "hall.yaml:6: gas.sources: expected a list of at least one block with the keys position_m, filaments_per_s, "
         "ppm, sigma_m, gas, shape and release, was []."),
        ("schema: gslcosim/scenario/1", "schema: gslcosim/scenario/2",
         "hall.yaml:1: schema: expected gslcosim/scenario/1, was 'gslcosim/scenario/2'. Did you mean "
         "gslcosim/scenario/1?"),
        ("start: {python: dung_beetle}", "start: {python: dung_beetle}\n    mode: {latency: 0}",
         "hall.yaml:11: agents[0].mode: expected on_request, lockstep or free or {latency: N} with N a whole number "
         "from 1 to "
         '1000, was {"latency": 0}.'),
        ("start: {python: dung_beetle}", "start: {python: dung_beetle}\n    mode: on request",
         "hall.yaml:11: agents[0].mode: expected on_request, lockstep or free or {latency: N} with N a whole number "
         "from 1 to 1000, was 'on request'. Did you mean on_request?"),
        ("start: {python: dung_beetle}", "start: {command: [sh, 5]}",
         "hall.yaml:10: agents[0].start.command[1]: expected a text, was 5. Put it in quotes: '5'."),
    ],
)  # fmt: skip
def test_a_wrong_value_is_one_problem_with_a_remedy(problem_lines, old, new, line):
    assert problem_lines((old, new)) == [line]


@pytest.mark.parametrize(
    ("old", "new", "place", "known", "remedy"),
    [
        ("model: tgs2600", "model: TGS-2600", "hall.yaml:13: agents[0].sensors[0].model",
         SENSORS, "was 'TGS-2600'. Did you mean tgs2600?"),
        ("gas:", "gas:\n  gas: etanol", "hall.yaml:6: gas.gas", GASES, "was 'etanol'. Did you mean ethanol?"),
        ("{start_m:", "{model: crazyfly, start_m:", "hall.yaml:11: agents[0].vehicle.model",
         list_vehicle_names(), "was 'crazyfly'. Did you mean crazyflie?"),
    ],
)  # fmt: skip
def test_an_unknown_name_is_answered_with_all_that_are_known(problem_lines, old, new, place, known, remedy):
    (line,) = problem_lines((old, new))
    assert line.startswith(f"{place}: expected one of ")
    assert all(name in line for name in known)
    assert line.endswith(remedy)


@pytest.mark.parametrize(
    ("old", "new", "line"),
    [
        ("0.2]}", "0.2], hold: 2}",
         f"hall.yaml:11: agents[0].vehicle.hold: expected one of the keys {VEHICLE_KEYS}, was an unknown key. "
         "Did you mean hold_s? It is in seconds."),
        ("0.2]}", "0.2], hold_ms: 500 ms}",
         f"hall.yaml:11: agents[0].vehicle.hold_ms: expected one of the keys {VEHICLE_KEYS}, was an unknown key. "
         "Did you mean hold_s? Write hold_s: 0.5, in seconds."),
        ("0.2]}", "0.2], wings: 2}",
         f"hall.yaml:11: agents[0].vehicle.wings: expected one of the keys {VEHICLE_KEYS}, was an unknown key."),
        ("0.2]}", "0.2], time_limit_s: 2}",
         f"hall.yaml:11: agents[0].vehicle.time_limit_s: expected one of the keys {VEHICLE_KEYS}, was an unknown key. "
         "time_limit_s belongs to referee.stop."),
        ("{start_m:", "{start:",
         f"hall.yaml:11: agents[0].vehicle.start: expected one of the keys {VEHICLE_KEYS}, was an unknown key. "
         "Did you mean start_m? It is in metres."),
        ("name: hall", "name: hall\nreferee: {seed: 3}",
         "hall.yaml:3: referee.seed: expected one of the keys success, stop, was an unknown key. "
         "seed belongs to the top level or environment.layout or gas or agents[]."),
    ],
)  # fmt: skip
def test_an_unknown_key_is_one_problem_that_names_what_was_meant(problem_lines, old, new, line):
    assert problem_lines((old, new)) == [line]


def test_a_missing_key_is_reported_where_its_block_begins(problem_lines):
    assert problem_lines(("{start_m: [12, 9, 0.2]}", "{hold_s: 2}")) == [
        "hall.yaml:11: agents[0].vehicle.start_m: expected a list of 3 numbers in metres, was missing."
    ]
    assert problem_lines(("schema: gslcosim/scenario/1\n", "")) == [
        "hall.yaml:1: schema: expected gslcosim/scenario/1, was missing."
    ]


def test_faulty_items_do_not_make_their_list_look_empty(problem_lines):
    lines = problem_lines(("- {model: tgs2600, name: nose}", "- {model: tgs2600, name: Nose}"))
    assert [line.partition(": expected")[0] for line in lines] == ["hall.yaml:13: agents[0].sensors[0].name"]


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (None, "nothing"), (True, "true"), (1, "1"), (1.0, "1.0"), ("a", "'a'"), ([1, "b"], '[1, "b"]'),
        ("x" * 100, "'" + "x" * 56 + "..."),
    ],
)  # fmt: skip
def test_values_are_shown_as_people_write_them(value, text):
    assert format_value(value) == text
