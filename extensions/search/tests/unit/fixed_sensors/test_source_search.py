"""Place and rate from standing sensors: made-up beams with known truth, outliers, and errors of the wind."""

import numpy as np
import pytest

from gslcosim_search.fixed_sensors.plume_response import SensorPaths, WindStatistics, plume_responses
from gslcosim_search.fixed_sensors.source_search import (
    BackgroundPrior,
    fit_terms,
    rates_that_carry_the_mean,
    search_place,
)

SENSORS = SensorPaths.of_beams(
    np.array([50.0, 0.0, 1.6]), np.array([[10.0, 60.0, 1.6], [50.0, 70.0, 1.6], [90.0, 60.0, 1.6]]), n_points=40
)
TRUE_M, RATE_M3_S, ERROR_PPM = (48.0, 33.0), 5e-4, 0.02


def made_up(rng, n=120, *, direction_error_rad=0.0):
    """Return wind that an estimator sees, readings, and the group of each row."""
    angle = rng.uniform(0.0, 2.0 * np.pi, n)
    speed = rng.uniform(1.5, 4.0, n)

    def wind(off):
        mean = speed[:, None] * np.stack([np.cos(angle + off), np.sin(angle + off)], axis=1)
        return WindStatistics(mean, 0.2 * speed, 0.12 * speed)

    truth = plume_responses(SENSORS, wind(rng.normal(0.0, direction_error_rad, n)), np.array([*TRUE_M, 0.3]))
    group = (np.arange(n) >= n // 2).astype(np.int64)
    background = np.array([[1.9, 2.0, 2.1], [1.8, 2.0, 2.2]])[group]
    readings = background + RATE_M3_S * truth + rng.normal(0.0, ERROR_PPM, (n, 3))
    return wind(0.0), readings, group


def response_at(place_m, wind):
    """Return the responses to a source at a place in the plan."""
    return plume_responses(SENSORS, wind, np.array([*place_m, 0.3]))


def test_place_rate_and_backgrounds_are_found_beside_outliers():
    rng = np.random.default_rng(3)
    wind, readings, group = made_up(rng)
    spoiled = readings.copy()
    spoiled[::17] += 4.0
    prior = BackgroundPrior.of_readings(spoiled, reading_error_ppm=ERROR_PPM)

    def log_likelihood(place_m):
        return fit_terms(response_at(place_m, wind), spoiled, group, prior, reading_error_ppm=ERROR_PPM).log_likelihood

    place_m = search_place(log_likelihood, (0.0, 0.0), (100.0, 80.0), coarse_m=8.0, fine_m=0.5)
    assert np.hypot(place_m[0] - TRUE_M[0], place_m[1] - TRUE_M[1]) < 1.5
    fit = fit_terms(response_at(TRUE_M, wind), spoiled, group, prior, reading_error_ppm=ERROR_PPM)
    assert fit.rate_m3_s == pytest.approx(RATE_M3_S, rel=0.05)
    assert fit.background_ppm == pytest.approx(np.array([[1.9, 2.0, 2.1], [1.8, 2.0, 2.2]]), abs=0.03)


def test_errors_of_the_wind_bend_a_regression_and_not_the_ratio_of_means():
    rng = np.random.default_rng(5)
    wind, readings, group = made_up(rng, 900, direction_error_rad=0.25)
    response = response_at(TRUE_M, wind)
    above = readings - np.array([[1.9, 2.0, 2.1], [1.8, 2.0, 2.2]])[group]
    regression = float((above * response).sum() / (response**2).sum())
    rate = rates_that_carry_the_mean(
        response, readings, np.zeros(900, np.int64), group, np.array([RATE_M3_S]), negligible_ppm=ERROR_PPM
    )
    assert regression < 0.9 * RATE_M3_S
    assert rate[0] == pytest.approx(RATE_M3_S, rel=0.05)


def test_a_search_refines_to_the_top():
    found = search_place(lambda p: -((p[0] - 13.3) ** 2) - (p[1] - 4.1) ** 2, (0, 0), (20, 20), coarse_m=4, fine_m=0.25)
    assert found == (13.25, 4.0)


def test_readings_that_are_missing_cost_themselves_alone():
    """Each row lacks another beam; a row in calm air has no response."""
    rng = np.random.default_rng(11)
    wind, readings, group = made_up(rng, 240)
    readings[np.arange(240), np.arange(240) % 3] = np.nan
    wind.mean_world_m_s[7] = 0.0
    prior = BackgroundPrior.of_readings(readings, reading_error_ppm=ERROR_PPM)
    fit = fit_terms(response_at(TRUE_M, wind), readings, group, prior, reading_error_ppm=ERROR_PPM)
    assert fit.rate_m3_s == pytest.approx(RATE_M3_S, rel=0.05)
    assert fit.background_ppm == pytest.approx(np.array([[1.9, 2.0, 2.1], [1.8, 2.0, 2.2]]), abs=0.03)
