"""Figures of a setting: failures count, pairs are pairs, and no interval is told where no spread is seen."""

import importlib.util
import math
from pathlib import Path

import numpy as np
import pytest

from gslcosim.benchmark.statistics.aggregates import stratified_bootstrap
from gslcosim.benchmark.statistics.rates import wilson
from gslcosim.benchmark.tuning.figures import difference_of, figures_of, flights_of, p_of

spec = importlib.util.spec_from_file_location("tuning_rows", Path(__file__).parent / "rows.py")
rows = importlib.util.module_from_spec(spec)
spec.loader.exec_module(rows)


def scored(scores, **where):
    return flights_of(rows.row(score=score, repetition=i, success=score > 0, **where) for i, score in enumerate(scores))


def test_flights_without_result_count_as_failures():
    figures = figures_of(flights_of([rows.row(repetition=0), rows.lost(repetition=1)]))
    assert (figures.n, figures.n_without_result) == (2, 1)
    assert figures.success == wilson(1, 2)
    assert figures.score.value == pytest.approx(0.375)
    assert figures.time_s.value == pytest.approx(15.0)


def test_the_mean_score_has_the_interval_of_draws_within_cases():
    some = [rows.row(case=case, repetition=i, score=s) for case in "ab" for i, s in enumerate((0.5, 0.7, 0.9))]
    expected = stratified_bootstrap(np.array([0.5, 0.7, 0.9] * 2), np.repeat(["a", "b"], 3))
    assert figures_of(flights_of(some)).score == expected


def test_cells_of_one_flight_are_joined_so_that_they_show_spread():
    some = [rows.row(case=f"room/start={i}", score=0.5 + i / 10) for i in range(4)]
    assert list(flights_of(some).strata) == ["room"] * 4
    apart = [rows.row(case=f"room_{i}", score=0.5 + i / 10) for i in range(4)]
    assert flights_of(apart).strata is None
    assert figures_of(flights_of(apart)).score.low < 0.65 < figures_of(flights_of(apart)).score.high


def test_plumes_are_drawn_whole_where_there_are_enough_and_they_are_shared():
    shared = [rows.row(case=case, repetition=i) for case in "ab" for i in range(5)]
    assert len(set(flights_of(shared).clusters)) == 5
    assert flights_of(shared[:5]).clusters is None
    assert flights_of(row for row in shared if row["repetition"] < 4).clusters is None


def test_pairs_do_not_depend_on_the_order_of_rows():
    a = [rows.row("a", repetition=i, score=0.5 + 0.01 * i) for i in range(8)]
    b = [rows.row("b", repetition=i, score=0.45 + 0.012 * i) for i in range(8)]
    turned = difference_of(flights_of(a[::-1]), flights_of(b))
    assert turned == difference_of(flights_of(a), flights_of(b))
    assert turned.value == pytest.approx(0.05 - 0.002 * 3.5)
    assert turned.low < turned.value < turned.high


def test_no_interval_is_told_where_all_flights_are_equal():
    nothing = scored([0.0, 0.0, 0.0])
    assert math.isnan(figures_of(nothing).score.low)
    same = difference_of(scored([0.6, 0.7]), scored([0.6, 0.7]))
    assert same.value == 0
    assert same.holds_zero


def test_two_flights_show_no_difference_however_narrow_their_interval():
    a, b = scored([0.8, 0.9]), scored([0.6, 0.8])
    assert not difference_of(a, b).holds_zero
    assert p_of(a, b) == 0.5
