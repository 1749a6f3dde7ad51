"""Difference to the null: what a suite names as null is what entries are compared with, case by case."""

import csv
from dataclasses import replace

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import synthetic

from gslcosim_bench.report.analysis import analyse
from gslcosim_bench.report.null_differences import compare_with_nulls
from gslcosim_bench.report.page import render_page
from gslcosim_bench.report.report_data import load_report_data
from gslcosim_bench.report.tables import write_summary, write_tables
from gslcosim_bench.store import TRIALS

# Chances of success by entry and scenario: each null is the better one in one of them.
RATES = {
    "guess": (0.6, 0.0),
    "reads": (0.1, 0.5),
    "good": (0.9, 0.8),
    "sham": (0.6, 0.5),
}
N_ROOMS, N_REPETITIONS = 10, 6


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    plan = synthetic.Plan(
        methods=synthetic.USUAL[:1], n_scenarios=1, repetitions=1, maps=False, tracks=False, controls_frac=0.0
    )
    made = synthetic.make_results(tmp_path_factory.mktemp("nulls") / "results", plan)
    template = pq.read_table(made / "trials.parquet").to_pylist()[0]
    rng, rows = np.random.default_rng(3), []
    for scenario in (0, 1):
        for room in range(N_ROOMS):
            for repetition in range(N_REPETITIONS):
                for entry, rates in RATES.items():
                    case = f"{'ab'[scenario]}_{room}"
                    rows.append({
                        **template, "trial": f"{case}_{repetition}_{entry}", "case": case, "repetition": repetition,
                        "scenario": "ab"[scenario], "family": f"family_{'ab'[scenario]}", "entry": entry,
                        "environment_hash": f"{10 * scenario + room:064x}", "is_control": False,
                        "success": bool(rng.random() < rates[scenario]),
                    })  # fmt: skip
    pq.write_table(pa.Table.from_pylist(rows, schema=TRIALS), made / "trials.parquet")
    return made


def with_nulls(folder, *names):
    """The results of a suite that names these nulls."""
    material = load_report_data(folder)
    return replace(material, suite={**material.suite, "nulls": list(names)})


def found_in(material) -> dict[tuple[str, str], tuple]:
    return {(each.part, material.entries[each.entry].name): each for each in compare_with_nulls(material)}


def test_a_method_is_compared_with_the_better_null_of_each_case(folder):
    material = with_nulls(folder, "guess", "reads")
    found = found_in(material)
    assert {name for _, name in found} == {"good", "sham"}
    assert {part for part, _ in found} == {"all", "family_a", "family_b"}
    good, sham = found["all", "good"], found["all", "sham"]
    assert good.difference.value == pytest.approx(0.3, abs=0.12)
    assert good.difference.low > 0.0
    assert good.p < 0.05
    assert sham.difference.low < 0.0 < sham.difference.high
    assert good.difference.value == pytest.approx(good.success.value - good.null.value)
    assert good.difference.n == 2 * N_ROOMS * N_REPETITIONS
    assert found["family_a", "good"].null.value == pytest.approx(0.6, abs=0.15)
    assert found["family_b", "good"].null.value == pytest.approx(0.5, abs=0.15)


def test_one_null_alone_is_its_own_rate(folder):
    material = with_nulls(folder, "guess")
    rows = material.rows
    own = rows.entry == [entry.name for entry in material.entries].index("guess")
    found = found_in(material)
    assert found["all", "good"].null.value == pytest.approx(rows["success"][own].mean())
    assert ("all", "reads") in found


def test_without_nulls_there_is_no_table(folder, tmp_path):
    analysis = analyse(load_report_data(folder))
    assert analysis.nulls == ()
    write_tables(analysis, tmp_path)
    assert not (tmp_path / "difference_to_null.csv").exists()
    assert "Difference to the null" not in render_page(analysis)
    assert found_in(with_nulls(folder, "nobody")) == {}


def test_table_page_and_summary_show_the_difference(folder, tmp_path):
    material = with_nulls(folder, "guess", "reads")
    analysis = analyse(material)
    write_tables(analysis, tmp_path)
    with (tmp_path / "difference_to_null.csv").open() as file:
        table = {(row["part"], row["entry"]): row for row in csv.DictReader(file)}
    assert float(table["all", "good"]["difference"]) > 0.1
    assert {part for part, _ in table} == {"all", "family_a", "family_b"}
    assert "Difference to the null" in render_page(analysis)
    assert "## Difference to the null" in write_summary(analysis)
