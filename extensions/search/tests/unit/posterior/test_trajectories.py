"""Trajectories that go backward: they conserve time, follow the wind of each moment, and spread as turbulence does."""

import math

import numpy as np
import pytest

from gslcosim.contract.messages import Bounds
from gslcosim_search.posterior import trajectory_kernels
from gslcosim_search.posterior.open_air import OpenAir

BOUNDS = Bounds(min_m=(0.0, 0.0, 0.0), max_m=(20.0, 14.0, 3.0))
NOSE_M = (15.0, 7.0, 1.5)


def residence_s(winds_m_s, *, place_m=NOSE_M, fluctuation_m_s=0.0, persistence=0.0, spread_m=0.0, n_particles=2000):
    normals = np.random.default_rng(1).standard_normal(1 << 16)
    residence = np.zeros((40, 28, 6))
    trajectory_kernels.add_residence_inplace(
        np.array(place_m), spread_m, np.array(winds_m_s, float), 0.5, np.zeros(3), np.array(BOUNDS.max_m),
        fluctuation_m_s, persistence, normals, 0, n_particles, 0.5, residence,
    )  # fmt: skip
    return residence


def moments_m(weights):
    """Mean and variance of the places of cells, x, y, z."""
    share = weights / weights.sum()
    for axis in range(3):
        centres_m = (np.arange(share.shape[axis]) + 0.5) * 0.5
        along = share.sum(axis=tuple({0, 1, 2} - {axis}))
        mean_m = float((along * centres_m).sum())
        yield mean_m, float((along * (centres_m - mean_m) ** 2).sum())


def test_air_came_straight_up_the_wind_until_it_left_the_room():
    residence = residence_s([(0.5, 0.0, 0.0)] * 100)
    x, y, z = np.nonzero(residence)
    assert (set(x), set(y), set(z)) == (set(range(31)), {14}, {3})
    # 15 m at 0.5 m/s.
    assert residence.sum() == pytest.approx(30.0, abs=0.6)


def test_air_followed_the_wind_that_blew_then():
    residence = residence_s([(0.5, 0.0, 0.0)] * 20 + [(0.0, 0.5, 0.0)] * 20)
    assert residence[30, 14].sum() > 0.0
    x, y, _ = np.nonzero(residence)
    assert (x.min(), y.min()) == (20, 4)
    assert set(y[x > 20]) == {14}


def test_time_is_conserved_in_a_closed_box():
    residence = residence_s([(0.0, 0.0, 0.0)] * 60, fluctuation_m_s=0.4, persistence=0.5)
    assert residence.sum() == pytest.approx(30.0)


def test_it_spreads_as_taylor_says():
    fluctuation_m_s, memory_s, step_s, speed_m_s, away_m = 0.1, 2.0, 0.5, 0.5, 6.0
    r = math.exp(-step_s / memory_s)
    residence = residence_s(
        [(speed_m_s, 0.0, 0.0)] * 60, fluctuation_m_s=fluctuation_m_s, persistence=r, n_particles=20_000
    )
    # Sum of the correlations of the velocities of all pairs of steps.
    steps = np.arange(round(away_m / speed_m_s / step_s))
    taylor_m2 = (fluctuation_m_s * step_s) ** 2 * (r ** np.abs(steps[:, None] - steps[None, :])).sum()
    # The two columns of cells on both sides of that place; cells of 0.5 m add a twelfth of a square of theirs.
    _, (y_m, y_m2), (_, z_m2) = moments_m(residence[17:19])
    assert y_m == pytest.approx(7.0, abs=0.03)
    assert y_m2 == pytest.approx(taylor_m2 + 0.25 / 12.0, rel=0.05)
    assert z_m2 == pytest.approx(trajectory_kernels.VERTICAL_SHARE**2 * taylor_m2 + 0.25 / 12.0, rel=0.1)


def test_smoothing_keeps_the_sum_and_adds_the_variance_of_its_shares():
    values = np.zeros((11, 11, 11))
    values[5, 5, 5] = 3.0
    trajectory_kernels.smooth_inplace(values, 0.2, np.empty_like(values))
    assert values.sum() == pytest.approx(3.0)
    for _, variance_m2 in moments_m(values):
        assert variance_m2 == pytest.approx(2.0 * 0.2 * 0.25)
    corner = np.zeros((3, 3, 3))
    corner[0, 0, 0] = 1.0
    trajectory_kernels.smooth_inplace(corner, 0.2, np.empty_like(corner))
    assert corner.sum() == pytest.approx(1.0)


def test_levels_are_those_of_a_plume_in_a_steady_wind():
    air = OpenAir(BOUNDS)
    assert not air.is_known
    air.note_wind(0.0, (0.5, 0.0))
    air.note_wind(100.0, (0.5, 0.0))
    levels = air.levels_1_m3_s(100.0, NOSE_M, n_particles=5000).reshape(air.grid.shape)
    # Of a slice across the wind, the levels times the slice's area are the inverse of the speed.
    fluxes = levels.sum(axis=(1, 2)) * 0.25 * 0.5
    assert fluxes[10:28] == pytest.approx(np.ones(18), rel=0.03)
    assert levels[35:].sum() == 0.0
    assert levels[20:28].max() > 2.0 * levels[2:10].max()


def test_levels_do_not_depend_on_who_asked_elsewhere():
    first, second = OpenAir(BOUNDS), OpenAir(BOUNDS)
    for air in (first, second):
        air.note_wind(0.0, (0.5, 0.1))
    assert np.array_equal(
        first.levels_1_m3_s(1.0, NOSE_M, n_particles=50), second.levels_1_m3_s(1.0, NOSE_M, n_particles=50)
    )
    outside = first.levels_1_m3_s(1.0, (99.0, -1.0, 9.0), n_particles=50)
    assert np.isfinite(outside).all()
