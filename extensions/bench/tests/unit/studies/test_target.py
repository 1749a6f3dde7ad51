"""What a command line names: suites before scenarios, entries before bundled methods."""

import pytest

from gslcosim.base.errors import ScenarioError, UsageError
from gslcosim_bench.cases import build_plan
from gslcosim_bench.studies.target import Setting, build_study_suite, find_target, is_scenario

INNER = """
schema: gslcosim/suite/1
name: inner
scenarios: [tiny_room]
anchors: []
entries:
  - name: fast
    start: {python: dung_beetle}
    parameters: {leg_m: 1.5}
    parameters_in: {tiny_room: {leg_m: 1.2, eps: 0.1}}
  - {name: mine, start: {python: mine.py}}
"""
OUTER = """
schema: gslcosim/suite/1
name: outer
include: [inner]
anchors: []
"""


@pytest.fixture
def suites(tmp_path):
    (tmp_path / "inner").mkdir()
    (tmp_path / "inner" / "suite.yaml").write_text(INNER)
    (tmp_path / "inner" / "mine.py").write_text("")
    (tmp_path / "outer.yaml").write_text(OUTER)
    return tmp_path


def test_a_name_is_a_suite_or_a_scenario(suites, tmp_path):
    assert not is_scenario("smoke")
    assert is_scenario("tiny_room")
    assert not is_scenario(str(suites / "inner"))
    assert not is_scenario(str(suites / "outer.yaml"))
    (tmp_path / "room.yaml").write_text("schema: gslcosim/scenario/1\nname: room\n")
    assert is_scenario(str(tmp_path / "room.yaml"))


def test_what_is_neither_is_reported():
    with pytest.raises(ScenarioError, match=r"^smok: expected a file, a bundled suite or .* Did you mean smoke"):
        find_target("smok", "dung_beetle")
    with pytest.raises(ScenarioError, match=r"^a/none.yaml: expected the file of a suite or a scenario, found none."):
        find_target("a/none.yaml", "dung_beetle")


def test_a_scenario_becomes_a_suite_of_ten_repetitions():
    subject = find_target("tiny_room", "dung_beetle")
    assert (subject.loaded.suite.name, subject.loaded.suite.repetitions) == ("tiny_room", 10)
    assert find_target("tiny_room", "dung_beetle", repetitions=3, seed=9).loaded.suite.seed == 9


def test_an_entry_of_an_included_suite_keeps_its_parameters_and_its_program(suites):
    subject = find_target(str(suites / "outer.yaml"), "fast", repetitions=2)
    assert subject.default_of("leg_m") == 1.5
    assert subject.default_of("eps") == 0.0
    assert subject.default_of("unknown") is None
    assert [inner.suite.repetitions for inner in subject.loaded.included] == [2]
    own = find_target(str(suites / "outer.yaml"), "mine")
    assert own.entry.start.python == str(suites / "inner" / "mine.py")


def test_a_bundled_method_or_a_file_need_not_be_in_the_suite(suites):
    assert find_target("smoke", "e_coli").entry.start.python == "e_coli"
    found = find_target("smoke", str(suites / "inner" / "mine.py")).entry
    assert (found.name, found.start.python) == ("mine", str(suites / "inner" / "mine.py"))


def test_an_unknown_entry_is_reported():
    with pytest.raises(
        UsageError, match=r"an entry of smoke \(dung_beetle, oracle, random_walker\).*Did you mean e_co"
    ):
        find_target("smoke", "e_col")
    with pytest.raises(UsageError, match=r"--entry: expected a bundled method or a Python file, was 'e_col'"):
        find_target("tiny_room", "e_col")


def test_a_parameter_for_a_scenario_does_not_hide_what_is_varied(suites):
    subject = find_target(str(suites / "inner"), "fast")
    setting = Setting(name="a", parameters={"leg_m": 0.5})
    plan = build_plan(build_study_suite(subject, [setting.entry(subject)], name="x"))
    assert plan.trials[0].resolved.agents[0].parameters == {"leg_m": 0.5, "eps": 0.1}
