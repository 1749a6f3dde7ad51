"""Events and places from a made-up network: drift, offsets, gaps, two leaks at known places with known rates."""

import numpy as np
import pytest

from gslcosim_search.fixed_sensors.events import DetectionSettings, detect_events, find_excess
from gslcosim_search.fixed_sensors.leak_location import (
    locate_among,
    locate_in_plane,
    mean_rate_m3_s,
    response_correlation,
)
from gslcosim_search.fixed_sensors.puff_response import WindRecord, puff_responses

MASTS_M = np.array([[40.0, 0.0, 2.4], [0.0, 40.0, 2.4], [-40.0, 0.0, 2.4], [0.0, -40.0, 2.4]])
PLACES_M = {"tank": np.array([15.0, 10.0, 2.0]), "well": np.array([-20.0, -15.0, 2.0])}
RATE_M3_S = 1e-3
# Rows of the leaks.
LEAKS = {"tank": (700, 820), "well": (1500, 1640)}


@pytest.fixture(scope="module")
def log():
    """Return clock, readings and wind of two days with two leaks, drifting backgrounds, and a gap in one sensor."""
    rng = np.random.default_rng(11)
    n = 2880
    clock_s = 1e9 + 60.0 * np.arange(n)
    angle = np.cumsum(rng.normal(0.0, 0.25, n))
    wind = WindRecord.of_means(clock_s, 2.5 * np.stack([np.cos(angle), np.sin(angle)], axis=1), 2.4)
    drift = 2.0 + 0.4 * np.sin(2.0 * np.pi * np.arange(n) / 1440.0)[:, None] + np.array([0.0, 0.2, -0.1, 0.5])
    readings = drift + rng.normal(0.0, 0.05, (n, 4))
    for place, (first, last) in LEAKS.items():
        readings[first:last] += RATE_M3_S * puff_responses(MASTS_M, wind.rows(first, last), PLACES_M[place])
    readings[100:400, 3] = np.nan
    return clock_s, readings, wind


def test_events_are_the_leaks_and_nothing_else(log):
    clock_s, readings, _ = log
    events = detect_events(clock_s, find_excess(clock_s, readings))
    assert len(events) == 2
    for event, (first, last) in zip(events, LEAKS.values(), strict=True):
        assert first <= event.first < event.last < last + 1


def test_each_event_gets_its_place_and_rate(log):
    clock_s, readings, wind = log
    excess = find_excess(clock_s, readings)
    found = [locate_among(event, excess, wind, MASTS_M, PLACES_M) for event in detect_events(clock_s, excess)]
    assert [each.place for each in found] == ["tank", "well"]
    for each in found:
        assert each.rate_m3_s == pytest.approx(RATE_M3_S, rel=0.25)
        assert each.correlation[each.place] > 0.9


@pytest.mark.slow
def test_a_place_that_is_no_candidate_is_found_in_the_plane(log):
    clock_s, readings, wind = log
    excess = find_excess(clock_s, readings)
    event = detect_events(clock_s, excess)[0]
    x_m, y_m = locate_in_plane(event, excess, wind, MASTS_M, height_m=2.0)
    assert np.hypot(x_m - 15.0, y_m - 10.0) < 8.0


def test_short_flickers_and_silent_sensors_are_no_events():
    clock_s = 60.0 * np.arange(600)
    readings = np.full((600, 2), 2.0)
    readings[:, 1] = np.nan
    readings[[100, 101], 0] = 9.0
    excess = find_excess(clock_s, readings)
    assert detect_events(clock_s, excess) == ()
    assert len(detect_events(clock_s, excess, DetectionSettings(least_readings=2))) == 1


def test_quiet_times_within_the_gap_join_an_event():
    clock_s = 60.0 * np.arange(900)
    readings = np.full((900, 1), 2.0)
    readings[[200, 201, 202, 250, 251, 252, 400, 401, 402]] = 9.0
    events = detect_events(clock_s, find_excess(clock_s, readings))
    assert [(event.first, event.last) for event in events] == [(200, 252), (400, 402)]


def test_no_gas_has_no_correlation_and_no_rate():
    assert response_correlation(np.zeros((5, 2)), np.ones((5, 2))) == -np.inf
    assert np.isnan(mean_rate_m3_s(np.zeros((5, 2)), np.ones((5, 2))))
