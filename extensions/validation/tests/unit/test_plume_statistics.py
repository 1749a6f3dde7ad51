"""Statistics of concentration records and of dispersion, against distributions that are known."""

import math

import numpy as np
import pytest

from gslcosim.base.errors import ShapeError
from gslcosim_validation.plume_statistics import (
    RecordSettings,
    compute_moments,
    conditional_intensity,
    list_durations,
    power_law_exponent,
    score_absolute_dispersion,
    score_record,
    score_richardson_constant,
    spectral_density,
    spectral_slope,
    taylor_variance_m2,
)


@pytest.mark.parametrize("intensity", [0.5, 1.0, 2.0])
def test_gamma_numbers_have_the_moments_of_the_gamma_distribution(intensity):
    """Skewness 2 i and kurtosis 3 + 6 i^2."""
    shape = 1.0 / intensity**2
    found = compute_moments(np.random.default_rng(1).gamma(shape, 1.0 / shape, size=1_000_000))
    assert found.intensity == pytest.approx(intensity, rel=0.01)
    assert found.skewness_ratio == pytest.approx(1.0, abs=0.03)
    assert found.kurtosis_ratio == pytest.approx(1.0, abs=0.08)


def test_intermittency_identity_holds():
    """(1 + i^2) gamma = 1 + i_p^2, Wilson, Robins and Fackrell 1985: exact algebra for zeros between whiffs."""
    rng = np.random.default_rng(2)
    values = np.where(rng.random(50_000) < 0.3, rng.gamma(2.0, 1.0, 50_000), 0.0)
    i, i_p = compute_moments(values).intensity, conditional_intensity(values, 0.0)
    assert (1 + i**2) * (values > 0).mean() == pytest.approx(1 + i_p**2, rel=1e-9)


def test_durations_leave_out_what_was_cut_off():
    is_present = np.array([1, 1, 0, 0, 0, 1, 0, 1, 1, 1, 0], bool)
    whiffs_s, blanks_s = list_durations(is_present, 0.5)
    assert whiffs_s.tolist() == [0.5, 1.5]
    assert blanks_s.tolist() == [1.5, 0.5]
    assert all(len(found) == 0 for found in list_durations(np.ones(5, bool), 0.5))


@pytest.mark.parametrize("exponent", [1.2, 1.5, 1.9])
def test_exponent_of_drawn_power_laws_is_found(exponent):
    """Pareto numbers in continuous time, seen in steps."""
    u = np.random.default_rng(3).random(200_000)
    steps = np.rint(0.5 * u ** (-1.0 / (exponent - 1.0)))
    found = power_law_exponent(0.1 * steps, step_s=0.1, low_s=0.5, high_s=20.0)
    assert found == pytest.approx(exponent, abs=0.03)


@pytest.mark.parametrize("slope", [-1.0, -5 / 3, -2.5])
def test_slope_of_a_synthetic_spectrum_is_found(slope):
    n, step_s = 2**16, 0.1
    frequency = np.fft.rfftfreq(n, step_s)
    rng = np.random.default_rng(4)
    amplitude = np.zeros(len(frequency), complex)
    amplitude[1:] = frequency[1:] ** (slope / 2) * (rng.normal(size=n // 2) + 1j * rng.normal(size=n // 2))
    hz, density = spectral_density(np.fft.irfft(amplitude, n), step_s, n_segment=512)
    assert spectral_slope(hz, density, low_hz=0.3, high_hz=3.0) == pytest.approx(slope, abs=0.1)


def test_scores_of_a_record_have_intervals_around_them():
    rng = np.random.default_rng(6)
    values = rng.gamma(1.0, 1.0, size=20_000)
    found = score_record(values, RecordSettings(step_s=0.1, threshold=1.0), n_draws=100)
    assert found.intensity.low < 1.0 < found.intensity.high
    assert found.presence.low < math.exp(-1.0) < found.presence.high
    assert found.skewness_ratio.low < 1.0 < found.skewness_ratio.high
    assert found.spectral_slope.value == pytest.approx(0.0, abs=0.1)
    assert found == score_record(values, RecordSettings(step_s=0.1, threshold=1.0), n_draws=100)


def test_a_record_that_is_too_short_or_has_gaps_is_refused():
    with pytest.raises(ShapeError, match="record: expected at least 320 values"):
        score_record(np.ones(100), RecordSettings(step_s=0.1, threshold=1.0), n_draws=100)
    with pytest.raises(ShapeError, match="1 not finite"):
        score_record(np.append(np.ones(1000), math.nan), RecordSettings(step_s=0.1, threshold=1.0), n_draws=100)


def test_dispersion_of_gaussian_tracers_scores_one():
    rng, time_s = np.random.default_rng(7), np.array([0.5, 1.0, 2.0])
    law_m2 = taylor_variance_m2(time_s, velocity_std_m_s=0.4, time_scale_s=1.5)
    displacement_m = rng.normal(size=(4000, 3)) * np.sqrt(law_m2)
    found = score_absolute_dispersion(displacement_m, time_s, velocity_std_m_s=0.4, time_scale_s=1.5)
    assert all(each.low < 1.0 < each.high for each in found)
    separation2_m2 = 0.5 * 0.1 * time_s**3 * rng.exponential(size=(4000, 3))
    assert [each.value for each in score_richardson_constant(separation2_m2, time_s, dissipation_m2_s3=0.1)] == (
        pytest.approx([0.5] * 3, rel=0.06)
    )


def test_taylor_variance_begins_with_the_velocity_and_ends_with_a_diffusivity():
    early, late = taylor_variance_m2(np.array([1e-3, 1e4]), velocity_std_m_s=0.3, time_scale_s=2.0)
    assert early == pytest.approx((0.3 * 1e-3) ** 2, rel=1e-3)
    assert late == pytest.approx(2 * 0.3**2 * 2.0 * 1e4, rel=1e-3)
