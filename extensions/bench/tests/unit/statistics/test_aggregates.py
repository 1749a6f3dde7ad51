import math

import numpy as np
import pytest
from scipy import stats

from gslcosim.base.errors import ShapeError
from gslcosim_bench.statistics.aggregates import (
    bootstrap_cells,
    bootstrap_worst_quarter,
)
from gslcosim_bench.statistics.estimates import bootstrap_mean
from gslcosim_bench.statistics.pairs import paired_difference


def test_bootstrap_of_a_mean_agrees_with_scipy():
    values = np.random.default_rng(0).gamma(2.0, size=120)
    ours = bootstrap_mean(values)
    theirs = stats.bootstrap((values,), np.mean, method="percentile", rng=1).confidence_interval
    assert (ours.low, ours.high) == pytest.approx((theirs.low, theirs.high), abs=0.03)
    assert ours.value == pytest.approx(values.mean())


def test_differences_between_strata_do_not_widen_the_interval():
    """Rows of two very different cells; only the spread inside the cells counts."""
    rng = np.random.default_rng(1)
    strata = np.repeat([0, 1], 50)
    values = 100.0 * strata + rng.normal(size=100)
    ours = bootstrap_mean(values, strata)
    assert ours.high - ours.low == pytest.approx(2 * 1.96 / math.sqrt(100), rel=0.2)
    assert bootstrap_mean(values).high - ours.low > 5.0


def test_entries_with_the_same_cells_get_the_same_draws():
    """A constant added to an entry moves its interval by that constant, to rounding."""
    values, strata = np.random.default_rng(2).normal(size=60), np.repeat(np.arange(6), 10)
    a, b = (bootstrap_cells(some, strata) for some in (values, values + 1.0))
    assert (b.low, b.high) == pytest.approx((a.low + 1.0, a.high + 1.0))
    assert a == bootstrap_cells(values, strata)
    assert a != bootstrap_cells(values, strata, rng=np.random.default_rng(7))


def test_each_cell_counts_the_same():
    values, cells = np.array([1.0, 1.0, 1.0, 0.0]), np.array(["a", "a", "a", "b"])
    assert bootstrap_cells(values, cells).value == pytest.approx(0.5)
    assert bootstrap_mean(values, cells).value == pytest.approx(0.75)


def test_a_cell_counts_as_often_as_its_room_was_drawn():
    """Eight rooms of one cell: the mean of cells is that of rooms, and its interval that of a bootstrap of rooms."""
    rooms = np.repeat(np.arange(8), 5)
    values = rooms + np.random.default_rng(4).normal(size=40)
    ours = bootstrap_cells(values, rooms, clusters=rooms)
    alone = bootstrap_mean(np.array([values[rooms == room].mean() for room in range(8)]), None)
    assert (ours.value, ours.low, ours.high) == pytest.approx((alone.value, alone.low, alone.high))


def test_the_worst_quarter_is_that_of_the_cells_and_its_interval_of_no_others():
    """Where each draw chose its worst cells, the interval reached to 0.9."""
    cells = np.repeat(np.arange(12), 2)
    values = np.repeat([0.9, 0.1, 0.5, 0.7, 0.3, *[0.9] * 7], 2)
    found = bootstrap_worst_quarter(values, cells, clusters=cells)
    assert found.value == pytest.approx(0.3)
    assert (found.low, found.high) == pytest.approx((0.1, 0.5))


def test_strata_of_few_clusters_keep_their_weight():
    """Two rooms of ten and of three plumes; where small strata counted less, intervals left the mean out."""
    case = np.repeat([0, 1, 2, 3], [10, 10, 3, 3])
    plume = np.concatenate([np.tile(np.arange(10), 2), np.tile(10 + np.arange(3), 2)])
    values = np.where(case < 2, 0.9, 0.3) + np.random.default_rng(5).normal(0.0, 0.03, 26)
    strata = case // 2
    for ours in (
        bootstrap_cells(values, case, clusters=plume, strata=strata),
        bootstrap_mean(values, strata, clusters=plume),
        paired_difference(values, np.zeros(26), clusters=plume, strata=strata),
    ):  # fmt: skip
        assert ours.low < ours.value < ours.high
        assert ours.high - ours.low < 0.1
    assert bootstrap_cells(values, case).value == pytest.approx(0.6, abs=0.02)


def test_what_is_undefined_or_refused():
    assert math.isnan(bootstrap_mean(np.array([]), None).value)
    assert math.isnan(bootstrap_cells(np.array([]), np.array([])).value)
    assert math.isnan(bootstrap_worst_quarter(np.array([]), np.array([])).value)
    with pytest.raises(ShapeError, match="rows 3, labels 2"):
        bootstrap_mean(np.zeros(3), np.zeros(2))
