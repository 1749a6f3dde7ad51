"""Leaks found by lasers of which one beam or another returns no light."""

import math

import numpy as np
import pytest
from laser_minutes import INSTRUMENT_M, M3_PER_KG, RATE_KG_S, REFLECTORS_M, TRUE_M, N, make_minutes

from gslcosim_search.fixed_sensors.laser_sources import build_searches, find_rates_kg_s
from gslcosim_search.fixed_sensors.plume_response import SensorPaths
from gslcosim_validation.laser_data import collect_laser_rows
from gslcosim_validation.measured_suite.estimators import ENTRIES
from gslcosim_validation.measured_suite.logs import LogSite, MeasuredLog
from gslcosim_validation.readers.laser_paths import LaserPaths


def drop_in_turn(readings_ppm):
    """No row has all beams: none would be left."""
    readings_ppm[np.arange(N), np.arange(N) % 4] = np.nan


def drop_a_beam(readings_ppm):
    readings_ppm[:, 2] = np.nan


def drop_at_random(readings_ppm):
    readings_ppm[np.random.default_rng(2).random(readings_ppm.shape) < 0.4] = np.nan


def drop_nothing(readings_ppm):
    del readings_ppm


GAPS = [drop_nothing, drop_in_turn, drop_a_beam, drop_at_random]


@pytest.mark.parametrize("drop", GAPS)
def test_a_minute_counts_with_the_beams_that_it_has(drop):
    minutes = make_minutes(drop)
    rows = collect_laser_rows(LaserPaths(instrument_m=INSTRUMENT_M, reflectors_m=REFLECTORS_M, sources=(minutes,)))
    assert len(rows.source) == np.isfinite(minutes.beams_ppm).any(axis=1).sum()
    assert np.isfinite(rows.readings_ppm).sum() == np.isfinite(minutes.beams_ppm).sum()
    (rate_kg_s,) = find_rates_kg_s(rows, build_searches(rows), [TRUE_M[:2]])
    assert rate_kg_s == pytest.approx(RATE_KG_S, rel=0.1)


@pytest.mark.slow
@pytest.mark.parametrize("drop", GAPS)
def test_the_leak_network_finds_a_leak_beside_gaps(drop):
    minutes = make_minutes(drop)
    site = LogSite(
        sensors=SensorPaths.of_beams(np.array(INSTRUMENT_M), REFLECTORS_M),
        names=("a", "b", "c", "d"),
        places_m={},
        source_height_m=TRUE_M[2],
        period_s=60.0,
        finds_events=False,
        wind_height_m=2.0,
    )
    log = MeasuredLog(
        start_s=minutes.clock_s,
        readings_ppm=minutes.beams_ppm,
        wind_world_m_s=minutes.wind_world_m_s[:, :2],
        wind_std_m_s=minutes.wind_std_m_s,
        gas_m3_per_kg=np.full(N, M3_PER_KG),
        source=np.zeros(N, np.int64),
    )
    network = next(entry for entry in ENTRIES if entry.name == "leak_network")
    (claim,) = network.build(site).claims(log)
    assert math.dist(claim.position_m, TRUE_M[:2]) < 1.0
    assert claim.rate_kg_s == pytest.approx(RATE_KG_S, rel=0.15)
