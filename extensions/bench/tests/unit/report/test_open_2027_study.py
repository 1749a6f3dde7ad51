"""The pilot of the open comparison of 2027: scenarios that a null solves are named, from results never flown."""

import importlib.util
import re
import sys
from dataclasses import replace
from pathlib import Path

import pytest
import synthetic

SCRIPT = Path(__file__).parents[5] / "docs" / "studies" / "open_2027.py"
GUESS = synthetic.Method(name="blind_guess", success=0.02, declares=1.0)
READS = synthetic.Method(name="sweep_largest", success=0.35, declares=1.0)


@pytest.fixture(scope="module")
def study():
    spec = importlib.util.spec_from_file_location("open_2027", SCRIPT)
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


def results(tmp_path, reads=READS, repetitions=8):
    plan = synthetic.Plan(
        methods=(GUESS, reads), n_scenarios=2, starts_m=synthetic.STARTS_M[-2:], maps=False, tracks=False,
        repetitions=repetitions, harder=0.0,
    )  # fmt: skip
    return synthetic.make_results(tmp_path / "results", plan)


def printed(study, folder, monkeypatch, capsys) -> tuple[str, int]:
    named = study.load_report_data

    def with_nulls(path):
        material = named(path)
        return replace(material, suite={**material.suite, "nulls": ["blind_guess", "sweep_largest"]})

    monkeypatch.setattr(study, "load_report_data", with_nulls)
    monkeypatch.setattr(sys, "argv", ["open_2027.py", str(folder)])
    with pytest.raises(SystemExit) as end:
        study.main()
    return capsys.readouterr().out, int(end.value.code)


def test_scenarios_that_no_null_solves_stay(study, tmp_path, monkeypatch, capsys):
    text, status = printed(study, results(tmp_path), monkeypatch, capsys)
    assert status == 0
    assert re.findall(r"^\| `(\w+)` \|.* \| 16 \| no \|$", text, re.MULTILINE) == ["room_1", "room_2"]


def test_a_scenario_that_a_null_solves_in_more_than_half_is_to_be_redrawn(study, tmp_path, monkeypatch, capsys):
    text, status = printed(study, results(tmp_path, replace(READS, success=0.9)), monkeypatch, capsys)
    assert status == 1
    assert len(re.findall(r"\*\*yes\*\* \|$", text, re.MULTILINE)) == 2


def test_few_flights_are_no_reason_to_redraw_but_to_fly_more(study, tmp_path, monkeypatch, capsys):
    folder = results(tmp_path, replace(READS, success=1.0), repetitions=2)
    text, status = printed(study, folder, monkeypatch, capsys)
    assert status == 1
    assert len(re.findall(r"\| 4 \| \*\*more flights\*\* \|$", text, re.MULTILINE)) == 2
