"""Inputs of forward models and event detectors from a mast network: wind, volume of gas, sources, predictions."""

import numpy as np
from numpy.typing import NDArray

from gslcosim.base.gases import GASES, air_density_mol_m3
from gslcosim_search.fixed_sensors.background import background_beside_plumes
from gslcosim_search.fixed_sensors.puff_response import WindRecord, puff_responses
from gslcosim_validation.readers.mast_network import LoggedRelease, MastNetwork

Floats = NDArray[np.float64]

# The temperature is not published; ten degrees change the volume of gas by 3.5 %.
_TEMPERATURE_K = 288.0
# Backgrounds drift within hours; plumes below the instruments' steps count as none.
BACKGROUND_S = 3600.0
NEGLIGIBLE_PPM = 0.05


def methane_m3_per_kg(network: MastNetwork) -> float:
    """Return the volume of a kilogram of methane in the air of a site [m3/kg]."""
    return 1.0 / (GASES["methane"].molar_mass_kg_mol * air_density_mol_m3(_TEMPERATURE_K, network.pressure_pa))


def wind_record(network: MastNetwork) -> WindRecord:
    """Return the wind of the network's rows, as measured at the height of its masts."""
    height_m = float(np.median(network.masts_m[:, 2]))
    return WindRecord.of_means(network.clock_s, network.wind_world_m_s, height_m, period_s=network.period_s)


def find_source_m(network: MastNetwork, release: LoggedRelease) -> Floats | None:
    """Return the (3,) place of a release: its emission point at the height of its candidate place; None if unknown.

    Where the log names no place but has the point, the height is the median of all candidate places.
    """
    place = release.place or (None if network.has_several_places else next(iter(network.places_m)))
    if place is None:
        if release.position_m is None:
            return None
        return np.array([*release.position_m, np.median([place_m[2] for place_m in network.places_m.values()])])
    known_m = network.places_m[place]
    return np.array([*(release.position_m or known_m[:2]), known_m[2]])


def predict_releases(network: MastNetwork) -> Floats:
    """Return the (n, k) mixing ratios [ppm] that puffs of all releases add at masts; nan for unknown positions."""
    wind, volume = wind_record(network), methane_m3_per_kg(network)
    predicted = np.zeros(network.readings_ppm.shape)
    for release in network.releases:
        is_open = (network.clock_s >= release.start_s) & (network.clock_s < release.end_s)
        source_m = find_source_m(network, release)
        if source_m is None:
            predicted[is_open] = np.nan
            continue
        rows = np.flatnonzero(is_open)
        if len(rows):
            part = wind.rows(int(rows[0]), int(rows[-1]) + 1)
            predicted[rows] += release.rate_kg_s * volume * puff_responses(network.masts_m, part, source_m)
    return predicted


def find_hourly_background(network: MastNetwork, predicted_ppm: Floats) -> Floats:
    """Return the (n, k) background of readings [ppm]: the median of a mast in an hour while no plume reaches it."""
    hour = (network.clock_s // BACKGROUND_S).astype(np.int64)
    return background_beside_plumes(network.readings_ppm, predicted_ppm, hour, negligible_ppm=NEGLIGIBLE_PPM)
