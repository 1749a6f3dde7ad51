"""A plume that wanders about the steady one."""

import numpy as np
import pytest

from gslcosim.base.rng import stream
from gslcosim_formats.gaussian_plume import GaussianPlume, MeanderingPlume, WanderingPath, spreads_m

POINTS = np.array([(30.0, 0.0, 2.0), (30.0, 2.0, 2.0), (20.0, -1.0, 3.0), (-1.0, 0.0, 2.0)])


@pytest.fixture
def mean():
    return GaussianPlume(position_world_m=(0.0, 0.0, 2.0), release_m3_s=1e-4, wind_world_m_s=(0.8, 0.0, 0.0))


@pytest.fixture
def plume_of(mean):
    """Build a plume of a seed that is a share as wide as the mean one."""

    def build(seed, *, share=0.5, correlation_s=10.0):
        return MeanderingPlume.seeded(mean, instantaneous_frac=share, correlation_s=correlation_s, seed=seed, name="0")

    return build


@pytest.mark.slow
def test_the_mean_over_all_plumes_is_the_steady_one(plume_of, mean):
    """Gifford: variances of the narrow plume and of its axis add up."""
    found = np.mean([plume_of(seed).mixing_ratio_ppm_at(POINTS, 100.0) for seed in range(6000)], axis=0)
    np.testing.assert_allclose(found, mean.mixing_ratio_ppm_at(POINTS), rtol=0.06)


def test_as_wide_as_the_mean_it_does_not_wander(plume_of, mean):
    found = plume_of(1, share=1.0).mixing_ratio_ppm_at(POINTS, 100.0)
    np.testing.assert_allclose(found, mean.mixing_ratio_ppm_at(POINTS), rtol=1e-12)


def test_the_front_travels_with_the_wind(plume_of):
    plume = plume_of(1)
    assert plume.mixing_ratio_ppm_at(POINTS[:1], 37.4).max() == 0.0
    axis_m = np.stack([np.full(200, 30.0), np.linspace(-6, 6, 200), np.full(200, 2.0)], 1)
    assert plume.mixing_ratio_ppm_at(axis_m, 37.6).max() > 0.0


def test_a_cross_section_is_narrow_and_off_the_axis(plume_of, mean):
    """At one moment the plume is a Gaussian of half the mean width somewhere near the axis."""
    y_m = np.linspace(-12.0, 12.0, 2001)
    points = np.stack([np.full_like(y_m, 30.0), y_m, np.full_like(y_m, 2.0)], 1)
    ppm = plume_of(5).mixing_ratio_ppm_at(points, 100.0)
    centre_m = np.average(y_m, weights=ppm)
    width_m = np.sqrt(np.average((y_m - centre_m) ** 2, weights=ppm))
    (sigma_y_m,), _ = spreads_m(np.array([30.0]), "D")
    assert width_m == pytest.approx(0.5 * sigma_y_m, rel=1e-3)
    assert 0.01 < abs(centre_m) < 4 * sigma_y_m


def test_asking_often_or_seldom_gives_the_same_plume(plume_of):
    """So the plume does not depend on the gas's step or on the tick."""
    often = plume_of(3)
    for time_s in np.arange(0.0, 60.0, 0.1):
        often.mixing_ratio_ppm_at(POINTS, float(time_s))
    np.testing.assert_array_equal(
        often.mixing_ratio_ppm_at(POINTS, 60.0), plume_of(3).mixing_ratio_ppm_at(POINTS, 60.0)
    )
    assert (plume_of(4).mixing_ratio_ppm_at(POINTS, 60.0) != plume_of(3).mixing_ratio_ppm_at(POINTS, 60.0)).any()


def test_paths_have_variance_one_at_all_times_and_forget_exponentially():
    times_s = np.array([0.0, 0.25, 0.37, 5.0, 10.0])
    values = np.array([WanderingPath(stream(seed, "path"), 10.0).at(times_s) for seed in range(20000)])
    np.testing.assert_allclose(values.var(axis=0), 1.0, atol=0.04)
    np.testing.assert_allclose(values.mean(axis=0), 0.0, atol=0.03)
    correlations = np.corrcoef(values.T)[0]
    np.testing.assert_allclose(correlations[3:], np.exp(-times_s[3:] / 10.0), atol=0.03)
