"""What a run's folder says of itself, and how rows are chosen and sorted."""

import json

import pytest

from gslcosim.base.errors import UsageError
from gslcosim.base.method_names import join_methods
from gslcosim.recordings.run_summary import Condition, find_methods, is_run_folder, read_run_summary, sorted_rows
from gslcosim.scenario import dump_resolved, load_scenario

SCENARIO = """schema: gslcosim/scenario/1
name: tiny_room
seed: 5
agents:
- name: one
  start:
    python: ./own/dung_beetle.py
    attach: false
  mode: on_request
- name: two
  start:
    process_of: one
  mode: on_request
- name: three
  start:
    command:
    - python3
    - searcher.py
    - --fast
    attach: false
  mode: on_request
- name: four
  start:
    attach: true
"""


def make_run(folder, **files):
    (folder / "logs").mkdir(parents=True)
    (folder / "scenario.yaml").write_text(SCENARIO)
    (folder / "manifest.json").write_text(json.dumps({"run_id": folder.name, "seed": 5, "gslcosim": "0.1.0"}))
    for name, text in files.items():
        (folder / f"{name}.json").write_text(text)
    return folder


RESULT = {
    "schema": "gslcosim/result/1",
    "scenario": "tiny_room",
    "seed": 5,
    "end_reason": "time_limit",
    "sim_time_s": 60.0,
    "real_time_factor": 80.0,
    "faults": [{"text": "late"}],
    "agents": [
        {"time_to_source_s": None, "final_distance_m": 3.0, "path_length_m": 10.0},
        {"time_to_source_s": 12.5, "final_distance_m": 0.5, "path_length_m": 5.0},
    ],
}


def test_a_run_that_has_ended_says_how(tmp_path):
    facts = read_run_summary(make_run(tmp_path / "run", result=json.dumps(RESULT)))
    assert (facts.state, facts.outcome, facts.time_s, facts.speed, facts.faults) == ("ended", "time_limit", 60, 80, 1)
    assert (facts.time_to_source_s, facts.distance_m, facts.path_m, facts.agents) == (12.5, 0.5, 15.0, 2)
    assert (facts.scenario, facts.method, facts.seed) == ("tiny_room", "dung_beetle+searcher+attached", 5)
    assert facts.size_mb * 1e6 == pytest.approx(sum(p.stat().st_size for p in (tmp_path / "run").glob("*.*")), abs=500)


@pytest.mark.parametrize(
    ("files", "outcome"), [({}, "no result.json"), ({"result": '{"schema": "gslco'}, "result.json cannot be read")]
)
def test_a_run_without_result_is_broken_and_still_says_what_was_run(tmp_path, files, outcome):
    facts = read_run_summary(make_run(tmp_path / "run", **files))
    assert (facts.state, facts.outcome, facts.scenario, facts.seed) == ("broken", outcome, "tiny_room", 5)


def test_a_folder_of_something_else_is_foreign(tmp_path):
    (tmp_path / "photos").mkdir()
    (tmp_path / "photos" / "result.json").write_text('{"schema": "another"}')
    assert read_run_summary(tmp_path / "photos").state == "foreign"
    make_run(tmp_path / "run", result=json.dumps(RESULT))
    (tmp_path / "link").symlink_to(tmp_path / "run")
    assert read_run_summary(tmp_path / "link").outcome == "a link"
    assert not is_run_folder(tmp_path)
    assert is_run_folder(tmp_path / "run")


def test_a_folder_that_was_just_made_is_a_run(tmp_path):
    (tmp_path / "run" / "logs").mkdir(parents=True)
    (tmp_path / "run" / ".reserve").write_bytes(b"0")
    assert read_run_summary(tmp_path / "run").state == "broken"


def test_the_methods_are_those_that_the_scenario_names(tmp_path):
    """Of a team in one process, and of the text as it is written; an own agent has the name of its folder."""
    agent = tmp_path / "my_search" / "agent.py"
    agent.parent.mkdir()
    agent.touch()
    scenario = load_scenario("swarm_tiny", overrides=[f"agents[0].start={{python: {agent}}}"]).scenario
    assert scenario.methods == {"beetle_1": "my_search", "beetle_2": "my_search", "beetle_3": "calling_beetle"}
    methods = find_methods(dump_resolved(scenario))
    assert methods == join_methods(scenario.methods.values()) == "my_search+calling_beetle"


NUMBERS, TEXTS = ("time_s", "seed"), ("outcome",)


@pytest.mark.parametrize(
    ("text", "holds"),
    [
        ("outcome=success", True),
        ("outcome=suc*", True),
        ("outcome != success", False),
        ("time_s<10", False),
        ("time_s<=10", True),
        ("time_s>9.5", True),
        ("time_s >= 10.5", False),
        ("time_s=10", True),
        ("seed=3", False),
        ("seed!=3", True),
        ("seed>0", False),
        ("time>9", True),
    ],
)
def test_conditions_on_numbers_and_texts(text, holds):
    condition = Condition.of(text, numbers=NUMBERS, texts=TEXTS, short={"time": "time_s"})
    assert condition.holds({"outcome": "success", "time_s": 10.0, "seed": None}) is holds


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("outcome", "expected COLUMN=VALUE"),
        ("colour=red", "expected one of the columns outcome, time_s, seed, was 'colour'"),
        ("outcome<b", "expected = or != for the texts of outcome, was <"),
        ("time_s>soon", "expected a number for time_s, was 'soon'"),
    ],
)
def test_conditions_that_mean_nothing_are_refused(text, expected):
    with pytest.raises(UsageError, match=expected):
        Condition.of(text, numbers=NUMBERS, texts=TEXTS)


def test_rows_are_sorted_either_way_with_those_that_lack_a_value_last():
    rows = [{"time_s": 2.0}, {"time_s": None}, {"time_s": 1.0}]
    assert [row["time_s"] for row in sorted_rows(rows, "time_s", ("time_s",))] == [1.0, 2.0, None]
    assert [row["time_s"] for row in sorted_rows(rows, "-time_s", ("time_s",))] == [2.0, 1.0, None]
    with pytest.raises(UsageError, match="expected one of the columns time_s, was 'size'"):
        sorted_rows(rows, "size", ("time_s",))
