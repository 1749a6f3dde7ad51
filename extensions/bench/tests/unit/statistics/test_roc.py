import math

import numpy as np
import pytest
from scipy import optimize, stats

from gslcosim_bench.statistics.roc import localisation_roc, roc

# Ratings 1 to 5 of CT images of 58 normal and 51 abnormal patients, Hanley and McNeil 1982, table I.
RATING = np.repeat(np.tile(np.arange(1.0, 6.0), 2), [33, 6, 6, 11, 2, 3, 2, 2, 11, 33])
ABNORMAL = np.repeat([False, True], [58, 51])


def test_area_is_mann_whitneys_and_that_under_the_curve():
    ours = roc(RATING, ABNORMAL)
    u = stats.mannwhitneyu(RATING[ABNORMAL], RATING[~ABNORMAL]).statistic
    assert ours.area.value == pytest.approx(u / (51 * 58))
    assert np.trapezoid(ours.true_positive, ours.false_positive) == pytest.approx(ours.area.value)


def test_interval_is_delongs_on_the_logit_scale():
    psi = (RATING[ABNORMAL][:, None] > RATING[~ABNORMAL]) + 0.5 * (RATING[ABNORMAL][:, None] == RATING[~ABNORMAL])
    area = psi.mean()
    variance = psi.mean(axis=1).var(ddof=1) / 51 + psi.mean(axis=0).var(ddof=1) / 58
    half = 1.959964 * math.sqrt(variance) / (area * (1 - area))
    logit = math.log(area / (1 - area))
    expected = [1 / (1 + math.exp(-end)) for end in (logit - half, logit + half)]
    ours = roc(RATING, ABNORMAL).area
    assert (ours.low, ours.high) == pytest.approx(expected, rel=1e-6)


def test_the_curve_runs_from_corner_to_corner():
    ours = roc(np.array([0.9, 0.9, 0.1, 0.0, 0.0]), np.array([True, False, True, False, False]))
    assert list(ours.threshold) == [math.inf, 0.9, 0.1, 0.0]
    assert ours.false_positive == pytest.approx([0, 1 / 3, 1 / 3, 1])
    assert ours.true_positive == pytest.approx([0, 0.5, 1, 1])


def test_a_perfect_area_is_not_certain():
    """Newcombe's interval: the lower end solves (1 - t)^2 = z^2 V(t)."""
    ours = roc(np.array([1.0] * 10 + [0.0] * 20), np.repeat([True, False], [10, 20])).area

    def excess(t):
        more = 15 - 1
        return (1 - t) ** 2 - 1.959964**2 * t * (1 - t) / 200 * (1 + more * (1 - t) / (2 - t) + more * t / (1 + t))

    assert (ours.value, ours.high) == pytest.approx((1.0, 1.0))
    assert ours.low == pytest.approx(optimize.brentq(excess, 0.3, 0.999), abs=1e-6)
    worst = roc(np.array([0.0] * 10 + [1.0] * 20), np.repeat([True, False], [10, 20])).area
    assert (worst.value, worst.low, worst.high) == pytest.approx((0.0, 0.0, 1.0 - ours.low))


def test_without_controls_the_area_is_undefined():
    ours = roc(np.array([0.3, 0.4]), np.array([True, True]))
    assert math.isnan(ours.area.value)
    assert np.all(np.isnan(ours.false_positive))


def test_a_declaration_elsewhere_never_counts_as_found():
    score = np.array([0.9, 0.8, 0.7, 0.0])
    ours = localisation_roc(score, np.array([True, True, False, False]), np.array([True, False, False, False]))
    assert ours.true_positive[-1] == pytest.approx(0.5)
    assert ours.area.value == pytest.approx(0.5)
    assert roc(score, np.array([True, True, False, False])).area.value == 1.0
