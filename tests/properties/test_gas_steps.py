"""The length of a gas step, and how sources are put together, do not change the gas."""

from concurrent.futures import ThreadPoolExecutor

import numba
import numpy as np
import pytest
from built_gas import build_plume, build_source
from built_rooms import build_air
from hypothesis import given, settings
from hypothesis import strategies as st

from gslcosim_services.fields.filament.plume import filament_amount_mol
from gslcosim_services.fields.mixing_ratio import mixing_ratio_ppm_at
from gslcosim_services.fields.spatial_index import FilamentIndex

WIND_M_S = (0.4, -0.1, 0.05)
ORIGIN_M = (0.0, 0.0, 0.0)


def wide_air():
    """30 x 20 x 15 m of air in coarse cells with uniform wind: nothing reaches the border."""
    return build_air((30, 20, 15), WIND_M_S, cell_m=1.0, origin_m=(-10.0, -10.0, -7.5))


def plume_after(time_s, *, step_s, sources, seed=1, diffusivity_m2_s=0.01):
    plume = build_plume(wide_air(), sources, step_s=step_s, diffusivity_m2_s=diffusivity_m2_s, seed=seed)
    plume.advance(round(time_s / step_s))
    return plume


def moments_about_the_wind(plume, time_s):
    births_s = np.arange(1, plume.n + 1) / plume.n * time_s
    age_s = time_s - births_s
    offset_m = plume.filaments.position_world_m - age_s[:, None] * WIND_M_S
    is_old = age_s > 0.5
    return (offset_m[is_old] / np.sqrt(2 * 0.01 * age_s[is_old])[:, None]).ravel()


@pytest.mark.parametrize("step_s", [0.5, 0.1, 0.05])
def test_spread_does_not_depend_on_the_step(step_s):
    """Offsets from the wind's path over sqrt(2 D age) have variance 1 and mean 0 for any dt."""
    normalised = moments_about_the_wind(
        plume_after(4.0, step_s=step_s, sources=(build_source(ORIGIN_M, rate=2000.0),)), 4.0
    )
    assert normalised.var() == pytest.approx(1.0, abs=4 * np.sqrt(2 / len(normalised)))
    assert normalised.mean() == pytest.approx(0.0, abs=4 / np.sqrt(len(normalised)))


@settings(deadline=None, max_examples=25)
@given(rate=st.floats(0.5, 300.0), n_steps=st.integers(1, 40), parts=st.sampled_from([2, 5, 10]))
def test_without_eddies_any_step_gives_the_same_filaments(rate, n_steps, parts):
    coarse, fine = (
        plume_after(
            0.2 * n_steps, step_s=dt, sources=(build_source(ORIGIN_M, rate=rate),), diffusivity_m2_s=0.0
        ).filaments
        for dt in (0.2, 0.2 / parts)
    )
    np.testing.assert_allclose(coarse.position_world_m, fine.position_world_m, rtol=0, atol=1e-5)
    np.testing.assert_allclose(coarse.sigma_m, fine.sigma_m, rtol=1e-9)


@settings(deadline=None, max_examples=25)
@given(n=st.integers(2, 4), seed=st.integers(0, 10**6))
def test_sources_superpose(n, seed):
    rng = np.random.default_rng(seed)
    sources = tuple(build_source(tuple(rng.uniform(-2, 2, 3).tolist()), rate=rng.uniform(1, 30)) for _ in range(n))
    points = rng.uniform(-3, 3, (5, 3))
    together = mixing_ratio_ppm_at(
        points, plume_after(5.0, step_s=0.1, sources=sources, diffusivity_m2_s=0.0).filaments
    )
    alone = [
        mixing_ratio_ppm_at(points, plume_after(5.0, step_s=0.1, sources=(s,), diffusivity_m2_s=0.0).filaments)
        for s in sources
    ]
    np.testing.assert_allclose(together, sum(alone), rtol=1e-12)
    assert (together >= 0).all()


@settings(deadline=None, max_examples=25)
@given(rate=st.floats(0.5, 300.0), n_steps=st.integers(1, 50), step=st.sampled_from([0.01, 0.1, 0.3]))
def test_gas_is_conserved_while_nothing_leaves(rate, n_steps, step):
    plume = plume_after(n_steps * step, step_s=step, sources=(build_source(ORIGIN_M, rate=rate),))
    released_mol = int(rate * n_steps * step + 1e-9) * filament_amount_mol(10.0, 0.1)
    held = plume.filaments
    assert held.amount_mol[held.source_index].sum() == pytest.approx(released_mol, rel=1e-12)


def plume_and_readings(seed):
    """Places and sizes of a plume's filaments, and readings among them through the index."""
    held = plume_after(6.0, step_s=0.1, sources=(build_source(ORIGIN_M, rate=200.0),), seed=seed).filaments
    index = FilamentIndex(min_m=(-10.0, -10.0, -7.5), max_m=(20.0, 10.0, 7.5))
    index.build(held)
    points_m = np.random.default_rng(seed).uniform(-1.0, 2.0, (50, 3))
    return np.vstack([held.position_world_m, index.mixing_ratio_ppm_at(points_m).repeat(3, axis=1)])


@pytest.mark.parametrize("n_threads", [1, numba.config.NUMBA_NUM_THREADS])
def test_the_number_of_threads_does_not_change_the_gas(n_threads):
    alone = plume_and_readings(7)
    before = numba.get_num_threads()
    numba.set_num_threads(n_threads)
    try:
        with ThreadPoolExecutor(8) as threads:
            together = list(threads.map(plume_and_readings, [7, 8] * 4))
    finally:
        numba.set_num_threads(before)
    for same, other in zip(together[::2], together[1::2], strict=True):
        np.testing.assert_array_equal(same, alone)
        assert not np.array_equal(other, alone)
