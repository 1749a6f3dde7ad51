"""The study that tunes methods with one budget each: its table of ranges, its commands, and what it writes."""

import csv
import importlib.util
import json
import sys
from pathlib import Path

import pytest
import yaml

from gslcosim_bench.cases.suite_files import load_suite
from gslcosim_bench.studies.target import find_target, parse_ranges
from gslcosim_bench.studies.tuning import split_budget

SCRIPT = Path(__file__).parents[5] / "docs" / "studies" / "equal_tuning.py"


@pytest.fixture(scope="module")
def study():
    spec = importlib.util.spec_from_file_location("equal_tuning", SCRIPT)
    module = importlib.util.module_from_spec(spec)
    # Dataclasses look their module up.
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def plan(study):
    return study.TuningPlan(**yaml.safe_load(study.TABLE.read_text()))


def test_each_method_has_three_numbers_of_its_card_with_the_default_in_range(plan):
    for name, texts in plan.methods.items():
        subject = find_target("tiny_room", name)
        ranges = parse_ranges(texts, subject)
        assert len(ranges) == 3, name
        outside = [each.name for each in ranges if not each.holds(subject.default_of(each.name))]
        assert not outside, name


def test_the_budget_is_twelve_settings_and_a_validation(plan):
    budget = split_budget(plan.budget, plan.flights_per_setting)
    assert (budget.n_settings, budget.per_validation) == (12, 16)


def test_the_command_names_suite_ranges_and_budget(study, plan, tmp_path):
    command = study.tune_command(plan, "infotaxis", tmp_path / "infotaxis")
    assert command[1:6] == ["-m", "gslcosim", "bench", "tune", "open_2026"]
    assert command.count("--range") == 3
    assert command[command.index("--budget") + 1] == "160"


def estimate(value):
    return {"value": value, "low": value - 0.1, "high": value + 0.1}


def write_tuning(folder, parameters, *, validation=None):
    folder.mkdir()
    fields = {
        "budget": {"used": 152}, "default": {"score": estimate(0.2)}, "best": {"score": estimate(0.5)},
        "validation": validation, "parameters": parameters,
    }  # fmt: skip
    (folder / "tuning.json").write_text(json.dumps(fields))


def test_suite_and_table_have_each_method_as_it_is_and_tuned(study, plan, tmp_path):
    validation = {"best": {"score": estimate(0.4)}, "default": {"score": estimate(0.1)}, "p": 0.03}
    write_tuning(
        tmp_path / "infotaxis", {"mass": 0.5, "power": 0.4}, validation=validation | {"difference": estimate(0.3)}
    )
    write_tuning(tmp_path / "surge_cast", {})
    study.write_tables(plan, tmp_path)
    suite = load_suite(str(tmp_path / "suite.yaml"), is_flown=True).suite
    assert [entry.name for entry in suite.entries] == ["infotaxis", "infotaxis_tuned", "surge_cast"]
    assert suite.entries[1].parameters == {"mass": 0.5, "power": 0.4}
    first, second = csv.DictReader((tmp_path / "tuning.csv").read_text().splitlines())
    assert (first["method"], first["parameters"]) == ("infotaxis", "mass=0.5 power=0.4")
    assert [first[key] for key in ("validation_default", "difference", "low", "p")] == [
        "0.100", "0.300", "0.200", "0.030",
    ]  # fmt: skip
    assert (second["parameters"], second["validation_best"]) == ("default", "")
