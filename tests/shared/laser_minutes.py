"""Minutes of lasers over a field of our own: four beams, wind from all sides, one leak or more."""

import numpy as np

from gslcosim.base.gases import GASES, air_density_mol_m3
from gslcosim_search.fixed_sensors.plume_response import SensorPaths, WindStatistics, plume_responses
from gslcosim_validation.readers.laser_paths import LaserMinutes

INSTRUMENT_M = (30.0, 0.0, 1.6)
REFLECTORS_M = np.array([[5.0, 40.0, 1.6], [30.0, 45.0, 1.6], [55.0, 40.0, 1.6], [45.0, 20.0, 1.6]])
TRUE_M, RATE_KG_S, N = (27.0, 22.0, 0.3), 4e-4, 300
TEMPERATURE_K, PRESSURE_PA = 285.0, 101_000.0
M3_PER_KG = 1.0 / (GASES["methane"].molar_mass_kg_mol * air_density_mol_m3(TEMPERATURE_K, PRESSURE_PA))


def make_minutes(drop=lambda readings_ppm: None, beside=()):
    """Return minutes of a leak and of others beside it, with gaps in what the beams read."""
    rng = np.random.default_rng(1)
    angle, speed = rng.uniform(0.0, 2.0 * np.pi, N), rng.uniform(1.5, 4.0, N)
    mean = np.stack([speed * np.cos(angle), speed * np.sin(angle), np.zeros(N)], axis=1)
    std = speed[:, None] * np.array([0.2, 0.2, 0.12])
    sensors = SensorPaths.of_beams(np.array(INSTRUMENT_M), REFLECTORS_M)
    wind = WindStatistics.of_components(mean, std)
    beams_ppm = 2.0 + RATE_KG_S * M3_PER_KG * plume_responses(sensors, wind, np.array(TRUE_M))
    for other in beside:
        beams_ppm += other.rate_kg_s * M3_PER_KG * plume_responses(sensors, wind, np.array(other.position_m))
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
        beside=beside,
    )
