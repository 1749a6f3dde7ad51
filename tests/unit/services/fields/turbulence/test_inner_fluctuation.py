"""Gas within filaments: a factor of mean one with a Weibull distribution, that drifts with the wind."""

import math

import numpy as np
import pytest

from gslcosim_services.fields.turbulence.eddies import EddyScales
from gslcosim_services.fields.turbulence.inner_fluctuation import InnerFluctuation, weibull_shape

SCALES = EddyScales(length_m=2.0, time_s=2.0)


def factors(inner, points_m, time_s, wind_m_s=(1.0, 0.0, 0.0)):
    drift_m_s = np.full((1, 1, 1, 4), (*wind_m_s, 0.0), np.float32)
    return inner.factors_at(np.asarray(points_m, float), time_s, drift_m_s, (0.0, 0.0, 0.0), 0.5)


@pytest.mark.parametrize("intensity", [0.3, 0.65, 1.0])
def test_factors_have_mean_one_and_the_intensity(intensity):
    points_m = np.random.default_rng(1).random((3000, 3)) * 50.0
    found = np.concatenate(
        [factors(InnerFluctuation(SCALES, intensity=intensity, seed=seed), points_m, 9.0) for seed in range(8)]
    )
    assert found.min() >= 0.0
    assert found.mean() == pytest.approx(1.0, abs=0.03)
    assert found.std() == pytest.approx(intensity, rel=0.06)


def test_shape_of_an_exponential_distribution_is_one():
    assert weibull_shape(1.0) == pytest.approx(1.0)
    k = weibull_shape(0.65)
    assert math.gamma(1 + 2 / k) / math.gamma(1 + 1 / k) ** 2 == pytest.approx(1 + 0.65**2)


def test_without_intensity_nothing_changes():
    inner = InnerFluctuation(SCALES, intensity=0.0, seed=1)
    assert factors(inner, np.zeros((4, 3)), 3.0).tolist() == [1.0] * 4


def test_structure_drifts_with_the_wind():
    """A tenth of a second later it is a tenth of a metre further, which another wind would not do."""
    inner, points_m = InnerFluctuation(SCALES, intensity=0.65, seed=2), np.random.default_rng(3).random((2000, 3)) * 20

    def correlation(shift_m):
        now, later = factors(inner, points_m, 5.0), factors(inner, points_m + shift_m, 5.1)
        return np.corrcoef(now, later)[0, 1]

    assert correlation((0.1, 0.0, 0.0)) > 0.95
    assert correlation((-0.1, 0.0, 0.0)) < 0.7


def test_factors_follow_from_seed_and_time_alone():
    points_m = np.random.default_rng(4).random((50, 3))
    first, second = (InnerFluctuation(SCALES, intensity=0.65, seed=seed) for seed in (7, 8))
    expected = factors(first, points_m, 6.0)
    factors(first, points_m, 60.0)
    second.reset(7)
    assert factors(second, points_m, 6.0).tolist() == expected.tolist()
    assert factors(first, points_m, 6.0).tolist() == expected.tolist()
