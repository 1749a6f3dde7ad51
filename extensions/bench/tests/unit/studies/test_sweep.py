"""Sweeps from rows: points, reference, and the files that tell them."""

import csv
import importlib.util
import json
from pathlib import Path

import pytest

from gslcosim.base.errors import UsageError
from gslcosim_bench.commands.study_output import format_sweep
from gslcosim_bench.studies.output import sweep_to_csv, sweep_to_json, to_inline_yaml
from gslcosim_bench.studies.sweep import SweepPlan
from gslcosim_bench.studies.target import find_target

spec = importlib.util.spec_from_file_location("tuning_rows", Path(__file__).parent / "rows.py")
rows = importlib.util.module_from_spec(spec)
spec.loader.exec_module(rows)


@pytest.fixture(scope="module")
def subject():
    return find_target("tiny_room", "dung_beetle")


def swept(subject, n=4, **varied):
    sweeper = SweepPlan(subject, varied)
    scores = [0.5 + 0.3 * k / len(sweeper.settings) for k in range(len(sweeper.settings))]
    return sweeper.sweep(
        [
            rows.row(setting.name, repetition=i, score=score + 0.02 * i * (1 + k))
            for k, (setting, score) in enumerate(zip(sweeper.settings, scores))
            for i in range(n)
        ]
    )


def test_settings_are_compared_with_the_default_where_it_was_run(subject):
    sweep = swept(subject, leg_m=(0.4, 0.8, 1.6))
    assert sweep.is_reference_default
    assert sweep.reference.parameters == {"leg_m": 0.8}
    assert [point.difference is None for point in sweep.points] == [False, True, False]
    assert sweep.points[0].difference.value == pytest.approx(-0.1 - 0.03)
    assert sweep.units == {"leg_m": "m"}


def test_settings_are_compared_with_the_first_otherwise(subject):
    sweep = swept(subject, leg_m=(0.4, 1.6))
    assert not sweep.is_reference_default
    assert sweep.reference.parameters == {"leg_m": 0.4}


def test_too_many_combinations_are_reported(subject):
    with pytest.raises(UsageError, match="at most 500 combinations, was 550"):
        SweepPlan(subject, {"leg_m": tuple(range(1, 11)), "eps": tuple(i / 200 for i in range(55))})


def test_json_and_csv_show_the_same(subject):
    sweep = swept(subject, leg_m=(0.4, 0.8), heading_memory=(True, False))
    fields = sweep_to_json(sweep)
    assert json.loads(json.dumps(fields, allow_nan=False)) == fields
    lines = list(csv.DictReader(sweep_to_csv(sweep).splitlines()))
    assert [line["heading_memory"] for line in lines] == ["true", "false", "true", "false"]
    for line, point in zip(lines, fields["points"], strict=True):
        assert (line["entry"], float(line["leg_m"])) == (point["entry"], point["parameters"]["leg_m"])
        for name in ("success", "score", "time_s"):
            assert float(line[name]) == point[name]["value"]
            assert float(line[f"{name}_high"]) == point[name]["high"]
    assert [line["difference"] == "" for line in lines] == [False, False, False, True]


def test_the_table_shows_n_intervals_and_the_reference(subject):
    text = format_sweep(swept(subject, leg_m=(0.4, 0.8)), Path("results/x"), None)
    assert "LEG_M   N   SUCCESS %" in text
    assert "0.8     4   100 (51 to 100)" in text
    assert "paired, from the default" in text
    assert text.splitlines()[-2:] == [
        "Results: results/x (sweep.csv, sweep.json)",
        "Report: gslcosim bench report results/x",
    ]


def test_parameters_are_yaml_that_can_be_pasted():
    values = {"step_m": 0.5, "n": 3, "on": True, "word": "yes", "list": (1, 2.5)}
    assert to_inline_yaml(values) == '{step_m: 0.5, n: 3, on: true, word: "yes", list: [1, 2.5]}'
