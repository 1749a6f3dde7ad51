"""Rows of laser paths with one source each, as a forward model and an estimator need them."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gslcosim.base.gases import GASES, air_density_mol_m3
from gslcosim_search.fixed_sensors.background import background_beside_plumes
from gslcosim_search.fixed_sensors.laser_sources import READING_ERROR_PPM, PathRecord
from gslcosim_search.fixed_sensors.plume_response import SensorPaths, WindStatistics, plume_responses
from gslcosim_search.fixed_sensors.source_search import BLOCK_S
from gslcosim_validation.readers.laser_paths import LaserMinutes, LaserPaths

Floats = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class LaserRows(PathRecord):
    """Usable minutes of all sources of a campaign, one after the other.

    Attributes:
        names: (s,) of the sources.
        release: (n,) name of the release of each row.
        block: (n,) labels of rows that share their weather.
    """

    names: tuple[str, ...]
    release: NDArray[np.str_]
    block: NDArray[np.int64]


def collect_laser_rows(paths: LaserPaths) -> LaserRows:
    """Return the minutes in which wind, air and at least one beam have values."""
    kept = [_usable(minutes) for minutes in paths.sources]
    parts = list(zip(paths.sources, kept, strict=True))

    def joined(name: str) -> NDArray:
        return np.concatenate([getattr(minutes, name)[rows] for minutes, rows in parts])

    moles = np.array(
        [air_density_mol_m3(t, p) for t, p in zip(joined("temperature_k"), joined("pressure_pa"), strict=True)]
    )
    source = np.repeat(np.arange(len(parts)), [int(rows.sum()) for rows in kept])
    quarters = (joined("clock_s") // BLOCK_S).astype(np.int64)
    return LaserRows(
        sensors=SensorPaths.of_beams(np.array(paths.instrument_m), paths.reflectors_m),
        names=tuple(minutes.source for minutes in paths.sources),
        source=source,
        release=joined("release"),
        start_s=joined("clock_s"),
        wind=WindStatistics.of_components(joined("wind_world_m_s"), joined("wind_std_m_s")),
        gas_m3_per_kg=1.0 / (GASES["methane"].molar_mass_kg_mol * moles),
        readings_ppm=joined("beams_ppm"),
        day=joined("day").astype(np.int64),
        block=quarters,
    )


def predict_plumes(paths: LaserPaths, laser: LaserRows) -> Floats:
    """Return the (n, k) mixing ratios [ppm] that the plumes of the open sources add along the beams."""
    predicted = np.empty_like(laser.readings_ppm)
    for i, minutes in enumerate(paths.sources):
        its = laser.source == i
        predicted[its] = 0.0
        for each in minutes.open_sources:
            response = plume_responses(laser.sensors, laser.wind_of(i), np.array(each.position_m))
            predicted[its] += each.rate_kg_s * laser.gas_m3_per_kg[its, None] * response
    return predicted


def find_daily_background(laser: LaserRows, predicted_ppm: Floats) -> Floats:
    """Return the (n, k) background of readings [ppm]: the median of a beam on a day while no plume reaches it."""
    return background_beside_plumes(laser.readings_ppm, predicted_ppm, laser.day, negligible_ppm=READING_ERROR_PPM)


def _usable(minutes: LaserMinutes) -> NDArray[np.bool_]:
    has_air = np.isfinite(minutes.temperature_k) & np.isfinite(minutes.pressure_pa)
    has_wind = np.isfinite(minutes.wind_world_m_s).all(axis=1) & np.isfinite(minutes.wind_std_m_s).all(axis=1)
    return has_air & has_wind & np.isfinite(minutes.beams_ppm).any(axis=1)
