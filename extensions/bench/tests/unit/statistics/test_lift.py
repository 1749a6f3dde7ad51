import math

import numpy as np
import pytest

from gslcosim.base.errors import ShapeError
from gslcosim_bench.statistics.rates import difference_of_rates, lift, paired_difference_of_rates


def pairs_of(both, only_a, only_b, none):
    counts = [both, only_a, only_b, none]
    return np.repeat([True, True, False, False], counts), np.repeat([True, False, True, False], counts)


@pytest.mark.parametrize(
    ("counts", "ends"),
    [
        ((56, 70, 48, 80), (0.0524, 0.3339)),
        ((9, 10, 3, 10), (0.1705, 0.8090)),
        ((6, 7, 2, 7), (0.0582, 0.8062)),
        ((5, 56, 0, 29), (-0.0381, 0.1926)),
        ((0, 10, 0, 20), (-0.1611, 0.2775)),
    ],
)
def test_difference_of_newcombe_1998(counts, ends):
    """Newcombe 1998, method 10."""
    ours = difference_of_rates(*counts)
    assert (ours.low, ours.high) == pytest.approx(ends, abs=6e-5)


@pytest.mark.parametrize(
    ("table", "ends", "digits"),
    [((36, 12, 2, 0), (0.0569, 0.3404), 4), ((1, 1, 7, 12), (-0.507, -0.026), 3)],
)
def test_published_paired_differences(table, ends, digits):
    """Newcombe 1998 (paired data), method 10; Fagerland et al. 2014, airway data of Bentur et al."""
    ours = paired_difference_of_rates(*pairs_of(*table))
    assert (ours.low, ours.high) == pytest.approx(ends, abs=0.6 * 10.0**-digits)


def test_pairs_that_agree_narrow_the_interval():
    success, luck = pairs_of(40, 20, 5, 35)
    paired, unpaired = (lift(success, luck, paired=paired) for paired in (True, False))
    assert paired.value == unpaired.value == pytest.approx(0.15)
    assert paired.high - paired.low < 0.8 * (unpaired.high - unpaired.low)
    assert (paired.n, unpaired.n) == (100, 200)


def test_lift_stays_a_difference_of_rates():
    ours = lift(np.ones(5, dtype=bool), np.zeros(5, dtype=bool), paired=True)
    assert (ours.value, ours.high) == (1.0, 1.0)
    assert 0.0 < ours.low < 1.0


def test_lift_without_controls_is_undefined():
    assert math.isnan(lift(np.ones(3, dtype=bool), np.array([], dtype=bool), paired=False).value)
    assert math.isnan(lift(np.array([]), np.array([]), paired=True).value)
    with pytest.raises(ShapeError, match="success 3, luck 2"):
        lift(np.ones(3), np.ones(2), paired=True)
