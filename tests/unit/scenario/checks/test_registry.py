"""The registry of checks: what it names is there, and what it chooses is what a caller asked for."""

import importlib
import inspect

import pytest

from gslcosim.scenario import load_scenario
from gslcosim.scenario.checks.registry import SUBJECTS, list_checks, list_file_kinds, list_scenario_checks

CHECKS = [check for kind in list_file_kinds() for check in list_checks(kind.name)]


@pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.name)
def test_every_check_names_a_function_of_content_and_folder(check):
    module, _, function = check.finder.partition(":")
    assert len(inspect.signature(getattr(importlib.import_module(module), function)).parameters) == 2


def test_checks_of_scenarios_have_a_subject_and_names_of_their_own():
    names = [check.name for check in CHECKS]
    assert len(set(names)) == len(names)
    assert {check.subject for check in CHECKS if check.of == "scenario"} == set(SUBJECTS)
    assert {check.subject for check in CHECKS if check.of != "scenario"} == {None}


def test_who_prepares_a_run_leaves_out_what_its_preparation_finds():
    n_checks = sum(check.of == "scenario" and not check.is_warning for check in CHECKS)
    n_prepared = sum(check.is_part_of_preparation for check in CHECKS)
    assert n_prepared > 0
    assert len(list_scenario_checks(prepares_run=False)) == n_checks
    assert len(list_scenario_checks()) == n_checks - n_prepared


def test_a_check_that_is_not_needed_imports_nothing():
    (drawing,) = (check for check in CHECKS if check.name == "drawing")
    loaded = load_scenario("tiny_room")
    blind = type(drawing)(name="x", of="scenario", finder="no.such:module", is_needed=drawing.is_needed)
    assert blind.find(loaded.scenario, loaded.directory) == ()


def test_demands_are_judged_by_how_the_caller_spreads_the_run():
    loaded = load_scenario("tiny_room", overrides=["agents[0].limits.memory_mb=500"])

    def problems(processes):
        checks = list_scenario_checks("machine", processes=processes)
        return [problem.where for check in checks for problem in check(loaded.scenario, loaded.directory)]

    assert problems("separate") == []
    assert problems("one") == ["agents[0].limits"]
