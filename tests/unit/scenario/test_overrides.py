"""`--set` and `--seed`."""

import pytest

from gslcosim.scenario.loader import load_scenario


@pytest.mark.parametrize(
    ("override", "read"),
    [
        ("agents[0].vehicle.hold_s=1", lambda s: s.agents[0].vehicle.hold_s == 1.0),
        ("gas.sources[0].filaments_per_s=20", lambda s: s.gas.sources[0].filaments_per_s == 20.0),
        ("gas.sources[0].position_m[2]=3.5", lambda s: s.gas.sources[0].position_m == (5.0, 1.0, 3.5)),
        ("recording.enabled=false", lambda s: s.recording.enabled is False),
        ("referee.stop.time_limit_s= 12", lambda s: s.referee.stop.time_limit_s == 12.0),
        ("wind.average_from_s=", lambda s: s.wind.average_from_s is None),
        ("agents[0].mode={latency: 3}", lambda s: s.agents[0].mode == {"latency": 3}),
        ("name=other", lambda s: s.name == "other"),
    ],
)
def test_an_override_replaces_one_value(scenario_file, override, read):
    assert read(load_scenario(scenario_file(), overrides=[override]).scenario)


def test_the_last_of_several_overrides_wins(scenario_file):
    overrides = ["wind={solver: uniform, cell_m: 1}", "wind.cell_m=0.5"]
    wind = load_scenario(scenario_file(), overrides=overrides).scenario.wind
    assert (wind.solver, wind.cell_m) == ("uniform", 0.5)


def test_the_seed_option_replaces_the_seed(scenario_file):
    assert load_scenario(scenario_file(), seed=12).scenario.seed == 12
    assert load_scenario(scenario_file(("name: hall", "name: hall\nseed: 3"))).scenario.seed == 3


@pytest.mark.parametrize(
    ("override", "line"),
    [
        ("hold_s", "--set: hold_s: expected path=value, was 'hold_s'. For example: agents[0].vehicle.hold_s=1"),
        ("a..b=1", "--set: a..b: expected a path of keys and [indices], was 'a..b'. For example: "
         "agents[0].vehicle.hold_s"),
        ("agents.0.name=b", "--set: agents.0.name: expected a path of keys and [indices], was 'agents.0.name'. "
         "Write agents[0].name."),
        ("agents[1].name=b", "--set: agents[1].name: expected an index below 1, as agents has 1 item, was [1]."),
        ("agents.name=b", "--set: agents.name: expected agents to be a block with keys, was a list. Write "
         "agents[0].name."),
        ("gas[0]=b", "--set: gas[0]: expected gas to be a list, was a block. Leave out [0]."),
        ("name.first=b", "--set: name.first: expected name to be a block with keys, was 'hall'."),
        ("gas={a: 1", "--set:1:6: expected YAML, was text that cannot be read (while parsing a flow mapping, expected "
         "',' or '}', but got '<stream end>'). Is a quote, bracket or colon missing above? Text with `: ` or ` #` in "
         "it needs quotes."),
        ("agents[0].vehicle.hold_s=-1",
         "--set: agents[0].vehicle.hold_s: expected a number of at least 0 in seconds, was -1."),
        ("agents[0].vehicle.hold=1",
         "--set: agents[0].vehicle.hold: expected one of the keys model, start_m, search_height_m, hold_s, hold_rule, "
         "max_speed_m_s, "
         "max_acceleration_m_s2, avoidance, separation_m, was an unknown key. Did you mean hold_s? It is in seconds."),
        ("recording={enabled: maybe}", "--set: recording.enabled: expected true or false, was 'maybe'. Write true "
         "or false."),
    ],
)  # fmt: skip
def test_a_wrong_override_is_reported_with_its_option(problem_lines, override, line):
    assert problem_lines(overrides=[override]) == [line]


def test_a_wrong_seed_is_reported_with_its_option(problem_lines):
    assert problem_lines(seed=2**40) == [
        "--seed: seed: expected a whole number from 0 to 2147483648, was 1099511627776."
    ]


def test_a_fault_in_the_file_that_an_override_replaces_is_no_problem(scenario_file):
    assert load_scenario(scenario_file(("name: hall", "name: 5")), overrides=["name=hall"]).name == "hall"


def test_problems_of_overrides_and_of_the_file_are_reported_together(problem_lines):
    lines = problem_lines(("name: hall", "name: 5"), overrides=["x", "agents[7].name=b", "wind.cell_m=-1"])
    assert [line.partition(": expected")[0] for line in lines] == [
        "hall.yaml: 4 problems", "hall.yaml:2: name", "--set: agents[7].name", "--set: wind.cell_m", "--set: x"
    ]  # fmt: skip
