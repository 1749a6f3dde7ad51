"""Families of cases: what they draw, and what they refuse."""

import numpy as np
import pytest

from gslcosim.base.bundled import bundled_families
from gslcosim.base.errors import ScenarioError, UsageError
from gslcosim_bench.studies.target import collect_bundled_seeds
from gslcosim_training.family import load_family

SEEDS = "seeds: {training: {first: 10, count: 5}, validation: {first: 20, count: 5}, test: {first: 30, count: 5}}"
VARY = """vary:
  - environment.layout.seed: {rooms: 3}
  - wind.inlet_velocity_m_s: [[0.3, 0, 0], [0.6, 0, 0]]
    gas.sources[0].filaments_per_s: [5, 20]
  - agents[0].vehicle.hold_s: {between: [0.5, 2]}
"""


def family(folder, *, seeds=SEEDS, vary=VARY, more=""):
    path = folder / "family.yaml"
    path.write_text(f"schema: gslcosim/family/1\nname: mine\nscenario: tiny_room\n{vary}{seeds}\n{more}")
    return load_family(path)


def refusal_text(folder, **settings):
    with pytest.raises(ScenarioError) as error:
        family(folder, **settings)
    return str(error.value)


def test_a_case_follows_from_its_seed_alone(tmp_path):
    mine = family(tmp_path)
    assert mine.values_of("training", 3) == family(tmp_path).values_of("training", 3)
    assert mine.cases("training", 2)[1].scenario == mine.case("training", 1).scenario
    assert mine.case("test", 2).scenario.seed == 32


def test_lists_of_one_item_go_together_and_numbers_stay_between(tmp_path):
    values = [family(tmp_path, seeds=SEEDS.replace("count: 5}, v", "count: 9}, v")).values_of("training", i)
              for i in range(9)]  # fmt: skip
    winds = {(tuple(each["wind.inlet_velocity_m_s"]), each["gas.sources[0].filaments_per_s"]) for each in values}
    assert winds == {((0.3, 0, 0), 5), ((0.6, 0, 0), 20)}
    holds_s = [each["agents[0].vehicle.hold_s"] for each in values]
    assert all(0.5 <= hold_s <= 2 for hold_s in holds_s)
    assert len(set(holds_s)) == 9


def test_splits_share_no_room(tmp_path):
    mine = family(tmp_path)
    rooms = [{mine.values_of(split, i)["environment.layout.seed"] for i in range(5)}
             for split in ("training", "validation", "test")]  # fmt: skip
    assert all(rooms)
    assert not rooms[0] & rooms[1]
    assert not rooms[1] & rooms[2]
    assert not rooms[0] & rooms[2]


def test_overlapping_seeds_are_refused(tmp_path):
    seeds = SEEDS.replace("first: 20", "first: 14")
    assert "expected seeds apart from those of training, which are 10 to 14, was 14 to 18" in refusal_text(
        tmp_path, seeds=seeds
    )


def test_a_seed_of_a_suite_is_refused(tmp_path):
    taken = max(collect_bundled_seeds())
    text = refusal_text(tmp_path, seeds=SEEDS.replace("{first: 30, count: 5}", f"{{first: {taken - 2}, count: 5}}"))
    assert "seeds.test" in text
    assert f"with {taken} of a suite among them" in text


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ({"more": "colour: red"}, "colour"),
        ({"vary": "vary: [{a: [1, 2], b: [1]}]\n"}, "lists of one length"),
        ({"vary": "vary: [{a: {between: [2, 1]}}]\n"}, "a number and a larger one"),
        ({"vary": "vary: [{a: {between: [0, 1], log: true}}]\n"}, "above 0"),
        ({"vary": "vary: [{a: [1]}, {a: [2]}]\n"}, "a twice"),
        ({"more": "doping: {power: -1}"}, "power"),
        ({"more": "doping: {floor: 1}"}, "doping.floor: expected a share below 1"),
        ({"vary": "vary: [{}]\n"}, "vary[0]: expected at least one path"),
        (
            {"vary": "vary: [{a: {rooms: 2, logs: true}}]\n"},
            "vary[0].a.logs: expected one of the keys values, between, log, rooms, was an unknown key. Did you mean "
            "log?",
        ),
        ({"vary": "vary: [{a: 5}]\n"}, "vary[0].a: expected a block with the keys values, between, log and rooms"),
        ({"vary": "vary: [{a: {between: [1]}}]\n"}, "vary[0].a.between: expected a list of 2 numbers, was [1]."),
    ],
)
def test_what_means_nothing_is_refused_by_its_place(tmp_path, change, expected):
    assert expected in refusal_text(tmp_path, **change)


def test_a_case_that_has_problems_is_reported_with_file_and_seed(tmp_path):
    mine = family(tmp_path, vary="vary: [{environment.layut.seed: {rooms: 2}}]\n")
    with pytest.raises(ScenarioError, match=r"family.yaml: seed 21 of validation: .*layut: expected one of the keys"):
        mine.case("validation", 1)


def test_more_cases_than_seeds_are_refused(tmp_path):
    with pytest.raises(UsageError, match="expected 1 to 5 cases for test"):
        family(tmp_path).cases("test", 6)


def test_an_unknown_family_is_reported_which_there_are():
    with pytest.raises(ScenarioError, match=r"open_halls.*Did you mean open_halls"):
        load_family("open_hall")


def test_doping_lets_hard_cases_come_more_often(tmp_path):
    mine = family(tmp_path, more="doping: {power: 2, floor: 0.1}")
    weights = mine.weights(np.array([0.2, 0.4, np.nan]))
    assert weights.sum() == pytest.approx(1.0)
    assert weights[0] < weights[1] == weights[2]
    assert weights[0] / weights[1] == pytest.approx(0.1 + 0.9 * 0.25)


@pytest.mark.parametrize("name", sorted(bundled_families()))
def test_cases_of_bundled_families_can_be_batched(name):
    from gslcosim_training.batch.case_builder import find_batch_refusal

    for split in ("training", "validation", "test"):
        assert find_batch_refusal(load_family(name).case(split, 0).scenario) is None
