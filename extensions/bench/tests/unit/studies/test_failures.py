"""Search for failures: what is drawn, what is ranked, and what failures have in common."""

import json
import shlex

import numpy as np
import pytest

from gslcosim.base.errors import ScenarioError, UsageError
from gslcosim_bench.studies.failure_output import (
    describe_common,
    draw_failures,
    failures_to_json,
    write_failures,
)
from gslcosim_bench.studies.failures import FailureFinder
from gslcosim_bench.studies.runner import StudyHost
from gslcosim_bench.studies.search_space import find_space

SENSOR = "agents[0].sensors[0].model=pid,tgs2600"
NO_HOST = StudyHost(start_pool=lambda: pytest.fail("nothing is flown"))
RATE = "gas.sources[0].filaments_per_s=3:30:log"


class SimulatedFinder(FailureFinder):
    """A finder whose method fails with a TGS2600 and whose oracle always finds the source; nothing is flown."""

    def _rows_of(self, cases, entry):
        self._n_runs += len(cases)
        return {case.name: self.row(case, entry) for case in cases}

    def row(self, case, entry):
        success = entry == "oracle" or case.levels[0] == 0
        start_m, source_m = case.places["agents[0].vehicle.start_m"], (1.0, 1.0)
        places = {f"{at}_{axis}_m": xy[i] for at, xy in (("start", start_m), ("source", source_m)) for i, axis in
                  enumerate("xy")}  # fmt: skip
        return {
            **places, "trial": f"{entry}/{case.name}", "entry": entry, "success": success, "score": 0.9 * success,
            "nearest_m": 0.5 if success else 2.0, "within_m": 0.8, "outcome": "success" if success else "time_limit",
            "time_s": 9.0, "first_contact_s": None,
        }  # fmt: skip


def searched(folder, *, budget=48, seed=0):
    space = find_space("tiny_room", [SENSOR, RATE])
    return SimulatedFinder(
        "surge_cast",
        space,
        budget=budget,
        seed=seed,
        folder=folder,
        host=NO_HOST,
    ).find()


@pytest.fixture(scope="module")
def search(tmp_path_factory):
    return searched(tmp_path_factory.mktemp("failures"))


def test_the_budget_is_kept_and_shared_between_random_cases_those_beside_failures_and_other_seeds(search):
    assert search.n_runs <= 48
    kinds = ["again" if each.case.again else "beside" if each.case.parent else "random" for each in search.outcomes]
    assert kinds == sorted(kinds, key=["random", "beside", "again"].index)
    assert set(kinds) == {"random", "beside", "again"}


def test_equal_calls_find_the_same_and_another_seed_others(search, tmp_path):
    assert failures_to_json(searched(tmp_path)) == failures_to_json(search)
    assert failures_to_json(searched(tmp_path, seed=1))["failures"] != failures_to_json(search)["failures"]


def test_failures_are_ranked_one_for_each_beginning_with_the_worst_first(search):
    roots = [each.outcome.case.root for each in search.failures]
    assert len(set(roots)) == len(roots) > 1
    severities = [each.severity for each in search.failures]
    assert severities == sorted(severities, reverse=True)
    assert all(each.outcome.is_failure and 0 < each.severity <= 0.9 for each in search.failures)
    assert search.failures[0].n_again == search.failures[0].n_again_failed == 2


def test_what_failures_have_in_common_is_found(search):
    """The sensor alone decides whether the simulated method fails."""
    best = search.contrasts[0]
    assert best.factor == "sensors[0].model"
    assert {best.rate.value, best.other.value} == {0.0, 1.0}
    assert "where sensors[0].model is tgs2600: 100 %" in describe_common(search)


def test_levels_stay_within_what_is_searched():
    sensor, rate = find_space("tiny_room", [SENSOR, RATE]).factors
    rng = np.random.default_rng(0)
    level = rate.draw(rng)
    for _ in range(200):
        level = rate.mutate(level, rng)
        assert 3 <= level <= 30
    assert {sensor.mutate(0, rng) for _ in range(20)} == {1}
    assert sensor.values(1) == {"agents[0].sensors[0].model": "tgs2600"}


def test_a_family_brings_its_values_and_its_random_sources():
    space = find_space("open_halls", [])
    names = [factor.name for factor in space.factors]
    assert names == ["layout.seed", "size_m", "inlet_velocity_m_s", "stability", "filaments_per_s"]
    assert space.place_paths == ("agents[0].vehicle.start_m", "gas.sources[0].position_m")
    assert find_space("tiny_room", []).place_paths == ("agents[0].vehicle.start_m",)


@pytest.mark.parametrize(
    ("source", "varied", "problem"),
    [
        ("open_hall", [], r"--in: expected a family or a scenario, .* was 'open_hall'. Did you mean open_halls"),
        ("open_halls", ["x"], r"--vary: expected PATH=LEAST:MOST, .* was 'x'"),
        ("open_halls", ["a.b=3:1"], r"was 'a.b=3:1'"),
        ("open_halls", ["a.b=0:1:log"], r"was 'a.b=0:1:log'"),
        ("open_halls", ["gas.plume.stability=A,B"], r"expected each value once, was gas.plume.stability twice"),
    ],
)
def test_what_cannot_be_searched_is_refused(source, varied, problem):
    with pytest.raises((UsageError, ScenarioError), match=problem):
        find_space(source, varied)


def test_a_budget_for_less_than_two_batches_and_an_unknown_method_are_refused(tmp_path):
    options = {"folder": tmp_path, "seed": 0, "host": NO_HOST}
    space = find_space("tiny_room", [])
    with pytest.raises(UsageError, match=r"--budget: expected at least 32 runs.* was 31"):
        FailureFinder("surge_cast", space, budget=31, **options)
    with pytest.raises(UsageError, match=r"METHOD: expected a bundled method .* was 'surge_cas'. Did you mean surge_c"):
        FailureFinder("surge_cas", space, budget=99, **options)


def test_the_report_names_each_case_with_its_command(search, tmp_path):
    page = write_failures(search, tmp_path, {}).read_text()
    text = (tmp_path / "failures.md").read_text()
    for each in search.failures[:8]:
        command = f"gslcosim bench show {shlex.quote(str(tmp_path))} --trial {each.outcome.row['trial'][:10]}"
        assert command in text
        assert each.outcome.case.name in page
    json.dumps(failures_to_json(search), allow_nan=False)
    assert "<script" not in page
    assert draw_failures(tmp_path, [each.outcome for each in search.failures]) == {}
