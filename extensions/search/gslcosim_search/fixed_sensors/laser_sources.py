"""Places and rates of sources that laser paths see: one or several that are open in rows of their own."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gslcosim_search import elementary
from gslcosim_search.fixed_sensors.plume_response import SensorPaths, WindStatistics, plume_responses
from gslcosim_search.fixed_sensors.source_search import (
    CLEAR_DEVIATIONS,
    LEAST_LOG_MARGIN,
    BackgroundPrior,
    PlaceCertainty,
    TermsFit,
    draw_blocks,
    fit_terms,
    gain_of_sources,
    rank_places,
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
# A handful of paths cannot separate more at once.
_MOST_SOURCES = 4
# Rounds in which each place is sought anew beside the others.
_PLACE_ROUNDS = 2
# Places nearer than this are one [m].
_SAME_PLACE_M = 3.0


@dataclass(frozen=True, kw_only=True, eq=False)
class PathRecord:
    """Readings of k laser paths in n periods, with the wind and which source was open.

    Attributes:
        sensors: The paths.
        source: (n,) number of the source that was open, 0 … s - 1; sources that were open together share one.
        start_s: (n,) of each period [s].
        wind: Of each period.
        gas_m3_per_kg: (n,) volume of a kilogram of the gas in that air.
        readings_ppm: (n, k), nan where a path has none.
        day: (n,) labels of rows that share backgrounds.
    """

    sensors: SensorPaths
    source: NDArray[np.int64]
    start_s: Floats
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


@dataclass(frozen=True)
class PathSource:
    """A source that was found: x, y [m], rate, and how surely.

    `source` number of its rows, as `PathRecord` has it; `rate_kg_s`, of which `is_upper_bound` says that it may have
    been less, since the readings that it explains are no more than noise; `certainty` of the place, by the logarithm of
    the likelihood, beside places farther than 3 m away.
    """

    source: int
    position_m: Place
    rate_kg_s: float
    is_upper_bound: bool
    certainty: PlaceCertainty


class PlaceSearch:
    """Likelihood of the places of sources, given the rows in which they were open; responses are computed once."""

    def __init__(
        self, record: PathRecord, i: int, prior: BackgroundPrior, *, source_height_m: float = _GROUND_SOURCE_M
    ) -> None:
        """Take the rows of source i, the prior of backgrounds and the height of the source [m]."""
        self.number = i
        self.rows = record.source == i
        self._record, self._wind, self._prior, self._height_m = record, record.wind_of(i), prior, source_height_m
        self._day = np.unique(record.day[self.rows], return_inverse=True)[1].astype(np.int64)
        self._block, self._draws = draw_blocks(record.start_s[self.rows], f"fixed_sensors.laser_sources.{i}")
        self._responses: dict[Place, Floats] = {}
        self._visited: dict[Place, TermsFit] = {}

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
        return self.fit((place_m,), weight).log_likelihood

    def rate_kg_s(self, place_m: Place) -> float:
        """Return the likeliest rate at a place."""
        return self.fit((place_m,)).rate_m3_s

    def find_best(self, beside: Sequence[Place] = ()) -> Place:
        """Return the likeliest place within 20 m of the paths, beside sources at given places."""
        self._visited = {}

        def log_likelihood(place_m: Place) -> float:
            self._visited[place_m] = self.fit((*beside, place_m))
            return self._visited[place_m].log_likelihood

        return search_place(log_likelihood, *self._corners_m)

    def find_all(self) -> tuple[list[Place], list[PlaceCertainty]]:
        """Return the places of all sources that readings tell apart, one at least, and how sure they are.

        Sources are added one by one, each time the likeliest beside the others, whose places are then sought anew, as
        long as readings as a whole and quarters of an hour, one as the other, become likelier by more than errors of
        the model make them. A source at the edge of the area is none: gas from elsewhere looks like that.
        """
        places = [self.find_best()]
        sure = [self._certainty(places[0])]
        while len(places) < _MOST_SOURCES:
            more = [*places, self.find_best(places)]
            if self._gain(places, more) < 0.5:
                break
            surer: list[PlaceCertainty] = []
            for _ in range(_PLACE_ROUNDS):
                before, surer = list(more), []
                for i in range(len(more)):
                    more[i] = self.find_best([*more[:i], *more[i + 1 :]])
                    surer.append(self._certainty(more[i]))
                if more == before:
                    break
            if self._gain(places, more) < 1.0 or any(self._is_at_edge(place_m) for place_m in more):
                break
            places, sure = more, surer
        return places, sure

    # Of further sources, over the least that counts.
    def _gain(self, places: Sequence[Place], more: Sequence[Place]) -> float:
        n = int(np.isfinite(self._record.readings_ppm[self.rows]).sum())
        return gain_of_sources(self.fit(places), self.fit(more), n, self._block)

    def _certainty(self, best_m: Place) -> PlaceCertainty:
        places = list(self._visited)
        scores = np.array([self._visited[place_m].log_likelihood for place_m in places])
        blocks = np.stack(
            [np.bincount(self._block, self._visited[place_m].row_log_likelihood) for place_m in places], axis=1
        )
        is_best = np.array([elementary.distance(place_m, best_m) <= _SAME_PLACE_M for place_m in places])
        drawn = elementary.product(self._draws, blocks)
        return rank_places(scores, drawn, is_best, places, least_margin=LEAST_LOG_MARGIN)

    @property
    def _corners_m(self) -> tuple[Place, Place]:
        points_m = self._record.sensors.points_m.reshape(-1, 3)
        low_m, high_m = points_m.min(axis=0) - _MARGIN_M, points_m.max(axis=0) + _MARGIN_M
        return (float(low_m[0]), float(low_m[1])), (float(high_m[0]), float(high_m[1]))

    def _is_at_edge(self, place_m: Place) -> bool:
        low_m, high_m = self._corners_m
        return any(
            not low + _SAME_PLACE_M < x < high - _SAME_PLACE_M
            for x, low, high in zip(place_m, low_m, high_m, strict=True)
        )

    def bound_rate(self, place_m: Place, rate_kg_s: float) -> tuple[float, bool]:
        """Return a rate, and whether it is an upper bound: what it adds to readings is within two deviations of noise.

        The bound is what would add two more deviations.
        """
        response = self.response(place_m)
        is_reached = np.isfinite(response) & np.isfinite(self._record.readings_ppm[self.rows])
        is_reached &= rate_kg_s * response >= READING_ERROR_PPM
        if not is_reached.any():
            is_reached = np.isfinite(response) & np.isfinite(self._record.readings_ppm[self.rows])
        total = float(response[is_reached].sum())
        least_ppm = CLEAR_DEVIATIONS * _MINUTE_ERROR_PPM * math.sqrt(float(is_reached.sum()))
        if not total > 0.0 or rate_kg_s * total >= least_ppm:
            return rate_kg_s, not total > 0.0
        return rate_kg_s + least_ppm / total, True

    def fit(self, places_m: Sequence[Place], weight: Floats | None = None) -> TermsFit:
        """Return the likeliest rates [kg/s] and backgrounds of sources at some places, all open at once."""
        return fit_terms(
            np.stack([self.response(place_m) for place_m in places_m]),
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
    """Return the (s,) rates of sources that were open alone, at given places, as `find_joint_rates_kg_s` does."""
    rates = find_joint_rates_kg_s(record, searches, [[place_m] for place_m in places_m], weight)
    return np.array([rate for (rate,) in rates])


def find_joint_rates_kg_s(
    record: PathRecord,
    searches: Sequence[PlaceSearch],
    places_m: Sequence[Sequence[Place]],
    weight: Floats | None = None,
) -> list[Floats]:
    """Return the rates of sources at given places, by search; nan where the plumes reach no path.

    Backgrounds of a day are those of all sources of that day: where one hides them, another may not. What sources that
    were open together release is shared as the joint fit has it, and their sum carries the mean.

    Args:
        record: Of all sources.
        places_m: x, y of the sources of each search [m].
        weight: (n,) how often each row counts, a whole number (bootstrap); None: once.
    """
    n = len(record.source)
    taken = np.arange(n) if weight is None else np.repeat(np.arange(n), weight.astype(np.int64))
    response = np.empty_like(record.readings_ppm)
    shares, totals = [], []
    for search, places in zip(searches, places_m, strict=True):
        fit = search.fit(places)
        totals.append(fit.rate_m3_s)
        shares.append(fit.rates_m3_s / totals[-1] if totals[-1] > 0.0 else np.full(len(places), 1.0 / len(places)))
        response[search.rows] = sum(
            share * search.response(place_m) for share, place_m in zip(shares[-1], places, strict=True)
        )
    rates = rates_that_carry_the_mean(
        response[taken],
        record.readings_ppm[taken],
        record.source[taken],
        record.day[taken],
        np.array(totals),
        negligible_ppm=READING_ERROR_PPM,
    )
    return [rate * share for rate, share in zip(rates, shares, strict=True)]


def find_sources(record: PathRecord, *, source_height_m: float = _GROUND_SOURCE_M) -> list[PathSource]:
    """Return all sources that a record tells apart, those of the same rows one after the other."""
    searches = build_searches(record, source_height_m=source_height_m)
    found = [search.find_all() for search in searches]
    rates = find_joint_rates_kg_s(record, searches, [places_m for places_m, _ in found])
    sources: list[PathSource] = []
    for search, (places_m, sure), carried in zip(searches, found, rates, strict=True):
        # Without a reading beside the plume no background is known but that of the fit.
        fitted = carried if np.isfinite(carried).all() else search.fit(places_m).rates_m3_s
        for place_m, certainty, rate in zip(places_m, sure, fitted, strict=True):
            rate_kg_s, is_bound = search.bound_rate(place_m, float(rate))
            sources.append(PathSource(search.number, place_m, rate_kg_s, is_bound, certainty))
    return sources
