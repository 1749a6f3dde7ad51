"""Sweeps from rows: points, reference, and the files that tell them."""

import csv
import importlib.util
import json
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest

from gslcosim.base.errors import UsageError
from gslcosim.bench.studies.output import draw_response_svg, sweep_to_csv, sweep_to_json, to_inline_yaml
from gslcosim.bench.studies.sweep import SweepPlan
from gslcosim.bench.studies.target import find_target
from gslcosim.cli.study_output import format_sweep

spec = importlib.util.spec_from_file_location("tuning_rows", Path(__file__).parent / "rows.py")
rows = importlib.util.module_from_spec(spec)
spec.loader.exec_module(rows)

SVG = "{http://www.w3.org/2000/svg}"


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


@pytest.mark.parametrize(
    ("varied", "marks"),
    [
        ({"leg_m": (0.05, 0.8, 5.0)}, {"circle": 9, "polyline": 3}),
        ({"wall_rule": ("random", "bounce")}, {"circle": 6, "polyline": 0}),
        ({"leg_m": (0.4,)}, {"circle": 3}),
        ({"leg_m": (0.4, 0.8), "wall_rule": ("random", "bounce")}, {"rect": 13}),
        ({"leg_m": (0.4, 0.8), "eps": (0.0, 0.1), "zigzag_rad": (0.5, 1.0)}, {"circle": 24}),
    ],
)
def test_the_drawing_has_a_mark_for_each_figure(subject, varied, marks):
    root = ElementTree.fromstring(draw_response_svg(swept(subject, **varied)))
    assert {name: len(root.findall(f".//{SVG}{name}")) for name in marks} == marks
    words = [text.text for text in root.iter(f"{SVG}text")]
    assert "dung_beetle in tiny_room" in words
    assert all(any(name in (word or "") for word in words) for name in varied)
    width, height = (float(root.get(side)) for side in ("width", "height"))
    assert all(0 <= float(each.get("cx")) <= width for each in root.iter(f"{SVG}circle"))
    assert all(0 <= float(each.get("cy")) <= height for each in root.iter(f"{SVG}circle"))


def test_values_that_span_much_are_drawn_by_their_logarithms(subject):
    root = ElementTree.fromstring(draw_response_svg(swept(subject, leg_m=(0.1, 1.0, 10.0))))
    x = [float(each.get("cx")) for each in root.iter(f"{SVG}circle")][:3]
    assert x[1] - x[0] == pytest.approx(x[2] - x[1])
    assert any("logarithmic" in (text.text or "") for text in root.iter(f"{SVG}text"))


def test_the_table_shows_n_intervals_and_the_reference(subject):
    text = format_sweep(swept(subject, leg_m=(0.4, 0.8)), Path("results/x"))
    assert "LEG_M   N   SUCCESS %" in text
    assert "0.8     4   100 (51 to 100)" in text
    assert "paired, from the default" in text
    assert text.splitlines()[-1] == "Results: results/x (sweep.svg, sweep.csv, sweep.json)"


def test_parameters_are_yaml_that_can_be_pasted():
    values = {"step_m": 0.5, "n": 3, "on": True, "word": "yes", "list": (1, 2.5)}
    assert to_inline_yaml(values) == '{step_m: 0.5, n: 3, on: true, word: "yes", list: [1, 2.5]}'
