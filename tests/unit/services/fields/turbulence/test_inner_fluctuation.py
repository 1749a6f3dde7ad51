"""Gas within filaments: a bounded factor of mean one, that drifts with the wind and fades."""

import math

import numpy as np
import pytest

from gslcosim_services.fields.turbulence.eddies import EddyScales, largest_spacing_m, octave_shares
from gslcosim_services.fields.turbulence.inner_fluctuation import InnerFluctuation, bounded_power

SCALES = EddyScales(length_m=2.0, time_s=2.0)


def factors(inner, points_m, time_s, wind_m_s=(1.0, 0.0, 0.0), sigma_m=0.6):
    drift_m_s = np.full((1, 1, 1, 4), (*wind_m_s, 0.0), np.float32)
    sizes_m = np.full(len(points_m), sigma_m)
    return inner.factors_at(np.asarray(points_m, float), sizes_m, time_s, drift_m_s, (0.0, 0.0, 0.0), 0.5)


def draw_factors(intensity, sigma_m):
    """Factors of eight seeds at 3,000 points, in filaments of one size."""
    points_m = np.random.default_rng(1).random((3000, 3)) * 50.0
    inner = [InnerFluctuation(SCALES, intensity=intensity, seed=seed) for seed in range(8)]
    return np.concatenate([factors(each, points_m, 9.0, sigma_m=sigma_m) for each in inner])


@pytest.mark.parametrize("intensity", [0.3, 0.65, 1.0])
def test_factors_have_mean_one_and_the_intensity_where_all_structure_is_in(intensity):
    """In filaments a third as large as the eddies, half of the largest octave is in, and hardly anything fades."""
    found = draw_factors(intensity, 0.7)
    sizes_m = largest_spacing_m(SCALES.length_m) / 2.0 ** np.arange(2, 7)
    parts = octave_shares(5) / (1.0 + (sizes_m / (1.5 * 0.7)) ** 2)
    expected = 1.0 / np.sqrt(1.0 / (intensity**2 * parts.sum()) + 0.35**2 / 1.35)
    assert found.min() >= 0.0
    assert found.mean() == pytest.approx(1.0, abs=0.03)
    assert found.std() == pytest.approx(expected, rel=0.06)


@pytest.mark.parametrize("intensity", [0.01, 0.3, 1.0, 3.0])
def test_the_power_of_an_intensity_follows_from_moments(intensity):
    q = bounded_power(intensity)
    mean, mean_square = (2.0 / ((1.0 + n * q) * (2.0 + n * q)) for n in (1, 2))
    assert mean_square / mean**2 - 1.0 == pytest.approx(intensity**2, rel=1e-6)


def test_small_filaments_hold_small_structure_alone():
    """A fourth as large, less than half of the variance, and of finer grain."""
    inner, points_m = InnerFluctuation(SCALES, intensity=0.65, seed=2), np.random.default_rng(3).random((4000, 3)) * 20

    def grain(sigma_m):
        here, aside = (factors(inner, points_m + shift_m, 5.0, sigma_m=sigma_m) for shift_m in (0.0, (0.0, 0.05, 0.0)))
        return np.corrcoef(here, aside)[0, 1]

    assert draw_factors(0.65, 0.1).var() < 0.5 * draw_factors(0.65, 0.4).var()
    assert grain(0.1) < grain(0.4) - 0.1


def test_fluctuation_fades_as_filaments_outgrow_the_eddies():
    """Whatever it was: its standard deviation is sqrt(1.35) lengths of the eddies over the filament's size."""
    for intensity in (0.65, 1.0):
        found = draw_factors(intensity, 40.0)
        assert found.mean() == pytest.approx(1.0, abs=0.01)
        assert found.std() == pytest.approx(math.sqrt(1.35) * SCALES.length_m / 40.0, rel=0.12)


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
