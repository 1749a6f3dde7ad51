"""What a participant declares, and what is wrong with it in the run that its scenario makes."""

import pytest

from gslcosim.base.errors import DataflowError, ScenarioError
from gslcosim.runtime.services import build_dataflow, find_participant_problems, list_service_names
from gslcosim.scenario import load_scenario

START = "start: {command: [cat]}"


def scenario_with(*blocks):
    return load_scenario("tiny_room", overrides=[f"participants=[{', '.join(blocks)}]"]).scenario


def problem_of(*blocks):
    (problem,) = find_participant_problems(scenario_with(*blocks))
    return problem


def test_a_participant_is_a_service_with_its_reads_and_writes():
    block = f"{{name: fan, {START}, reads: [{{port: truth/samples, delay: 1}}], writes: [ventilation, state]}}"
    scenario = scenario_with(block)
    assert list(find_participant_problems(scenario)) == []
    flow = build_dataflow(scenario)
    assert list_service_names(scenario)[-1] == "fan"
    assert "fan: reads truth/samples[k-1]; writes truth/wind, participant/fan/state" in flow.describe()
    # Who is moved by the air reads it a tick later; the recorder draws what the participant writes.
    assert {read.port for read in flow.by_name["recorder"].reads} >= {"truth/wind", "participant/fan/state"}
    assert [reader.name for reader in flow.readers_of["fan"]] == ["world", "fields", "recorder"]


def test_between_its_steps_the_wind_is_written_all_the_same():
    flow = build_dataflow(scenario_with(f"{{name: fan, {START}, writes: [ventilation, state], period_s: 0.5}}"))
    assert {port: flow.writes[port].period_ticks for port in ("truth/wind", "participant/fan/state")} == {
        "truth/wind": 1,
        "participant/fan/state": 5,
    }


def test_the_rate_of_a_source_is_written_each_tick_and_read_a_tick_later():
    flow = build_dataflow(scenario_with(f"{{name: leak, {START}, writes: [source_0, state], period_s: 0.5}}"))
    assert flow.writes["truth/sources/0"].period_ticks == 1
    assert "truth/sources/0[k-1]" in flow.describe()
    assert [reader.name for reader in flow.readers_of["leak"]] == ["fields", "recorder"]
    blocks = [f"{{name: {name}, {START}, writes: [source_0]}}" for name in ("leak", "valve")]
    assert str(problem_of(*blocks)) == "participants: expected one writer (truth/sources/0), was leak and valve."


@pytest.mark.parametrize(
    ("word", "change", "expected"),
    [
        ("source_1", "seed=2", "[0].writes: expected a source in gas.sources, source_0 alone, was source_1."),
        ("source_0", "gas.model=gaussian_plume",
         "expected no rate of a source with gas that cannot follow it, was source_0 with gas.model: gaussian_plume."),
        ("source_0", "gas.sources[0].release={kind: variable}",
         "expected a source whose release is constant or poisson, was source_0, whose release is variable."),
        ("source_0", "events=[{what: source_rate, at_s: 1, filaments_per_s: 3}]",
         "events[0].what: expected no source_rate of source 0, whose rate a participant sets in each tick, was one."),
    ],
)  # fmt: skip
def test_a_rate_that_cannot_be_set_is_refused(word, change, expected):
    with pytest.raises(ScenarioError) as caught:
        load_scenario("tiny_room", overrides=[f"participants=[{{name: leak, {START}, writes: [{word}]}}]", change])
    assert expected in str(caught.value)


def test_the_truth_at_probes_is_a_port_where_the_scenario_has_probes():
    reads = f"{{name: fan, {START}, reads: [{{port: truth/probes}}], writes: [state]}}"
    problem = problem_of(reads)
    assert (problem.found, problem.remedy) == ("'truth/probes'", "Add probes to the scenario.")
    probes = "probes=[{name: inlet, position_m: [1, 1, 1]}, {name: outlet, position_m: [2, 2, 1]}]"
    scenario = load_scenario("tiny_room", overrides=[f"participants=[{reads}]", probes]).scenario
    assert list(find_participant_problems(scenario)) == []
    flow, plain = build_dataflow(scenario), build_dataflow(load_scenario("tiny_room").scenario)
    assert {*flow.writes} - {*plain.writes} == {"truth/probes", "participant/fan/state"}
    assert [name for name, spec in flow.by_name.items() if "truth/probes" in {r.port for r in spec.reads}] == [
        "recorder",
        "fan",
    ]


def test_an_unknown_port_is_named_with_the_nearest_one():
    problem = problem_of(f"{{name: fan, {START}, reads: [{{port: truth/sample}}], writes: [state]}}")
    assert problem.where == "participants[0].reads[0].port"
    assert problem.found == "'truth/sample'"
    assert problem.remedy == "Did you mean truth/samples?"


def test_an_announced_port_needs_its_announcement():
    problem = problem_of(f"{{name: fan, {START}, reads: [{{port: command/beetle}}], writes: [state]}}")
    assert problem.expected.startswith("truth/bodies, which announces command/beetle, among the reads")
    assert problem.remedy == "Add {port: truth/bodies, delay: 0}."
    both = f"{{name: fan, {START}, reads: [{{port: truth/bodies}}, {{port: command/beetle}}], writes: [state]}}"
    assert list(find_participant_problems(scenario_with(both))) == []


@pytest.mark.parametrize("name", ["world", "cameras", "agent_fan", "supervisor"])
def test_names_of_services_and_sessions_are_taken(name):
    problem = problem_of(f"{{name: {name}, {START}, writes: [state]}}")
    assert problem.where == "participants[0].name"
    assert problem.remedy == f"For example my_{name}."


def test_a_ring_without_delay_is_named_and_one_with_a_delay_runs():
    def ring(delay):
        reads = "reads: [{{port: participant/{}/state, delay: {}}}]"
        return (
            f"{{name: one, {START}, {reads.format('two', delay)}, writes: [state]}}",
            f"{{name: two, {START}, {reads.format('one', 0)}, writes: [state]}}",
        )

    problem = problem_of(*ring(0))
    assert problem.expected == "a delay of at least 1 tick on one of the reads in each ring"
    assert problem.found == "two → one → two"
    with pytest.raises(DataflowError, match="two → one → two"):
        build_dataflow(scenario_with(*ring(0)))
    assert list(find_participant_problems(scenario_with(*ring(1)))) == []
