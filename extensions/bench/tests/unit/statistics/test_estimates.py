import math

import numpy as np
import pytest

from gslcosim.base.errors import ShapeError
from gslcosim_bench.statistics.estimates import (
    UNDEFINED,
    Estimate,
    as_finite_row,
    check_same_length,
    percentile_interval,
)


def test_an_interval_with_zero_at_its_end_holds_zero():
    assert Estimate(0.1, 0.0, 0.2, 9).holds_zero
    assert not Estimate(0.1, 0.05, 0.2, 9).holds_zero
    assert not Estimate(-0.1, -0.2, -0.05, 9).holds_zero
    assert UNDEFINED.holds_zero


def test_percentile_interval_of_evenly_spaced_draws():
    assert percentile_interval(np.arange(1000.0)[::-1]) == (25.0, 974.0)


def test_percentile_interval_of_few_trials_is_wider():
    """Hesterberg 2015: for ten values 1.2 % of the draws are left on each side in place of 2.5 %."""
    assert percentile_interval(np.arange(10_000.0), freedom=9) == (118.0, 9881.0)
    assert percentile_interval(np.arange(1000.0), freedom=10**6) == pytest.approx((25.0, 974.0), abs=1.0)
    assert math.isnan(percentile_interval(np.arange(10.0), freedom=0)[0])


def test_percentile_interval_takes_infinite_draws_and_leaves_out_undefined_ones():
    draws = np.array([1.0] * 50 + [math.inf] * 50 + [math.nan] * 7)
    assert percentile_interval(draws) == (1.0, math.inf)
    assert all(math.isnan(end) for end in percentile_interval(np.full(3, math.nan)))


def test_what_is_not_a_row_of_finite_numbers_is_refused():
    with pytest.raises(ShapeError, match="x: expected finite numbers, 1 of 2"):
        as_finite_row(np.array([1.0, math.inf]), "x")
    with pytest.raises(ShapeError, match="one dimension, had 2"):
        as_finite_row(np.zeros((2, 2)), "x")
    with pytest.raises(ShapeError, match="a 2, b 3"):
        check_same_length(a=np.zeros(2), b=np.zeros(3))
