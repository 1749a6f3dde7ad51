"""Figures of a setting: failures count, pairs are pairs, and no interval is reported where no spread is seen."""

import importlib.util
import math
from pathlib import Path

import numpy as np
import pytest

from gslcosim_bench.statistics.estimates import bootstrap_mean
from gslcosim_bench.statistics.rates import wilson
from gslcosim_bench.statistics.settings import compute_difference, compute_figures, group_runs, paired_p_value

spec = importlib.util.spec_from_file_location("tuning_rows", Path(__file__).parent / "rows.py")
rows = importlib.util.module_from_spec(spec)
spec.loader.exec_module(rows)


def scored(scores, **where):
    return group_runs(rows.row(score=score, repetition=i, success=score > 0, **where) for i, score in enumerate(scores))


def test_runs_without_result_count_as_failures():
    figures = compute_figures(group_runs([rows.row(repetition=0), rows.lost(repetition=1)]))
    assert (figures.n, figures.n_without_result) == (2, 1)
    assert figures.success == wilson(1, 2)
    assert figures.score.value == pytest.approx(0.375)
    assert figures.time_s.value == pytest.approx(15.0)


def test_the_mean_score_has_the_interval_of_draws_within_cases():
    some = [rows.row(case=case, repetition=i, score=s) for case in "ab" for i, s in enumerate((0.5, 0.7, 0.9))]
    expected = bootstrap_mean(np.array([0.5, 0.7, 0.9] * 2), np.repeat(["a", "b"], 3))
    assert compute_figures(group_runs(some)).score == expected


def test_cells_of_one_run_are_joined_so_that_they_show_spread():
    some = [rows.row(case=f"room/start={i}", score=0.5 + i / 10) for i in range(4)]
    assert set(group_runs(some).units.stratum) == {0}
    apart = [rows.row(case=f"room_{i}", score=0.5 + i / 10) for i in range(4)]
    assert set(group_runs(apart).units.stratum) == {0}
    assert compute_figures(group_runs(apart)).score.low < 0.65 < compute_figures(group_runs(apart)).score.high


def test_plumes_are_drawn_whole_where_there_are_enough():
    shared = [rows.row(case=case, repetition=i) for case in "ab" for i in range(6)]
    assert (group_runs(shared).units.level, group_runs(shared).units.n) == ("plumes", 6)
    few = group_runs(row for row in shared if row["repetition"] < 5).units
    assert (few.level, few.clusters) == ("flights", None)


def test_pairs_do_not_depend_on_the_order_of_rows():
    a = [rows.row("a", repetition=i, score=0.5 + 0.01 * i) for i in range(8)]
    b = [rows.row("b", repetition=i, score=0.45 + 0.012 * i) for i in range(8)]
    turned = compute_difference(group_runs(a[::-1]), group_runs(b))
    assert turned == compute_difference(group_runs(a), group_runs(b))
    assert turned.value == pytest.approx(0.05 - 0.002 * 3.5)
    assert turned.low < turned.value < turned.high


def test_no_interval_is_reported_where_all_runs_are_equal():
    nothing = scored([0.0, 0.0, 0.0])
    assert math.isnan(compute_figures(nothing).score.low)
    same = compute_difference(scored([0.6, 0.7]), scored([0.6, 0.7]))
    assert same.value == 0
    assert same.holds_zero


def test_two_runs_show_no_difference_however_narrow_their_interval():
    a, b = scored([0.8, 0.9]), scored([0.6, 0.8])
    assert not compute_difference(a, b).holds_zero
    assert paired_p_value(a, b) == 0.5
