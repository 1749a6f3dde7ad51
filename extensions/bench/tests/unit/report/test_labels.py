"""Success by label: an axis that breaks a method is seen beside the core, mixtures are kept out of that comparison."""

import csv
import json
from dataclasses import replace

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import synthetic

from gslcosim_bench.report.analysis import analyse
from gslcosim_bench.report.labels import compare_levels
from gslcosim_bench.report.page import render_page
from gslcosim_bench.report.report_data import load_report_data
from gslcosim_bench.report.tables import write_tables
from gslcosim_bench.store import TRIALS

# Labels, cases and the rate of success of a case: wind breaks the method, the room does not; both at once fail.
LEVELS = (
    ({"wind": "steady", "room": "hall"}, 3, 0.9),
    ({"wind": "gusting", "room": "hall"}, 1, 0.2),
    ({"wind": "steady", "room": "racks"}, 1, 0.9),
    ({"wind": "gusting", "room": "racks"}, 1, 0.0),
)
N_REPETITIONS = 50


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    plan = synthetic.Plan(
        methods=synthetic.USUAL[:1], n_scenarios=1, repetitions=1, maps=False, tracks=False, controls_frac=0.0
    )
    made = synthetic.make_results(tmp_path_factory.mktemp("labels") / "results", plan)
    template = pq.read_table(made / "trials.parquet").to_pylist()[0]
    rows, rng = [], np.random.default_rng(3)
    for labels, n_cases, rate in LEVELS:
        for case in range(n_cases):
            for repetition in range(N_REPETITIONS):
                success = bool(rng.random() < rate)
                place = f"{'_'.join(labels.values())}_{case}"
                rows.append({
                    **template, "trial": f"{place}_{repetition}", "case": place, "repetition": repetition,
                    "varied": json.dumps({f"labels.{axis}": level for axis, level in labels.items()}),
                    "success": success, "time_within_1_m_s": 10.0,
                })  # fmt: skip
    pq.write_table(pa.Table.from_pylist(rows, schema=TRIALS), made / "trials.parquet")
    return made


def test_a_level_that_breaks_a_method_differs_from_the_core_and_others_do_not(folder):
    levels = {(each.axis, each.level): each for each in analyse(load_report_data(folder)).levels}
    assert set(levels) == {("wind", "steady"), ("wind", "gusting"), ("room", "hall"), ("room", "racks")}
    assert {key for key, each in levels.items() if each.is_core} == {("wind", "steady"), ("room", "hall")}
    assert levels["wind", "steady"].alone.n == 3 * N_REPETITIONS
    assert levels["wind", "gusting"].success.n == 2 * levels["wind", "gusting"].alone.n
    assert levels["wind", "gusting"].difference.high < -0.4
    assert levels["room", "racks"].difference.low < 0.0 < levels["room", "racks"].difference.high
    assert levels["room", "racks"].approach.value == 1.0
    assert np.isnan(levels["wind", "steady"].difference.value)


def test_differences_of_levels_are_no_surer_than_rooms_make_them(folder):
    """No run succeeds in one of ten rooms of the core and two of six of the level: single runs told these apart."""
    material = load_report_data(folder)
    rows, n = material.rows, N_REPETITIONS * 6
    room = np.arange(n) * 16 // n
    columns = {
        "environment_hash": np.array([f"{i:064x}" for i in room]), "case": np.array([f"case_{i}" for i in room]),
        "varied": np.array([json.dumps({"labels.wind": "steady" if i < 10 else "gusting"}) for i in room]),
        "success": ~np.isin(room, (3, 11, 12)),
    }  # fmt: skip
    changed = replace(rows, columns=dict(rows.columns) | columns)
    (difference,) = (each.difference for each in compare_levels(replace(material, rows=changed)) if not each.is_core)
    assert difference.value == pytest.approx(-7 / 30, abs=0.02)
    assert difference.high > 0.0


def test_the_table_and_the_page_show_each_level(folder, tmp_path):
    analysis = analyse(load_report_data(folder))
    write_tables(analysis, tmp_path)
    with (tmp_path / "success_by_label.csv").open() as file:
        table = list(csv.DictReader(file))
    assert {(row["axis"], row["level"]) for row in table} >= {("wind", "gusting"), ("room", "racks")}
    page = render_page(analysis)
    assert "What breaks a method" in page
    assert "gusting" in page


def test_approach_is_of_the_same_flights_as_the_core_and_a_suite_without_one_says_so(folder, tmp_path):
    material = load_report_data(folder)
    rows = material.rows
    varied = np.array([json.loads(text) for text in rows["varied"].tolist()])
    is_core = np.array([each == {"labels.wind": "steady", "labels.room": "hall"} for each in varied])

    def changed(**columns):
        return replace(material, rows=replace(rows, columns=dict(rows.columns) | columns))

    near = changed(time_within_1_m_s=np.where(is_core, 10.0, np.nan))
    levels = {(each.axis, each.level): each for each in compare_levels(near)}
    assert levels["wind", "steady"].approach.value == levels["room", "hall"].approach.value == 1.0
    assert levels["wind", "gusting"].approach.value == 0.0

    places = ("a2", "a3", "b1", "c1", "d1", "a4")
    cases = dict(zip(dict.fromkeys(rows["case"].tolist()), places, strict=True))
    labels = [json.dumps({"labels.wind": cases[case][0], "labels.room": cases[case][1]}) for case in rows["case"]]
    coreless = changed(varied=np.array(labels))
    assert "there is no core to compare with" in render_page(analyse(coreless))


def test_suites_without_labels_have_no_such_table(usual):
    analysis = analyse(load_report_data(usual))
    assert analysis.levels == ()
    assert not (usual / "tables" / "success_by_label.csv").exists()
    assert "What breaks a method" not in render_page(analysis)
