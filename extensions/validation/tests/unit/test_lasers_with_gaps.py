"""Leaks found by lasers of which one beam or another returns no light."""

import math

import numpy as np
import pytest

from gslcosim.base.gases import GASES, air_density_mol_m3
from gslcosim_search.fixed_sensors.laser_sources import build_searches, find_rates_kg_s
from gslcosim_search.fixed_sensors.plume_response import SensorPaths, WindStatistics, plume_responses
from gslcosim_validation.laser_data import collect_laser_rows
from gslcosim_validation.measured_suite.estimators import ENTRIES
from gslcosim_validation.measured_suite.logs import LogSite, MeasuredLog
from gslcosim_validation.readers.laser_paths import LaserMinutes, LaserPaths

INSTRUMENT_M = (30.0, 0.0, 1.6)
REFLECTORS_M = np.array([[5.0, 40.0, 1.6], [30.0, 45.0, 1.6], [55.0, 40.0, 1.6], [45.0, 20.0, 1.6]])
TRUE_M, RATE_KG_S, N = (27.0, 22.0, 0.3), 4e-4, 300
TEMPERATURE_K, PRESSURE_PA = 285.0, 101_000.0


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


def make_minutes(drop):
    """Return minutes of a leak, with gaps in what the beams read."""
    rng = np.random.default_rng(1)
    angle, speed = rng.uniform(0.0, 2.0 * np.pi, N), rng.uniform(1.5, 4.0, N)
    mean = np.stack([speed * np.cos(angle), speed * np.sin(angle), np.zeros(N)], axis=1)
    std = speed[:, None] * np.array([0.2, 0.2, 0.12])
    sensors = SensorPaths.of_beams(np.array(INSTRUMENT_M), REFLECTORS_M)
    wind = WindStatistics.of_components(mean, std)
    m3_per_kg = 1.0 / (GASES["methane"].molar_mass_kg_mol * air_density_mol_m3(TEMPERATURE_K, PRESSURE_PA))
    beams_ppm = 2.0 + RATE_KG_S * m3_per_kg * plume_responses(sensors, wind, np.array(TRUE_M))
    beams_ppm += rng.normal(0.0, 0.02, beams_ppm.shape)
    drop(beams_ppm)
    return LaserMinutes(
        source="leak",
        position_m=TRUE_M,
        rate_kg_s=RATE_KG_S,
        release=np.full(N, "one"),
        clock_s=60.0 * np.arange(N),
        beams_ppm=beams_ppm,
        wind_world_m_s=mean,
        wind_std_m_s=std,
        temperature_k=np.full(N, TEMPERATURE_K),
        pressure_pa=np.full(N, PRESSURE_PA),
        tan_gamma_horizontal=np.full(N, np.nan),
        tan_gamma_vertical=np.full(N, np.nan),
    )


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
    m3_per_kg = 1.0 / (GASES["methane"].molar_mass_kg_mol * air_density_mol_m3(TEMPERATURE_K, PRESSURE_PA))
    log = MeasuredLog(
        start_s=minutes.clock_s,
        readings_ppm=minutes.beams_ppm,
        wind_world_m_s=minutes.wind_world_m_s[:, :2],
        wind_std_m_s=minutes.wind_std_m_s,
        gas_m3_per_kg=np.full(N, m3_per_kg),
        source=np.zeros(N, np.int64),
    )
    network = next(entry for entry in ENTRIES if entry.name == "leak_network")
    (claim,) = network.build(site).claims(log)
    assert math.dist(claim.position_m, TRUE_M[:2]) < 1.0
    assert claim.rate_kg_s == pytest.approx(RATE_KG_S, rel=0.15)
