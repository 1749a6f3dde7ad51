"""Courses: the same runs for every setting, on seeds that no suite has."""

import pytest

from gslcosim_bench.cases import build_plan, load_suite
from gslcosim_bench.studies.runner import StudyHost
from gslcosim_bench.studies.target import Setting, collect_test_seeds, find_target, parse_ranges
from gslcosim_bench.studies.tuning import Tuner, build_evaluation_plan, split_budget

DEFAULT = Setting(name="default", parameters={})


def evaluation(n, number=0):
    subject = find_target("smoke", "dung_beetle")
    return build_evaluation_plan(subject, "training", number, n=n, taken=collect_test_seeds(subject.loaded))


@pytest.mark.slow
def test_cases_are_run_equally_often_and_the_rest_by_lot():
    slots = evaluation(5).slots
    assert len(slots) == len(set(slots)) == 5
    counts = sorted(sum(case == name for name, _ in slots) for case in {name for name, _ in slots})
    assert counts == [2, 3]
    assert len({evaluation(1, number).slots[0][0] for number in (1, 2)}) == 2


@pytest.mark.slow
def test_no_seed_of_training_or_validation_is_one_of_a_suite(tmp_path):
    """Of the tuned suite and of a bundled one, by their plans."""
    path = tmp_path / "mine.yaml"
    path.write_text(
        "schema: gslcosim/suite/1\nname: mine\nseed: 3\nscenarios: [tiny_room]\nrepetitions: 6\n"
        "entries: [{name: beetle, start: {python: dung_beetle}}]\n"
    )
    subject = find_target(str(path), "beetle")
    tuner = Tuner(
        subject,
        parse_ranges(["leg_m=0.2:2"], subject),
        split_budget(60),
        seed=0,
        folder=tmp_path,
        host=StudyHost(start_pool=_no_pool),
    )
    training, validation = (seeds(each.plan([DEFAULT])) for each in tuner.evaluations())
    tests = seeds(build_plan(load_suite(path))) | seeds(build_plan(load_suite("smoke")))
    assert training
    assert validation
    assert not (training | validation) & tests
    assert not training & validation


def seeds(plan):
    return {seed for trial in plan.trials for seed in (trial.resolved.seed, trial.resolved.gas.seed)}


@pytest.mark.slow
def test_a_plan_that_grows_is_that_of_all_settings_at_once():
    settings = [DEFAULT, *(Setting(name=f"s_{i}", parameters={"leg_m": i / 2}) for i in (1, 2, 3))]
    short = evaluation(3)
    grown = short.plan(settings[2:], after=short.plan(settings[:2]))
    at_once = short.plan(settings)
    assert grown.loaded == at_once.loaded
    assert grown.suite_hash == at_once.suite_hash
    assert [(t.id, t.entry, t.case, t.repetition) for t in grown.trials] == [
        (t.id, t.entry, t.case, t.repetition) for t in at_once.trials
    ]
    assert [trial.index for trial in grown.trials] == list(range(12))


def _no_pool():
    raise AssertionError("nothing is flown")


@pytest.mark.slow
def test_fewer_runs_than_cases_are_spread_over_scenarios_and_leave_out_what_is_no_case(tmp_path):
    """A start outside the room is no case, and another one flies in its place."""
    path = tmp_path / "mine.yaml"
    path.write_text(
        "schema: gslcosim/suite/1\nname: mine\nscenarios: [tiny_room, {source: tiny_room, name: other}]\n"
        "vary:\n  - agents[0].vehicle.start_m: [[4.5, 2.5, 0.2], [40, 1, 0.2], [4.5, 1, 0.2], [50, 1, 0.2]]\n"
        "when: places_are_free\nentries: [{name: beetle, start: {python: dung_beetle}}]\n"
    )
    subject = find_target(str(path), "beetle")
    for n, cases in ((1, 1), (2, 2), (4, 4), (6, 4)):
        slots = build_evaluation_plan(subject, "training", 0, n=n, taken=frozenset()).slots
        assert len(slots) == len(set(slots)) == n
        assert len({case for case, _ in slots}) == cases
        assert not any("=40" in case or "=50" in case for case, _ in slots)
    two = build_evaluation_plan(subject, "training", 0, n=2, taken=frozenset())
    assert {case.partition("/")[0] for case, _ in two.slots} == {"tiny_room", "other"}
    assert len(two.plan([DEFAULT]).trials) == 2
