import math

import pytest

from gslcosim_bench.statistics.rates import wilson


def test_wilson_of_newcombe_1998():
    """Newcombe 1998, Statistics in Medicine 17, 857, method 3."""
    published = {
        (81, 263): (0.2553, 0.3662),
        (15, 148): (0.0624, 0.1605),
        (0, 20): (0, 0.1611),
        (1, 29): (0.0061, 0.1718),
    }
    for counts, ends in published.items():
        ours = wilson(*counts)
        assert (ours.low, ours.high) == pytest.approx(ends, abs=6e-5)


def test_a_rate_of_no_trials_is_undefined():
    assert math.isnan(wilson(0, 0).value)
