"""Source-term estimation: plumes and sensors against closed forms, the filter against the truth on its own model."""

import math

import numpy as np
import pytest

from gslcosim_search.bayes.source_terms import (
    GAUSSIAN_PLUME,
    ISOTROPIC,
    LOG_NORMAL,
    NORMAL,
    TERMS,
    PlumeSensor,
    SourcePrior,
    SourceTermFilter,
    TermPrior,
    expected_gain_bits,
    gaussian_plume,
    isotropic_plume,
    kernel_width,
    log_likelihood_of_reading,
    log_likelihoods,
    mean_amount,
    sampled_reading,
)
from gslcosim_search.beliefs import CellGrid

# x, y, z, rate, speed, direction (to the north-east), diffusivity, lifetime.
TERM_SET = np.array([3.0, 2.0, 1.5, 5.0, 0.8, math.pi / 4, 0.5, 20.0])
# The demonstration of AutoSTE: 25 x 25 x 4 m, wind 2 m/s to the north-east.
DEMO = SourcePrior(
    {
        "x_m": TermPrior(kind="uniform", a=0.0, b=25.0),
        "y_m": TermPrior(kind="uniform", a=0.0, b=25.0),
        "z_m": TermPrior(kind="uniform", a=0.0, b=5.0),
        "rate": TermPrior(kind="gamma", a=2.0, b=5.0),
        "speed": TermPrior(kind="normal", a=2.0, b=2.0),
        "direction_rad": TermPrior(kind="normal", a=math.pi / 4, b=math.radians(10.0)),
        "diffusivity_m2_s": TermPrior(kind="uniform", a=2.0, b=4.0),
        "lifetime_s": TermPrior(kind="uniform", a=8.0, b=10.0),
    }
)


def amount(place_m, terms=TERM_SET, plume=ISOTROPIC, speed=1.0, direction=0.0, radius=0.1):
    return mean_amount(terms, np.array(place_m, float), speed, direction, radius, plume)


def test_the_isotropic_plume_solves_its_differential_equation():
    """D lap C - u . grad C - C / tau = 0 away from the source, by central differences."""
    h, at = 1e-3, np.array([4.1, 2.4, 1.9])

    def moved(axis, by):
        return amount(at + by * np.eye(3)[axis])

    centre = amount(at)
    laplacian = sum(moved(axis, h) + moved(axis, -h) - 2 * centre for axis in range(3)) / h**2
    drift = sum(0.8 * math.sqrt(0.5) * (moved(axis, h) - moved(axis, -h)) / (2 * h) for axis in range(2))
    assert 0.5 * laplacian - drift == pytest.approx(centre / 20.0, rel=1e-3)


def test_near_the_source_the_gas_diffuses_as_from_a_point():
    near = amount((3.0, 2.0, 1.5 + 1e-4), radius=1e-6)
    assert near == pytest.approx(5.0 / (4 * math.pi * 0.5 * 1e-4), rel=1e-3)


def test_measured_winds_multiply_the_speed_and_turn_the_direction():
    absolute = amount((4.0, 3.0, 1.5))
    relative = TERM_SET.copy()
    relative[4], relative[5] = 2.0, 0.1
    assert amount((4.0, 3.0, 1.5), relative, speed=0.4, direction=math.pi / 4 - 0.1) == pytest.approx(absolute)


def test_the_flux_of_the_gaussian_plume_through_a_plane_downwind_is_the_rate():
    terms = TERM_SET.copy()
    terms[5] = 0.0
    across, up = np.arange(-12.0, 12.0, 0.05) + 2.0, np.arange(0.1, 15.0, 0.2)
    for x in (4.0, 8.0):
        total = sum(amount((x, y, z), terms, GAUSSIAN_PLUME) for y in across for z in up)
        assert 0.8 * total * 0.05 * 0.2 == pytest.approx(5.0, rel=1e-2)


def test_upwind_and_in_calm_air_the_gaussian_plume_is_nothing():
    place = np.array([2.0, 1.0, 1.5])
    assert gaussian_plume(TERM_SET, place, 1.0, 0.0, 0.1) == 0.0
    assert gaussian_plume(TERM_SET, np.array([4.0, 3.0, 1.5]), 0.0, 0.0, 0.1) == 0.0


def test_very_far_upwind_nothing_overflows():
    still_finite = isotropic_plume(TERM_SET, np.array([-1e4, -1e4, 0.0]), 100.0, 0.0, 0.1)
    assert 0.0 <= still_finite < 1e-100


@pytest.mark.parametrize(("sensor", "frac"), [(NORMAL, 0.5), (LOG_NORMAL, 0.8)])
def test_a_reading_is_as_likely_as_the_sensor_gives_it(sensor, frac):
    """Sampled readings fall into intervals as often as the likelihood's integral over them says."""
    figures = (0.2, frac, 0.01, 0.7)
    rng = np.random.default_rng(4)
    chances = zip(rng.random(40_000), rng.normal(size=40_000), strict=True)
    drawn = np.array([sampled_reading(1.3, u, n, *figures, sensor) for u, n in chances])
    for low, high in ((0.2, 1.0), (1.0, 1.5), (1.5, 4.0)):
        middles = np.linspace(low, high, 400)
        density = [math.exp(log_likelihood_of_reading(z, 1.3, *figures, sensor)) for z in middles]
        assert ((drawn > low) & (drawn <= high)).mean() == pytest.approx(np.trapezoid(density, middles), abs=0.01)


def test_a_miss_of_the_published_sensor_is_the_error_function_of_the_paper():
    for true in (0.0, 5e-3, 2e-2):
        expected = 0.35 * (1 + math.erf((5e-3 - true) / (5e-3 * math.sqrt(2)))) + 0.3
        assert log_likelihood_of_reading(0.0, true, 5e-3, 0.5, 1e-4, 0.7, NORMAL) == pytest.approx(math.log(expected))


def test_impossible_readings_have_a_small_logarithm_and_no_infinity():
    for sensor in (NORMAL, LOG_NORMAL):
        for reading in (0.0, 50.0):
            assert math.isfinite(log_likelihood_of_reading(reading, 0.0, 0.1, 0.5, 1e-4, 1.0, sensor))
            assert math.isfinite(log_likelihood_of_reading(reading, 1e9, 0.1, 0.5, 1e-4, 1.0, sensor))


def test_the_likelihood_of_all_readings_is_the_sum_of_each():
    rng = np.random.default_rng(2)
    terms, places = DEMO.draw(5, rng), rng.uniform(0, 25, (3, 3))
    winds, readings = np.array([[1.0, 0.0], [0.5, 0.2], [2.0, -0.1]]), np.array([0.0, 0.02, 0.3])
    figures = np.array([5e-3, 0.5, 1e-4, 0.7, 0.1])
    together = log_likelihoods(terms, places, winds, readings, ISOTROPIC, NORMAL, figures)
    for i, set_ in enumerate(terms):
        each = [
            log_likelihood_of_reading(z, amount(x, set_, speed=w[0], direction=w[1]), *figures[:4], NORMAL)
            for x, w, z in zip(places, winds, readings, strict=True)
        ]
        assert together[i] == pytest.approx(sum(each))


@pytest.mark.parametrize(
    ("spread", "mean", "inside", "outside"),
    [
        (TermPrior(kind="uniform", a=1.0, b=3.0), 2.0, 2.5, 3.5),
        (TermPrior(kind="log_uniform", a=0.1, b=10.0), (10.0 - 0.1) / math.log(100.0), 1.0, 11.0),
        (TermPrior(kind="gamma", a=2.0, b=5.0), 10.0, 1.0, -1.0),
    ],
)
def test_priors_draw_what_their_density_says(spread, mean, inside, outside):
    drawn = spread.draw(40_000, np.random.default_rng(1))
    assert drawn.mean() == pytest.approx(mean, rel=0.02)
    assert np.isfinite(spread.log_density(np.array([inside])))
    assert spread.log_density(np.array([outside])) == -np.inf
    grid = np.linspace(drawn.min(), drawn.max(), 20_001)
    density = np.exp(spread.log_density(grid))
    assert (grid * density).sum() / density.sum() == pytest.approx(mean, rel=0.02)


def test_what_must_be_positive_is_drawn_again_and_never_taken():
    drawn = DEMO.draw(5000, np.random.default_rng(1))
    assert drawn[:, TERMS.index("speed")].min() > 0.0
    wrong = drawn[:1].copy()
    wrong[0, TERMS.index("speed")] = -0.1
    assert DEMO.log_density(wrong)[0] == -np.inf
    assert np.isfinite(DEMO.log_density(drawn)).all()


def test_the_kernels_width_is_silvermans():
    assert kernel_width(700) == pytest.approx((4 / 10) ** (1 / 12) * 700 ** (-1 / 12))
    assert kernel_width(64, dimensions=2) == pytest.approx(0.5)


def flown(seed, n_particles, n_moves):
    """A flight over the demonstration's field on the filter's own model: the filter, the truth, and how many hits."""
    rng = np.random.default_rng(seed)
    truth, model = DEMO.draw(1, rng)[0], PlumeSensor()
    searcher = SourceTermFilter(DEMO, model, n_particles, np.random.default_rng(10_000 + seed), n_moves=n_moves)
    plume, sensor, figures = model.numbers
    n_hits = 0
    for i in range(64):
        column = i % 8 if (i // 8) % 2 == 0 else 7 - i % 8
        place_m = (2.0 + 3.0 * column, 2.0 + 3.0 * (i // 8), 4.0)
        reading = sampled_reading(
            mean_amount(truth, np.array(place_m), 1.0, 0.0, figures[4], plume), rng.random(), rng.normal(),
            *figures[:4], sensor,
        )  # fmt: skip
        n_hits += reading > 0.0
        searcher.read(place_m, reading)
    return searcher, truth, n_hits


def covers(searcher, truth, mass=0.9):
    """Whether the smallest set of cells of 1 m with that mass holds the true place."""
    grid = CellGrid((0.0, 0.0), 1.0, (25, 25))
    p = searcher.probability(grid)
    return p[p > p[grid.cell_at(truth[:2])]].sum() < mass


@pytest.mark.slow
def test_on_its_own_model_the_posterior_covers_the_truth():
    covered = [covers(*flown(seed, 500, 8)[:2]) for seed in range(12)]
    assert sum(covered) >= 9


def test_moves_leave_the_posterior_as_it_is():
    """Many moves without a reading: particles stay distributed as the prior and its readings say."""
    rng = np.random.default_rng(6)
    searcher = SourceTermFilter(DEMO, PlumeSensor(), 4000, rng, n_moves=20)
    before = searcher.terms.copy()
    searcher._renew()
    for column, name in enumerate(TERMS):
        scale = before[:, column].std()
        assert searcher.terms[:, column].mean() == pytest.approx(before[:, column].mean(), abs=0.08 * scale), name
        assert searcher.terms[:, column].std() == pytest.approx(scale, rel=0.08), name
    assert (searcher.terms != before).any(axis=1).mean() > 0.9


def test_a_rejected_place_stays_rejected_through_moves_and_is_not_impossible():
    searcher = SourceTermFilter(DEMO, PlumeSensor(), 4000, np.random.default_rng(7), n_moves=5)
    searcher.reject((12.5, 12.5), 8.0)
    inside = np.hypot(searcher.terms[:, 0] - 12.5, searcher.terms[:, 1] - 12.5) <= 8.0
    before = math.pi * 64 / 625
    expected = 0.01 * before / (0.01 * before + 1.0 - before)
    assert searcher.weights()[inside].sum() == pytest.approx(expected, abs=0.004)
    searcher._renew()
    inside = np.hypot(searcher.terms[:, 0] - 12.5, searcher.terms[:, 1] - 12.5) <= 8.0
    assert 0.0 < searcher.weights()[inside].sum() < 0.015


def test_a_filter_survives_readings_that_its_model_cannot_explain():
    searcher = SourceTermFilter(DEMO, PlumeSensor(), 100, np.random.default_rng(1))
    for ppm in (1e6, 0.0, 1e-9, 1e6):
        searcher.read((5.0, 5.0, 1.0), ppm)
    assert np.isfinite(searcher.weights()).all()
    assert searcher.weights().sum() == pytest.approx(1.0)


def test_a_reading_where_the_sets_differ_shows_more_than_one_where_they_agree():
    near, far = TERM_SET.copy(), TERM_SET.copy()
    far[:2] = 20.0, 2.0
    terms = np.array([near, far] * 20)
    places = np.array([[3.5, 2.5, 1.5], [500.0, 500.0, 1.5]])
    figures = np.array([5e-3, 0.5, 1e-4, 1.0, 0.1])
    rng = np.random.default_rng(3)
    draws = np.arange(20), rng.random(20), rng.normal(size=20)
    gain = expected_gain_bits(terms, places, np.array([1.0, 0.0]), *draws, ISOTROPIC, NORMAL, figures)
    assert gain[0] == pytest.approx(1.0, abs=0.02)
    assert gain[1] == pytest.approx(0.0, abs=1e-6)


def test_the_same_seed_gives_the_same_particles():
    assert np.array_equal(flown(5, 100, 2)[0].terms, flown(5, 100, 2)[0].terms)
    assert flown(5, 100, 2)[0].probability(CellGrid((0.0, 0.0, 0.0), 1.0, (25, 25, 5))).sum() == pytest.approx(1.0)
