"""What the report says of criteria that need no olfaction, and of runs that are valid with warnings."""

from dataclasses import replace

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import synthetic

from gslcosim_bench.report.analysis import analyse
from gslcosim_bench.report.report_data import load_report_data
from gslcosim_bench.report.tables import describe_provenance
from gslcosim_bench.report.validity import describe_validity

SWEEP = synthetic.Method(name="sweep", success=0.8, mean_s=90.0)
CASTING = synthetic.Method(name="casting", success=0.8, mean_s=60.0)
PLAN = synthetic.Plan(
    methods=(SWEEP, CASTING, synthetic.ORACLE), n_scenarios=1, repetitions=8, controls_frac=0.0, n_points=12, maps=False
)


def sentences(folder, *methods, warnings=(), repetitions=8):
    """Return what a report of results of these methods says."""
    synthetic.make_results(folder, replace(PLAN, methods=(*methods, synthetic.ORACLE), repetitions=repetitions))
    if warnings:
        table = pq.read_table(folder / "trials.parquet")
        texts = pa.array([*warnings, *[""] * (len(table) - len(warnings))])
        table = table.set_column(table.schema.get_field_index("warnings"), "warnings", texts)
        pq.write_table(table, folder / "trials.parquet")
    analysis = analyse(load_report_data(folder))
    found = describe_validity(analysis)
    assert set(found) <= set(describe_provenance(analysis).warnings)
    # Views of many entries have no pairs.
    assert describe_validity(replace(analysis, views=tuple(replace(v, pairs=()) for v in analysis.views))) == found
    return found


def test_a_criterion_that_a_blind_sweep_meets_as_often_is_named(tmp_path):
    (text,) = sentences(tmp_path, SWEEP, CASTING, repetitions=40)
    assert text.startswith("No olfaction is needed in all cases: sweep, which is blind, finds the source in")
    assert "casting, the best of the others" in text


@pytest.mark.parametrize(
    "methods",
    [(replace(SWEEP, success=0.6), replace(CASTING, success=1.0)), (replace(SWEEP, success=0.1), CASTING), (CASTING,),
     (SWEEP, CASTING)],
    ids=["clearly worse", "hardly ever", "not flown", "not told apart in few runs"],
)  # fmt: skip
def test_nothing_is_said_where_the_blind_one_is_worse_absent_or_not_told_apart(tmp_path, methods):
    assert sentences(tmp_path, *methods) == []


def test_a_null_says_nothing_of_the_need_for_a_nose(tmp_path):
    synthetic.make_results(tmp_path, replace(PLAN, methods=(SWEEP, CASTING, synthetic.ORACLE), repetitions=40))
    material = load_report_data(tmp_path)
    named = replace(material, suite={**material.suite, "nulls": ["sweep"]})
    assert len(describe_validity(analyse(material))) == 1
    assert describe_validity(analyse(named)) == []


def test_warnings_of_runs_are_counted_by_what_they_are_about(tmp_path):
    wind, refused = "wind: The wind has not settled.", "commands: The vehicle refused all."
    (text,) = sentences(tmp_path, CASTING, warnings=(wind, f"{wind}\n{refused}"))
    assert text.startswith("2 of ")
    assert "(wind in 2, commands in 1)" in text
    assert text.endswith("The first: wind: The wind has not settled.")
