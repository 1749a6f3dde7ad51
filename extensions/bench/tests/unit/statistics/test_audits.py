"""Audits: exact limits on false rows, and public draws that find them as often as is stated."""

import numpy as np
import pytest
from scipy import stats

from gslcosim.base.errors import ShapeError
from gslcosim_archive.audits import detection_probability, max_false_rows, required_draw
from gslcosim_bench.execution.verification import draw_trials

N_DRAWS = 1000


@pytest.mark.parametrize(("n_rows", "n_drawn", "n_found"), [(1000, 59, 0), (1000, 59, 2), (40, 7, 1), (12, 12, 3)])
def test_limits_are_those_of_the_hypergeometric_distribution(n_rows, n_drawn, n_found):
    """The largest number of false rows that is not rejected, one by one, with scipy."""
    possible = [k for k in range(n_rows + 1) if stats.hypergeom.cdf(n_found, n_rows, k, n_drawn) > 0.05]
    possible = [k for k in possible if n_found <= k <= n_rows - n_drawn + n_found]
    assert max_false_rows(n_rows, n_drawn, n_found) == max(possible)


def test_a_draw_is_as_large_as_a_limit_needs_and_no_larger():
    for n_rows, share in ((1000, 0.05), (1620, 0.02), (30, 0.1), (7, 0.05), (1, 0.5), (50, 0.0)):
        n = required_draw(n_rows, share)
        assert max_false_rows(n_rows, n, 0) <= share * n_rows
        assert n == 1 or max_false_rows(n_rows, n - 1, 0) > share * n_rows
    # In an endless table it would be 59 = ln 0.05 / ln 0.95.
    assert required_draw(20_000, 0.05) == 59
    # One false row among 50 is missed by 2 of 50 draws.
    assert required_draw(50, 0.0) == 48
    with pytest.raises(ShapeError):
        required_draw(0, 0.05)
    with pytest.raises(ShapeError):
        max_false_rows(10, 11, 0)


@pytest.mark.parametrize("n_false", [1, 6, 12, 40])
def test_false_rows_of_a_signed_folder_are_found_as_often_as_stated(n_false):
    """Whoever signs false rows is found by a public draw with the stated probability, wherever they stand."""
    n_rows = 240
    n_drawn = required_draw(n_rows, 0.05)
    rows = [f"{i:024x}" for i in range(n_rows)]
    rng = np.random.default_rng(n_false)
    found = n_covered = 0
    for beacon in range(N_DRAWS):
        false = set(rng.choice(rows, n_false, replace=False))
        n_found = len(false & set(draw_trials(rows, n_drawn, seed=f"{'0' * 64}\n{beacon}")))
        found += n_found > 0
        n_covered += n_false <= max_false_rows(n_rows, n_drawn, n_found)
    probability = detection_probability(n_rows, n_false, n_drawn)
    low, high = stats.binom.interval(0.999, N_DRAWS, probability)
    assert low <= found <= high, (found / N_DRAWS, probability)
    if n_false > 0.05 * n_rows:
        assert probability >= 0.95
    assert n_covered >= stats.binom.ppf(0.001, N_DRAWS, 0.95)


def test_a_draw_is_the_same_for_everybody_and_another_with_another_beacon():
    rows = [f"{i:024x}" for i in range(100)]
    draw = draw_trials(rows, 10, seed="head\nbeacon")
    assert draw == draw_trials(rows[::-1], 10, seed="head\nbeacon")
    assert draw[:5] == draw_trials(rows, 5, seed="head\nbeacon")
    assert set(draw) != set(draw_trials(rows, 10, seed="head\nbeacons"))
    assert sorted(draw_trials(rows, 1000, seed="")) == rows
