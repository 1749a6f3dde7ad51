"""Places and rates of sources that laser paths see, each of them open in rows of its own."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gslcosim_search.fixed_sensors.plume_response import SensorPaths, WindStatistics, plume_responses
from gslcosim_search.fixed_sensors.source_search import (
    BackgroundPrior,
    TermsFit,
    fit_terms,
    rates_that_carry_the_mean,
    search_place,
)

Floats = NDArray[np.float64]
Place = tuple[float, float]

READING_ERROR_PPM = 0.01
"""Error of one reading of a laser (median of `ch4_error_ppm` of Chilbolton's records); plumes below count as none."""

# A minute's average over 12 to 20 readings of a plume that flickers is worse than one reading of still air.
_MINUTE_ERROR_PPM = 0.05
# A source near the ground, as the authors of Chilbolton's inversion take it.
_GROUND_SOURCE_M = 0.3
# Around the paths, where sources are sought.
_MARGIN_M = 20.0


@dataclass(frozen=True, kw_only=True, eq=False)
class PathRecord:
    """Readings of k laser paths in n periods, with the wind and which source was open.

    Attributes:
        sensors: The paths.
        source: (n,) number of the source that was open, 0 … s - 1.
        wind: Of each period.
        gas_m3_per_kg: (n,) volume of a kilogram of the gas in that air.
        readings_ppm: (n, k), nan where a path has none.
        day: (n,) labels of rows that share backgrounds.
    """

    sensors: SensorPaths
    source: NDArray[np.int64]
    wind: WindStatistics
    gas_m3_per_kg: Floats
    readings_ppm: Floats
    day: NDArray[np.int64]

    def wind_of(self, i: int) -> WindStatistics:
        """Return the wind of one source's rows."""
        rows = self.source == i
        return WindStatistics(
            self.wind.mean_world_m_s[rows], self.wind.across_std_m_s[rows], self.wind.up_std_m_s[rows]
        )


class PlaceSearch:
    """Likelihood of the places of one source, given its rows; responses to a place are computed once."""

    def __init__(
        self, record: PathRecord, i: int, prior: BackgroundPrior, *, source_height_m: float = _GROUND_SOURCE_M
    ) -> None:
        """Take the rows of source i, the prior of backgrounds and the height of the source [m]."""
        self.rows = record.source == i
        self._record, self._wind, self._prior, self._height_m = record, record.wind_of(i), prior, source_height_m
        self._day = np.unique(record.day[self.rows], return_inverse=True)[1].astype(np.int64)
        self._responses: dict[Place, Floats] = {}

    def response(self, place_m: Place) -> Floats:
        """Return the (n, k) response per kg/s to a source at a place [ppm s/kg]."""
        if place_m not in self._responses:
            response = plume_responses(self._record.sensors, self._wind, np.array([*place_m, self._height_m]))
            self._responses[place_m] = self._record.gas_m3_per_kg[self.rows, None] * response
        return self._responses[place_m]

    def log_likelihood(self, place_m: Place, weight: Floats | None = None) -> float:
        """Return the logarithm of the likelihood of all readings, at the best rate and backgrounds there.

        Args:
            place_m: x, y [m].
            weight: How often each row counts (bootstrap); None: once.
        """
        return self._fit(place_m, weight).log_likelihood

    def rate_kg_s(self, place_m: Place) -> float:
        """Return the likeliest rate at a place."""
        return self._fit(place_m, None).rate_m3_s

    def find_best(self) -> Place:
        """Return the likeliest place within 20 m of the paths."""
        points_m = self._record.sensors.points_m.reshape(-1, 3)
        low_m, high_m = points_m.min(axis=0) - _MARGIN_M, points_m.max(axis=0) + _MARGIN_M
        return search_place(
            self.log_likelihood, (float(low_m[0]), float(low_m[1])), (float(high_m[0]), float(high_m[1]))
        )

    def _fit(self, place_m: Place, weight: Floats | None) -> TermsFit:
        return fit_terms(
            self.response(place_m),
            self._record.readings_ppm[self.rows],
            self._day,
            self._prior,
            reading_error_ppm=_MINUTE_ERROR_PPM,
            weight=weight,
        )


def build_searches(record: PathRecord, *, source_height_m: float = _GROUND_SOURCE_M) -> list[PlaceSearch]:
    """Return a search for each source of a record."""
    prior = BackgroundPrior.of_readings(record.readings_ppm, reading_error_ppm=READING_ERROR_PPM)
    n_sources = int(record.source.max()) + 1
    return [PlaceSearch(record, i, prior, source_height_m=source_height_m) for i in range(n_sources)]


def find_rates_kg_s(
    record: PathRecord, searches: Sequence[PlaceSearch], places_m: Sequence[Place], weight: Floats | None = None
) -> Floats:
    """Return the (s,) rates of sources at given places; nan where the plume reaches no path.

    Backgrounds of a day are those of all sources of that day: where one hides them, another may not.

    Args:
        record: Of all sources.
        places_m: x, y of each source [m].
        weight: (n,) how often each row counts, a whole number (bootstrap); None: once.
    """
    n = len(record.source)
    taken = np.arange(n) if weight is None else np.repeat(np.arange(n), weight.astype(np.int64))
    response = np.empty_like(record.readings_ppm)
    for search, place_m in zip(searches, places_m, strict=True):
        response[search.rows] = search.response(place_m)
    return rates_that_carry_the_mean(
        response[taken],
        record.readings_ppm[taken],
        record.source[taken],
        record.day[taken],
        np.array([search.rate_kg_s(place_m) for search, place_m in zip(searches, places_m, strict=True)]),
        negligible_ppm=READING_ERROR_PPM,
    )
