"""Families as scenarios of a suite: the cases that a training has, and none that a tuning could draw again."""

from pathlib import Path

import pytest

from gslcosim.base.bundled import bundled_folder
from gslcosim.base.errors import ScenarioError, UsageError
from gslcosim_bench.cases import Plan, build_plan, load_suite
from gslcosim_bench.cases.suite_files import write_suite
from gslcosim_bench.studies.target import find_target, with_disjoint_seeds
from gslcosim_training.family import load_family

HEAD = "schema: gslcosim/suite/1\nname: mine\nanchors: []\nentries: [{name: e_coli, start: {python: e_coli}}]\n"
FAMILY = """
schema: gslcosim/family/1
name: my_rooms
scenario: room.yaml
vary:
  - agents[0].vehicle.hold_s: {between: [0.5, 2]}
seeds: {training: {first: 10, count: 5}, validation: {first: 20, count: 5}, test: {first: 30, count: 5}}
"""


def planned(folder: Path, scenarios: str, more: str = "") -> Plan:
    (folder / "suite.yaml").write_text(f"{HEAD}scenarios: [{scenarios}]\n{more}")
    return build_plan(load_suite(folder / "suite.yaml", is_flown=True))


@pytest.fixture
def mine(tmp_path: Path) -> Path:
    (tmp_path / "rooms").mkdir()
    room = (bundled_folder("families").parent / "tiny_room.yaml").read_text()
    (tmp_path / "rooms" / "room.yaml").write_text(room)
    (tmp_path / "rooms" / "family.yaml").write_text(FAMILY)
    return tmp_path


def test_cases_are_those_of_the_split(tmp_path: Path) -> None:
    plan = planned(tmp_path, "{source: open_halls, split: test, cases: 3}")
    assert [case.name for case in plan.cases] == [f"open_halls/seed={seed}" for seed in (50000, 50001, 50002)]
    family = load_family("open_halls")
    for i, trial in enumerate(plan.trials):
        flown, trained = trial.resolved, family.case("test", i).scenario
        assert flown.seed == flown.gas.seed == trained.seed
        assert flown.agents[0].vehicle == trained.agents[0].vehicle
        unlike = {"agents", "gas", "name"}
        assert flown.model_dump(exclude=unlike) == trained.model_dump(exclude=unlike)
        assert flown.gas.model_dump(exclude={"seed"}) == trained.gas.model_dump(exclude={"seed"})


def test_the_seed_of_the_suite_moves_further_repetitions_no_more_than_the_first(mine: Path) -> None:
    plans = [
        planned(mine, "{source: rooms/family.yaml, split: validation, cases: 2}", f"seed: {seed}\nrepetitions: 2\n")
        for seed in (1, 2)
    ]
    seeds = [[(trial.resolved.seed, trial.resolved.gas.seed) for trial in plan.trials] for plan in plans]
    assert seeds[0] == seeds[1]
    assert [each for each in seeds[0] if each[0] in (20, 21)] == [(20, 20), (21, 21)]
    assert len(set(seeds[0])) == 4


def test_what_varies_in_the_suite_multiplies(mine: Path) -> None:
    vary = "vary:\n  - referee.success.within_m: [0.8, 0.9]\n"
    plan = planned(mine, "{source: rooms/family.yaml, name: r, split: training, cases: 2}", vary)
    assert [case.name for case in plan.cases] == [
        "r/seed=10/within=0.8", "r/seed=10/within=0.9", "r/seed=11/within=0.8", "r/seed=11/within=0.9",
    ]  # fmt: skip
    holds_s = [trial.resolved.agents[0].vehicle.hold_s for trial in plan.trials]
    assert holds_s[0] == holds_s[1] != holds_s[2] == holds_s[3]


def test_results_keep_the_family_with_its_scenario(mine: Path, tmp_path: Path) -> None:
    plan = planned(mine, "{source: rooms/family.yaml, split: test, cases: 2}")
    write_suite(plan.loaded, tmp_path / "kept")
    for path in (mine / "rooms").iterdir():
        path.unlink()
    kept = build_plan(load_suite(tmp_path / "kept", is_flown=True))
    assert [trial.id for trial in kept.trials] == [trial.id for trial in plan.trials]


@pytest.mark.parametrize(
    ("scenario", "message"),
    [
        ("{source: open_halls, split: test}", "cases: expected split and cases together"),
        ("{source: open_halls, cases: 3}", "split: expected split and cases together"),
        ("{source: tiny_room, split: test, cases: 3}", "expected a family file beside the suite, or a bundled family"),
        ("{source: open_halls, split: test, cases: 3000}", "expected 1 to 2000 cases for test"),
        ("{source: open_halls, split: tests, cases: 3}", "split"),
    ],
)
def test_what_is_no_split_of_a_family_is_reported(tmp_path: Path, scenario: str, message: str) -> None:
    with pytest.raises(ScenarioError) as error:
        planned(tmp_path, scenario)
    assert message in str(error.value)


def test_a_tuning_refuses_cases_whose_seeds_are_fixed(mine: Path) -> None:
    (mine / "suite.yaml").write_text(f"{HEAD}scenarios: [{{source: rooms/family.yaml, split: test, cases: 2}}]\n")
    subject = find_target(str(mine / "suite.yaml"), "e_coli")
    with pytest.raises(UsageError, match=r"was my_rooms/seed=30, a case of a family\. Tune on scenarios"):
        with_disjoint_seeds(subject, "training", 0, repetitions=1, taken=frozenset())
