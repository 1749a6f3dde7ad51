"""The bundled suites: they plan, their READMEs are right about them, and the page on suites has every key."""

import dataclasses
import re
from collections import Counter
from functools import cache
from itertools import combinations, groupby
from pathlib import Path

import pytest
import yaml

from gslcosim.base.bundled import bundled_agents, bundled_suites
from gslcosim.methods.card import MethodCard, find_card_beside
from gslcosim_bench.cases import Plan, build_plan, load_suite
from gslcosim_bench.cases.models import LABELS, Case, EntrySpec, ScenarioSpec, Suite, select_labels
from gslcosim_bench.cases.plan import expand_cases
from gslcosim_bench.cases.suite_files import LoadedSuite
from gslcosim_bench.statistics.rates import wilson

ROOT = Path(__file__).parents[5]
PAGE = ROOT / "docs" / "benchmark" / "suites.md"
SUITES = sorted(bundled_suites())
PLANNED_WHOLE = ("gsl_bench_2023", "methods", "swarms", "declare", "generalisation")
# The largest that is asked for of each [trials].
MOST_TRIALS = {"gsl_bench_fair": 4000, "methods": 2500, "open_2026": 10_000, "open_2027": 15_000, "smoke": 12}


@cache
def loaded(name: str) -> LoadedSuite:
    return load_suite(name)


@cache
def readme_of(name: str) -> str:
    return (bundled_suites()[name].parent / "README.md").read_text()


@cache
def planned_whole(name: str) -> Plan:
    return build_plan(loaded(name))


# Planning all repetitions of large suites takes long; each has the same cases and entries.
@cache
def planned_once(name: str) -> Plan:
    suite = loaded(name).suite
    anchors_and_first = suite.model_copy(
        update={
            "repetitions": 1,
            "entries": suite.entries_with_anchors[:2],
            "anchors": (),
            "scenarios": tuple(spec.model_copy(update={"repetitions": None}) for spec in suite.scenarios),
        }
    )
    return build_plan(dataclasses.replace(loaded(name), suite=anchors_and_first))


@cache
def cards() -> dict[str, MethodCard]:
    found = {name: find_card_beside(path) for name, path in bundled_agents().items()}
    return {name: card for name, card in found.items() if card is not None}


def trials_said(name: str) -> int:
    (said,) = re.findall(r"\| size \| ([\d,]+) trials", readme_of(name))
    return int(said.replace(",", ""))


def trials_counted(name: str) -> int:
    """The trials of a suite that drops nothing."""
    suite = loaded(name).suite
    n_flights = 0
    for spec in suite.scenarios:
        n_cases = 1
        for axis in suite.axes_of(spec):
            first = next(iter(axis.values()))
            n_cases *= getattr(first, "draw", None) or len(first)  # type: ignore[arg-type]
        repetitions = spec.repetitions or suite.repetitions
        n_flights += n_cases * (repetitions + round(repetitions * suite.controls.no_source_frac))
    return n_flights * len(suite.entries_with_anchors)


@pytest.mark.parametrize("name", SUITES)
def test_a_suite_has_its_folders_name_and_says_what_it_asks(name: str) -> None:
    suite = loaded(name).suite
    assert suite.name == name
    assert suite.title
    assert suite.question.endswith("?")
    assert suite.question in readme_of(name)


@pytest.mark.parametrize("name", SUITES)
def test_trials_are_as_many_as_the_readme_says(name: str) -> None:
    assert trials_counted(name) == trials_said(name)
    assert trials_said(name) <= MOST_TRIALS.get(name, 2500)
    assert f"| {trials_said(name):,} |" in PAGE.read_text()


@pytest.mark.parametrize("name", SUITES)
def test_the_readme_names_every_entry_and_scenario(name: str) -> None:
    text = readme_of(name)
    for entry in loaded(name).suite.entries_with_anchors:
        assert f"`{entry.name}`" in text, entry.name
    if not name.startswith("gsl_bench"):
        for scenario in loaded(name).suite.scenarios:
            assert f"`{Path(scenario.source).stem}`" in text, scenario.source


@pytest.mark.parametrize("name", SUITES)
def test_the_readme_links_to_what_there_is(name: str) -> None:
    for target in re.findall(r"\]\(([^)#]+)[^)]*\)", readme_of(name)):
        assert (bundled_suites()[name].parent / target).is_file(), target


@pytest.mark.slow
@pytest.mark.parametrize("name", SUITES)
def test_all_methods_are_bundled_and_their_parameters_allowed(name: str) -> None:
    for entry in loaded(name).suite.entries_with_anchors:
        assert entry.start.python in bundled_agents(), entry.name
        card = cards()[entry.start.python]
        for parameters in (entry.parameters, *entry.parameters_in.values()):
            for key, value in parameters.items():
                assert card.parameters[key].problem_of(value) is None, (entry.name, key)


def test_methods_holds_all_that_run_alone_without_a_camera() -> None:
    alone = {name for name, card in cards().items() if card.robots == 1 and "camera" not in card.needs.sensors}
    # It flies the policy of whichever file it is given; bundled policies are entries by their own names.
    alone.remove("learned")
    assert {entry.name for entry in loaded("methods").suite.entries} == alone


def test_swarms_holds_all_that_run_together_with_enough_robots() -> None:
    swarms = {name: card.robots for name, card in cards().items() if not isinstance(card.robots, int)}
    entries = {entry.name: entry.robots for entry in loaded("swarms").suite.entries}
    assert set(swarms) <= set(entries)
    for name, (least, most) in swarms.items():
        assert entries[name] == max(3, least) <= most


def test_declare_holds_all_that_declare_alone() -> None:
    suite = loaded("declare").suite
    declaring = {
        name
        for name, card in cards().items()
        if card.robots == 1 and card.declares and "camera" not in card.needs.sensors
    }
    assert {entry.name for entry in suite.entries_with_anchors} == declaring
    assert suite.set["referee.success.of"] == "declaration"
    assert suite.controls.no_source_frac == 1.0


def test_the_quick_profile_has_the_same_cases_as_the_whole_comparison() -> None:
    whole, quick = (
        {case.name: case for _, case in expand_cases(loaded(name))} for name in ("open_2026", "open_2026_quick")
    )
    assert set(quick) < set(whole)
    for name, case in quick.items():
        assert case.overrides == whole[name].overrides
        assert case.varied == whole[name].varied
        assert case.source.resolve() == whole[name].source.resolve()
        assert (case.run_seed(0), case.plume_seed(0)) == (whole[name].run_seed(0), whole[name].plume_seed(0))
    assert {case.scenario for case in quick.values()} == {case.scenario for case in whole.values()}


def labels_of(case: Case, core: Case) -> dict[str, str]:
    labels = select_labels(case.varied)
    return {axis: level for axis, level in labels.items() if level != core.varied[axis]}


def test_the_open_comparison_changes_one_thing_at_a_time_or_in_balance() -> None:
    cases = [case for _, case in expand_cases(loaded("open_2026_quick"))]
    core = cases[0]
    mixed = [case for case in cases if case.family == "mixed"]
    for case in cases[1:]:
        if case.family != "mixed":
            assert list(labels_of(case, core)) == [f"{LABELS}{case.family}"], case.name
    airs = [
        [value for value in case.overrides if value.startswith(("environment.", "wind."))]
        for case in cases
        if case.source.name == "core.yaml"
    ]
    assert all(one != other for one, other in combinations(airs, 2)), "open scenarios share a room"
    axes = [axis for axis in core.varied if len({case.varied[axis] for case in mixed}) > 1]
    assert len(axes) == 7
    for one, other in combinations(axes, 2):
        pairs = Counter((case.varied[one], case.varied[other]) for case in mixed)
        assert set(pairs.values()) == {2}, (one, other)


def test_the_page_of_the_open_comparison_states_its_size() -> None:
    text = (ROOT / "docs" / "benchmark" / "open_2026.md").read_text()
    suite = loaded("open_2026").suite
    cases = [case for _, case in expand_cases(loaded("open_2026"))]
    n_pairs, n_controls = sum(case.repetitions for case in cases), sum(case.n_controls for case in cases)
    assert f"**{n_pairs} pairs**" in text
    assert f"{n_controls} controls" in text
    for axis in suite.set:
        assert f"| `{axis.removeprefix(LABELS)}` |" in text
    assert wilson(0, n_controls).high == pytest.approx(0.062, abs=5e-4)


def check_pairs(plan: Plan) -> None:
    """All entries of a case and repetition meet the same."""
    keys = [(trial.case, trial.repetition, trial.is_control) for trial in plan.trials]
    assert keys == [key for key, group in groupby(keys) for _ in group]
    for _, group in groupby(plan.trials, lambda trial: (trial.case, trial.repetition, trial.is_control)):
        trials = list(group)
        assert len({trial.entry for trial in trials}) == len(trials) == len(plan.entries)
        assert len({trial.case_hash for trial in trials}) == 1
        assert len({trial.room for trial in trials}) == 1
        assert len({trial.resolved.seed for trial in trials}) == 1
        assert len({trial.resolved.gas.seed for trial in trials}) == 1
        assert len({trial.resolved.agents[0].vehicle.start_m for trial in trials}) == 1
    assert len({trial.id for trial in plan.trials}) == len(plan.trials)


# The largest suites, with one repetition of two entries: their rooms, places and names are right.
@pytest.mark.slow
@pytest.mark.parametrize("name", sorted({*SUITES} - {"smoke", *PLANNED_WHOLE}))
def test_one_repetition_of_a_suite_plans_and_drops_nothing(name: str) -> None:
    plan = planned_once(name)
    check_pairs(plan)
    assert not plan.dropped


@pytest.mark.slow
@pytest.mark.parametrize("name", PLANNED_WHOLE)
def test_a_whole_suite_plans_with_as_many_trials_as_the_readme_says(name: str) -> None:
    plan = planned_whole(name)
    check_pairs(plan)
    assert len(plan.trials) == trials_said(name)
    (hours,) = re.findall(r"trials, at most ([\d.]+) h", readme_of(name))
    assert plan.sim_s / 3600 == pytest.approx(float(hours), rel=0.05)


@pytest.mark.parametrize("model", [Suite, ScenarioSpec, EntrySpec])
def test_the_page_has_every_key(model: type) -> None:
    text = PAGE.read_text()
    for name, field in model.model_fields.items():  # type: ignore[attr-defined]
        assert f"`{field.alias or name}`" in text, name


def yaml_of(text: str) -> list[str]:
    return re.findall(r"```yaml\n(.*?)```", text, flags=re.DOTALL)


PIECES = [
    pytest.param(piece, id=f"{where}-{i}")
    for where, text in [("suites.md", PAGE.read_text()), *((name, readme_of(name)) for name in SUITES)]
    for i, piece in enumerate(yaml_of(text))
]


@pytest.mark.parametrize("piece", PIECES)
def test_examples_are_valid(piece: str, tmp_path: Path) -> None:
    values = yaml.safe_load(piece)
    if "schema" not in values:
        entries = [{"name": "dung_beetle", "start": {"python": "dung_beetle"}}]
        required = {"schema": "gslcosim/suite/1", "name": "part", "scenarios": ["tiny_room"], "entries": entries}
        values = {**required, **values}
    (tmp_path / "suite.yaml").write_text(yaml.safe_dump(values))
    assert load_suite(tmp_path / "suite.yaml").suite.name == values["name"]


def test_the_example_plans_with_as_many_trials_as_the_page_says(tmp_path: Path) -> None:
    (tmp_path / "suite.yaml").write_text(yaml_of(PAGE.read_text())[0])
    plan = build_plan(load_suite(tmp_path / "suite.yaml"))
    (said,) = re.findall(r"four entries: (\d+) trials", PAGE.read_text())
    assert len(plan.trials) == int(said)
    check_pairs(plan)
