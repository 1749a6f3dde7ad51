"""Measures of agreement between predicted and measured concentrations."""

import numpy as np
import pytest

from gslcosim.base.errors import ShapeError
from gslcosim_validation.agreement import (
    agreement_estimate,
    factor_of_two_share,
    fractional_bias,
    normalised_mean_square_error,
)


def test_measures_by_hand():
    predicted, measured = np.array([1.0, 2.0, 6.0, 0.4]), np.array([1.0, 4.0, 2.0, 1.0])
    assert factor_of_two_share(predicted, measured) == 0.5
    assert fractional_bias(predicted, measured) == pytest.approx(2 * (2.0 - 2.35) / 4.35)
    assert normalised_mean_square_error(predicted, measured) == pytest.approx((0 + 4 + 16 + 0.36) / 4 / (2.0 * 2.35))


def test_two_nothings_agree_at_the_floor():
    assert factor_of_two_share(np.array([0.0]), np.array([0.004]), floor=0.01) == 1.0
    assert factor_of_two_share(np.array([0.0]), np.array([0.004])) == 0.0


def test_intervals_grow_where_pairs_share_their_weather():
    rng = np.random.default_rng(1)
    block = np.repeat(np.arange(20), 30)
    measured = np.exp(rng.normal(size=600))
    predicted = measured * np.exp(rng.normal(size=20))[block]
    together = agreement_estimate(fractional_bias, predicted, measured, block)
    alone = agreement_estimate(fractional_bias, predicted, measured, np.arange(600))
    assert together.high - together.low > 2.0 * (alone.high - alone.low)


def test_missing_values_are_refused():
    with pytest.raises(ShapeError, match="expected finite numbers"):
        agreement_estimate(fractional_bias, np.array([np.nan]), np.ones(1), np.zeros(1))
