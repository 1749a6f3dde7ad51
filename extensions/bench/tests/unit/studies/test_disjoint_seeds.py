"""Derived suites: one entry a setting, the same cases and seeds; seeds that nobody else has."""

import itertools

import pytest

from gslcosim.scenario.models.scenario import StartSpec
from gslcosim_bench.cases import Suite, build_plan, load_suite
from gslcosim_bench.cases.models import EntrySpec, derive_seed
from gslcosim_bench.cases.plan import expand_cases
from gslcosim_bench.cases.suite_files import write_suite
from gslcosim_bench.studies import target
from gslcosim_bench.studies.target import (
    build_study_suite,
    collect_seeds,
    collect_test_seeds,
    find_target,
    with_disjoint_seeds,
)

LAYOUT_SEED = "environment.layout.seed"


def settings_of(entry, varied):
    return EntrySpec(name=entry, start=StartSpec(python="dung_beetle")).model_copy(update={"vary": varied}).settings


def names_of(entry, **varied):
    return [setting.name for setting in settings_of(entry, varied)]


def test_names_show_the_values():
    assert names_of("e_coli", step_m=(0.2, 1.0)) == ["e_coli_step_m_0_2", "e_coli_step_m_1"]
    assert names_of("a", x=(-1, 1), y=(True, "Up-Wind")) == [
        "a_x_minus_1_y_true", "a_x_minus_1_y_up_wind", "a_x_1_y_true", "a_x_1_y_up_wind",
    ]  # fmt: skip
    assert names_of("a", x=((1.0, 2.5),)) == ["a_x_1_2_5"]


def test_names_that_would_be_too_long_or_equal_are_numbered():
    long = "a_method_with_a_name_of_forty_letters_xx"
    assert names_of(long, step_m=range(10)) == [f"a_method_with_a_name_of_forty_letters_{i:02d}" for i in range(1, 11)]
    assert names_of("a", word=("x y", "x.y")) == ["a_1", "a_2"]


def test_every_name_is_one_that_a_suite_takes():
    subject = find_target("tiny_room", "dung_beetle")
    for varied in (
        {"leg_m": (1e-7, 12345.678)},
        {"zigzag_rad": tuple(i / 7 for i in range(1, 20)), "leg_m": (0.123456, 2.0)},
    ):
        loaded = build_study_suite(subject, settings_of("dung_beetle", varied), name="x" * 60)
        Suite.model_validate(loaded.suite.model_dump(by_alias=True))


def test_settings_meet_the_same_cases_seeds_and_plumes_as_in_the_suite():
    subject = find_target("smoke", "dung_beetle")
    plan = build_plan(build_study_suite(subject, settings_of("b", {"leg_m": (0.5, 1.0)}), name="s"))
    own = build_plan(load_suite("smoke"))

    def met(trials):
        return [(t.case, t.repetition, t.resolved.seed, t.resolved.gas.seed, t.case_hash) for t in trials]

    first, second = ([t for t in plan.trials if t.entry == name] for name in ("b_leg_m_0_5", "b_leg_m_1"))
    assert met(first) == met(second) == met([t for t in own.trials if t.entry == "oracle" and not t.is_control])
    assert [t.resolved.agents[0].parameters for t in first] == [{"leg_m": 0.5}, {"leg_m": 0.5}]
    assert len(plan.trials) == len(first) + len(second)


def test_seeds_of_a_suite_are_those_of_its_plan():
    plan = build_plan(load_suite("smoke"))
    assert collect_seeds(load_suite("smoke")) == {
        seed for trial in plan.trials for seed in (trial.resolved.seed, trial.resolved.gas.seed)
    }


def test_drawn_rooms_count_as_seeds(tmp_path):
    path = tmp_path / "drawn.yaml"
    path.write_text(
        "schema: gslcosim/suite/1\nname: drawn\nscenarios: [tiny_room]\nvary: [{environment.layout.seed: {draw: 3}}]\n"
        "entries: [{name: beetle, start: {python: dung_beetle}}]\n"
    )
    rooms = {derive_seed(1, "draw", "environment.layout.seed", k) for k in range(3)}
    assert rooms < collect_seeds(load_suite(path))


def test_seeds_apart_are_drawn_again_while_one_is_taken(monkeypatch):
    subject = find_target("smoke", "dung_beetle")
    first = with_disjoint_seeds(subject, "training", 5, repetitions=4, taken=frozenset())
    assert first.suite.seed == derive_seed(subject.loaded.suite.seed, "training", 5)
    taken = frozenset([min(collect_seeds(first))])
    second = with_disjoint_seeds(subject, "training", 5, repetitions=4, taken=taken)
    assert second.suite.seed == derive_seed(subject.loaded.suite.seed, "training", 5, 1)
    assert collect_seeds(second).isdisjoint(taken)
    assert target.with_disjoint_seeds(subject, "training", 5, repetitions=4, taken=taken) == second


@pytest.mark.parametrize("number", [0, 7])
def test_purposes_and_numbers_have_seeds_of_their_own(number):
    subject = find_target("smoke", "dung_beetle")
    tests = collect_test_seeds(subject.loaded)
    drawn = [
        collect_seeds(with_disjoint_seeds(subject, purpose, each, repetitions=50, taken=tests))
        for purpose in ("training", "validation")
        for each in (number, number + 1)
    ]
    assert all(a.isdisjoint(b) for a, b in itertools.combinations(drawn, 2))
    assert all(each.isdisjoint(tests) for each in drawn)


SUITE = """
schema: gslcosim/suite/1
name: several
seed: 4
scenarios:
  - tiny_room
  - {source: tiny_room, name: windy, family: wind, set: {wind.inlet_velocity_m_s: [1, 0, 0]}}
set: {gas.tape: true}
vary:
  - agents[0].vehicle.start_m: [[4.5, 2.5, 0.2], [4.5, 1.0, 0.2]]
  - agents[0].vehicle.hold_s: [0.5, 1.0]
    gas.sources[0].filaments_per_s: [10, 20]
repetitions: 2
gas_seeds: 1
anchors: []
entries: [{name: beetle, start: {python: dung_beetle}}]
"""


def test_some_cases_of_a_suite_are_the_same_runs_as_in_all_of_it(tmp_path):
    """To the id, which is a hash of all that decides a run; also when the restricted suite is read from its file."""
    (tmp_path / "suite.yaml").write_text(SUITE)
    loaded = load_suite(tmp_path / "suite.yaml")
    every = build_plan(loaded)
    chosen = [case.name for case in every.cases][1:7:2]
    some = target.restrict_cases(loaded, chosen)
    plan = build_plan(some)

    def facts(trials):
        return {(t.id, t.case, t.scenario, t.family, t.varied, t.repetition, t.case_hash) for t in trials}

    assert facts(plan.trials) == facts(t for t in every.trials if t.case in chosen)
    assert {t.scenario for t in plan.trials} == {"tiny_room", "windy"}
    write_suite(some, tmp_path / "written")
    assert facts(build_plan(load_suite(tmp_path / "written")).trials) == facts(plan.trials)
    assert target.restrict_cases(loaded, {case.name for case in every.cases}) is loaded


def test_seeds_that_a_scenario_lists_stay_with_its_cases_and_are_never_tuned_on(tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text(
        "schema: gslcosim/suite/1\nname: mine\nscenarios: [{source: tiny_room, seeds: [11, 12]}, "
        "{source: tiny_room, name: other, starts: [[4.5, 2.5, 0.2], [4.5, 1, 0.2]]}]\n"
        "entries: [{name: beetle, start: {python: dung_beetle}}]\n"
    )
    subject = find_target(str(path), "beetle")
    chosen = {"tiny_room", "other/start=4.5,1,0.2"}
    part = build_plan(target.restrict_cases(subject.loaded, chosen))
    assert [trial.id for trial in part.trials] == [t.id for t in build_plan(subject.loaded).trials if t.case in chosen]
    other = with_disjoint_seeds(subject, "training", 0, repetitions=3, taken=collect_seeds(subject.loaded))
    assert {11, 12} <= collect_seeds(subject.loaded)
    assert collect_seeds(other).isdisjoint(collect_seeds(subject.loaded))
    assert [case.repetitions for _, case in target.expand_cases(other)] == [3, 3, 3]


def layout_seeds(loaded):
    return {case.varied[LAYOUT_SEED] for _, case in expand_cases(loaded) if LAYOUT_SEED in case.varied}


def test_tuning_on_the_open_comparison_meets_none_of_its_rooms_plumes_and_starts():
    subject = find_target("open_2026", "surge_cast")
    taken = target.collect_bundled_seeds()
    parts = [with_disjoint_seeds(subject, p, 1, repetitions=2, taken=taken) for p in ("training", "validation")]
    rooms = [layout_seeds(loaded) for loaded in (subject.loaded, *parts)]
    assert [len(seeds) for seeds in rooms] == [2, 2, 2]
    assert len(set.union(*rooms)) == 6
    for loaded in parts:
        assert not collect_seeds(loaded) & taken
