import numpy as np
import pytest

from gslcosim_search.beliefs import CellGrid, mass_within
from gslcosim_search.maps.pmfs import BackwardPlume, PlumeModel, PmfsSettings
from gslcosim_search.maps.published_pmfs import (
    FilamentSettings,
    PublishedPmfs,
    list_regions,
    simulate_hit_shares,
)
from gslcosim_search.random_stream import RandomStream

CELL_M = 0.25


def method(free: np.ndarray, *, seed: int = 1, filaments: FilamentSettings | None = None, **settings) -> PublishedPmfs:
    grid = CellGrid((0.0, 0.0), CELL_M, free.shape)
    return PublishedPmfs(
        free, grid, PmfsSettings(**settings), filaments or FilamentSettings(refine_frac=0.05), RandomStream(seed)
    )


def simulated(free, wind_m_s, region, *, is_open=True, seed=1, n_recorded=400, noise_m_s=0.25):
    generator = np.random.default_rng(seed)
    shares, _ = simulate_hit_shares(
        free, wind_m_s / CELL_M, *region, 5, 0.2, noise_m_s / CELL_M, 500, n_recorded, is_open,
        generator.standard_normal((65_537, 2)), generator.random((65_537, 2)), 0,
    )  # fmt: skip
    return shares


def even_wind(free: np.ndarray, x_m_s: float) -> np.ndarray:
    return np.where(free[..., None], np.array([x_m_s, 0.0]), 0.0)


def centre(cell) -> tuple[float, ...]:
    return tuple(CELL_M * (i + 0.5) for i in cell)


def test_filaments_make_the_plume_of_advection_and_diffusion():
    """White noise s in steps of dt is the diffusivity s^2 dt / 2; the steady equation is solved backwards."""
    free = np.ones((60, 21), bool)
    wind_m_s = even_wind(free, 0.4)
    shares = simulated(free, wind_m_s, (10, 10, 1, 1), n_recorded=3000)
    plume = BackwardPlume(
        free, CELL_M, wind_m_s, PlumeModel(puffs_per_s=25.0, diffusivity_m2_s=0.5 * 0.25**2 * 0.2, lifetime_s=1e4)
    )
    cells = [(i, j) for i in (20, 30) for j in (8, 10, 12, 14)]
    i_source = int(np.ravel_multi_index((10, 10), free.shape))
    expected = plume.shares(cells)[:, i_source]
    # Fluxes between cells spread a plume further, by u h / 2 of numerical diffusion along the wind.
    assert shares[tuple(np.array(cells).T)] == pytest.approx(expected, abs=0.12)
    assert shares[:8].max() == 0.0


def test_no_filament_passes_a_wall():
    free = np.ones((30, 20), bool)
    free[15] = False
    shares = simulated(free, even_wind(free, 0.5), (5, 8, 3, 3), is_open=False)
    assert shares[14].max() > 0.5
    assert (shares[15:] == 0.0).all()


def test_shares_of_the_time_are_between_0_and_1_and_repeat_to_the_bit():
    free = np.ones((20, 20), bool)
    first, second = (simulated(free, even_wind(free, 0.2), (5, 5, 4, 4)) for _ in range(2))
    assert (first == second).all()
    assert first.min() == 0.0
    assert 0.0 < first.max() <= 1.0


def test_regions_are_free_small_and_together_all_free_cells():
    free = np.random.default_rng(3).random((23, 17)) > 0.15
    counted = np.zeros(free.shape, int)
    for i, j, n_i, n_j in list_regions(free, 5):
        assert max(n_i, n_j) <= 5
        counted[i : i + n_i, j : j + n_j] += 1
    assert (counted == free).all()


def test_gas_downwind_and_clean_air_beside_put_the_source_between():
    """Wind to the east; gas on a line at y = 15, none upwind of x = 10 and none to the sides."""
    free = np.ones((31, 31), bool)
    pmfs = method(free)
    for i in (14, 18, 22, 26):
        pmfs.update(centre((i, 15)), [True] * 5, (0.4, 0.0))
    for cell in ((4, 15), (7, 15), (14, 22), (14, 8), (22, 24), (22, 6), (8, 20), (8, 10)):
        pmfs.update(centre(cell), [False] * 5, (0.4, 0.0))
    pmfs.score(even_wind(free, 0.4))
    assert pmfs.p.sum() == pytest.approx(1.0)
    assert mass_within(pmfs.p, pmfs.grid, centre((11, 15)), 1.0) > 0.8


def test_the_score_is_the_product_over_all_free_cells():
    """One level of regions; the product of 1 - k confidence |difference| is taken by hand."""
    free = np.ones((10, 10), bool)
    free[3, 3:7] = False
    filaments = FilamentSettings(refine_frac=0.0, discrimination=0.6, recorded_steps=50, warm_up_steps=50)
    pmfs, again = method(free, filaments=filaments), method(free, filaments=filaments)
    for each in (pmfs, again):
        each.update(centre((6, 5)), [True, False], (0.3, 0.0))
    wind_m_s = even_wind(free, 0.3)
    pmfs.score(wind_m_s)
    shares, _ = again._simulate(again._regions, wind_m_s / CELL_M, np.zeros(free.shape))
    expected = np.zeros(free.shape)
    for share, (i, j, n_i, n_j) in zip(shares, again._regions, strict=True):
        factors = 1.0 - 0.6 * again.confidence * np.abs(again.hit_probability - share)
        expected[i : i + n_i, j : j + n_j] = factors[free].prod()
    assert pmfs.p == pytest.approx(np.where(free, expected, 0.0) / expected[free].sum(), rel=1e-9)


def test_sources_are_scored_at_every_third_stop_after_the_first_ones():
    pmfs = method(np.ones((9, 9), bool), explore_first=6)
    assert [stop for stop in range(1, 14) if pmfs.is_update_due(has_findings=True)] == [6, 9, 12]


def test_without_gas_it_explores_the_whole_room():
    """From the middle of 10 x 8 m: a tie between cells of equal worth sends it into no corner."""
    free = np.ones((40, 32), bool)
    pmfs, draws, here = method(free), RandomStream(5), (20, 16)
    places = []
    for _ in range(90):
        pmfs.update(centre(here), [False] * 5, (0.2, 0.0))
        goal = pmfs.next_goal(centre(here), draws)
        assert goal is not None
        here = goal
        places.append(goal)
    low, high = np.array(places).min(axis=0), np.array(places).max(axis=0)
    assert (low <= (6, 6)).all()
    assert (high >= (33, 25)).all()


def test_the_goal_is_where_simulations_of_believed_sources_differ():
    free = np.ones((31, 31), bool)
    pmfs = method(free, explore_first=0, explore_frac=0.0, reach_cells=14.0)
    pmfs.update(centre((15, 15)), [True] * 5, (0.5, 0.0))
    pmfs.score(even_wind(free, 0.5))
    goal = pmfs.next_goal(centre((15, 15)), RandomStream(1))
    at = np.argwhere(pmfs._is_open)
    worth = pmfs._variance * (1.0 - pmfs.confidence)
    assert goal is not None
    assert worth[goal] == pytest.approx(max(worth[i, j] for i, j in at if max(abs(i - 15), abs(j - 15)) > 1))
