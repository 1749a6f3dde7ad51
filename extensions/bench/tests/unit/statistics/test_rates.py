import math

import pytest

from gslcosim.base.errors import ShapeError
from gslcosim_bench.statistics.rates import wilson

COUNTS = [(0, 1), (1, 1), (0, 10), (10, 10), (3, 10), (45, 90), (62, 90), (399, 400), (1000, 4320)]


@pytest.mark.parametrize(("successes", "n"), COUNTS)
@pytest.mark.parametrize("level", [0.9, 0.95, 0.999])
@pytest.mark.extras
def test_wilson_agrees_with_statsmodels(successes, n, level):
    from statsmodels.stats.proportion import proportion_confint

    ours = wilson(successes, n, level)
    assert (ours.low, ours.high) == pytest.approx(
        proportion_confint(successes, n, 1 - level, "wilson"), rel=1e-12, abs=1e-15
    )
    assert (ours.value, ours.n) == (successes / n, n)


@pytest.mark.parametrize(
    ("successes", "low", "high"),
    [(62, 0.587, 0.775), (19, 0.140, 0.306), (17, 0.121, 0.282), (14, 0.095, 0.244)],
)
def test_wilson_of_the_thesis_bars(successes, low, high):
    """The rates of the thesis that can be read, of 90 runs each."""
    ours = wilson(successes, 90)
    assert (ours.low, ours.high) == pytest.approx((low, high), abs=6e-4)


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


def test_more_successes_than_trials_are_refused():
    with pytest.raises(ShapeError, match="expected 0 to n = 3, was 4"):
        wilson(4, 3)
