"""The particle filter against the exact map on fine cells, and the laws of its steps."""

import math

import numpy as np
import pytest

from gslcosim.contract.messages import Bounds
from gslcosim_search.bayes.particle_filter import (
    ParticleCloud,
    log_miss_of_particles,
    newborn_area_m2,
    puff_variances_m2,
    systematic_indices,
    update_particles,
    wind_spread_m_sqrt_s,
)
from gslcosim_search.bayes.puff_tracing import partial_sums_m
from gslcosim_search.beliefs import CellGrid, normalised

BOUNDS = Bounds(min_m=(0.0, 0.0, 0.0), max_m=(6.0, 4.0, 3.0))
WIND = np.tile([[0.4, 0.1]], (10, 1))
TRAVELLED_M = partial_sums_m(WIND, 1.0)[1:]
VARIANCE_M2 = puff_variances_m2(11, 1.0, np.array([0.3, 0.25]), 0.1)[1:]
FINDINGS = (((4.1, 2.2), True), ((3.8, 3.4), False), ((3.0, 1.9), True), ((2.1, 0.9), False))


def cloud(n, seed=1, *, scattered=True):
    made = ParticleCloud(n, BOUNDS, np.random.default_rng(seed))
    if scattered:
        made.scatter()
    return made


def plain_miss(place_m, sensor_m, mu=0.9, area_m2=0.01):
    product = 1.0
    for travelled_m, (v_x, v_y) in zip(TRAVELLED_M, VARIANCE_M2, strict=True):
        dx, dy = sensor_m[0] - place_m[0] - travelled_m[0], sensor_m[1] - place_m[1] - travelled_m[1]
        density = math.exp(-dx * dx / 2 / v_x - dy * dy / 2 / v_y) / (2 * math.pi * math.sqrt(v_x * v_y))
        product *= 1.0 - mu * area_m2 * density
    return product


def exact_map(grid, n_sub=4):
    """The posterior over cells from a uniform prior, integrated over points within each cell."""
    fine = CellGrid(grid.origin_m, grid.cell_m / n_sub, tuple(n * n_sub for n in grid.shape))
    likelihood = np.ones(fine.n_cells)
    for sensor_m, is_hit in FINDINGS:
        log_miss = log_miss_of_particles(fine.centres_m(), np.array(sensor_m), TRAVELLED_M, VARIANCE_M2, 0.9, 0.01)
        likelihood *= -np.expm1(log_miss) if is_hit else np.exp(log_miss)
    blocks = likelihood.reshape(grid.shape[0], n_sub, grid.shape[1], n_sub)
    return normalised(blocks.sum(axis=(1, 3)))


def test_the_chance_of_a_miss_is_the_product_of_the_paper():
    places = np.array([[1.0, 1.0], [2.2, 1.7], [3.9, 2.1], [5.9, 3.9]])
    found = np.exp(log_miss_of_particles(places, np.array([4.1, 2.2]), TRAVELLED_M, VARIANCE_M2, 0.9, 0.01))
    assert found == pytest.approx([plain_miss(place, (4.1, 2.2)) for place in places], abs=1e-8)


def test_a_puff_smaller_than_what_senses_it_is_detected_for_sure_and_not_more():
    tiny = np.full((1, 2), 1e-6)
    found = log_miss_of_particles(np.array([[2.0, 2.0]]), np.array([2.0, 2.0]), np.zeros((1, 2)), tiny, 1.0, 0.01)
    assert np.isfinite(found).all()
    assert found[0] < math.log(1e-200)


@pytest.mark.parametrize(("n", "bound"), [(2_000, 0.2), (100_000, 0.03)])
def test_many_particles_are_the_map(n, bound):
    """Hits and misses from a uniform prior: total variation to the exact map falls with the number of particles."""
    grid, particles = CellGrid((0.0, 0.0), 0.5, (12, 8)), cloud(n)
    for sensor_m, is_hit in FINDINGS:
        update_particles(particles, sensor_m, TRAVELLED_M, VARIANCE_M2, is_hit=is_hit)
    assert 0.5 * np.abs(particles.probability(grid) - exact_map(grid)).sum() < bound


def test_particles_are_born_upwind_of_the_first_detection():
    particles = cloud(4000, scattered=False)
    assert not particles.is_born
    update_particles(particles, (4.0, 2.0), TRAVELLED_M, VARIANCE_M2, is_hit=True)
    assert not particles.is_born
    one, variance = TRAVELLED_M[3:4], VARIANCE_M2[3:4]
    particles.bear((4.0, 2.0), one, variance)
    assert particles.mean_m() == pytest.approx((4.0 - 1.6, 2.0 - 0.4), abs=0.05)
    assert particles.places_m.std(axis=0) == pytest.approx(np.sqrt(variance[0]), rel=0.05)


def test_later_births_replace_a_share_and_weigh_as_much_as_the_others_do_on_average():
    particles = cloud(1000, scattered=False)
    particles.bear((1.0, 1.0), np.zeros((1, 2)), np.full((1, 2), 1e-4))
    particles.bear((5.0, 3.0), np.zeros((1, 2)), np.full((1, 2), 1e-4), share=0.1)
    is_new = particles.places_m[:, 0] > 3.0
    assert is_new.sum() == 100
    assert particles.weights()[is_new].sum() == pytest.approx(0.1, rel=0.01)
    before = particles.places_m.copy()
    particles.bear((5.0, 3.0), np.zeros((1, 2)), np.full((1, 2), 1e-4), share=0.0)
    assert np.array_equal(before, particles.places_m)


def test_systematic_draws_take_each_particle_as_often_as_its_weight_says():
    weight = normalised(np.random.default_rng(2).uniform(size=50))
    for offset in (0.0, 0.3, 0.999):
        counts = np.bincount(systematic_indices(weight, offset), minlength=50)
        assert counts.sum() == 50
        assert np.all(np.abs(counts - 50 * weight) < 1.0)


def test_good_particles_have_children_and_the_others_die_by_chance():
    particles = cloud(900, seed=5)
    log_miss = np.where(particles.places_m[:, 0] < 1.0, 0.0, -3.0)
    particles.weigh(log_miss, is_hit=False)
    particles.resample_by_copies(jitter_m=0.05)
    assert len(particles.places_m) == 900
    assert particles.n_effective() == pytest.approx(900)
    # A sixth of the room had 80 % of the weight; survivors are a third of the rest.
    share = float((particles.places_m[:, 0] < 1.1).mean())
    assert 0.65 < share < 0.9


def test_a_floor_limits_what_one_finding_takes_away_and_impossible_findings_keep_the_cloud():
    particles = cloud(100)
    particles.weigh(np.where(np.arange(100) < 50, 0.0, -800.0), is_hit=False, floor_frac=0.2)
    weights = particles.weights()
    assert weights.max() / weights.min() == pytest.approx(5.0)
    particles = cloud(100)
    particles.weigh(np.zeros(100), is_hit=True)
    assert particles.weights() == pytest.approx(np.full(100, 0.01))


def test_wander_is_the_winds_own_variance_over_steps_or_at_least_what_eddies_do():
    rng = np.random.default_rng(8)
    winds = rng.normal((0.5, 0.0), (0.3, 0.001), (4000, 2))
    assert wind_spread_m_sqrt_s(winds, 0.5, 0.1) == pytest.approx([0.3 * math.sqrt(0.5), 0.1], rel=0.05)
    assert wind_spread_m_sqrt_s(winds[:1], 0.5, 0.1) == pytest.approx([0.1, 0.1])
    # So far do 20 steps really displace.
    distances_m = (winds[:, 0].reshape(200, 20) * 0.5).sum(axis=1)
    expected = puff_variances_m2(21, 0.5, wind_spread_m_sqrt_s(winds, 0.5, 0.1), 0.0)[20, 0]
    assert distances_m.var() == pytest.approx(expected, rel=0.3)


def test_the_same_seed_gives_the_same_cloud():
    def run(seed):
        particles = cloud(200, seed, scattered=False)
        particles.bear((4.0, 2.0), TRAVELLED_M, VARIANCE_M2)
        update_particles(particles, (3.0, 2.0), TRAVELLED_M, VARIANCE_M2, is_hit=True)
        particles.resample()
        particles.resample_by_copies()
        return particles.places_m

    assert np.array_equal(run(1), run(1))
    assert not np.array_equal(run(1), run(2))


@pytest.mark.parametrize("sigma_m", [0.1, 0.3])
def test_a_puff_released_at_the_sensor_is_detected_with_the_probability_of_a_puff_that_is_met(sigma_m):
    variance_m2 = puff_variances_m2(1, 1.0, np.array([0.2, 0.2]), sigma_m)
    here = np.array([1.0, 1.0])
    log_miss = log_miss_of_particles(here[None], here, np.zeros((1, 2)), variance_m2, 0.9, newborn_area_m2(sigma_m))
    assert -np.expm1(log_miss) == pytest.approx([0.9])


def test_a_finding_of_little_weight_changes_the_weights_by_a_power():
    log_miss = np.log(np.linspace(0.1, 0.9, 100))
    fully, half = cloud(100), cloud(100)
    fully.weigh(log_miss, is_hit=False)
    half.weigh(log_miss, is_hit=False, weight=0.5)
    assert half.weights() == pytest.approx(normalised(np.sqrt(fully.weights())))
