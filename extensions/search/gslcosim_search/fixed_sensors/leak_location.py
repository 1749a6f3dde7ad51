"""Source position and rate of an event: comparison of readings with those of puffs from each position."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gslcosim_search import elementary
from gslcosim_search.fixed_sensors.events import Excess, LeakEvent
from gslcosim_search.fixed_sensors.puff_response import WindRecord, puff_responses
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
    search_place,
)

Floats = NDArray[np.float64]

# Puffs that left before an event began may still reach a sensor in it.
_ROWS_BEFORE = 10
# Readings at which less than this share of the event's largest response is expected do not constrain the rate.
_REACHED_SHARE = 0.05
# Places are compared by means over this: within it gas is early or late by what one anemometer cannot tell [s].
_MEAN_S = 180.0
# Gauss and Hermite's points and weights of a normal deviate: exact up to its fifth power.
_DEVIATES = ((-math.sqrt(3.0), 1.0 / 6.0), (0.0, 2.0 / 3.0), (math.sqrt(3.0), 1.0 / 6.0))
# A response below this share of its mean over errors of the wind's direction is the tail of a plume.
_TAIL_SHARE = 0.5
# Correlations that differ by less are nearly equal: of METEC's first eight releases, as seen by five to eight of the
# masts, the better place was right in half of such cases, and in 99.7 % above 0.2.
_LEAST_MARGIN = 0.05
# A reading is no more exact than this [ppm].
_LEAST_ERROR_PPM = 0.05
# Two places nearer than this are one where any place may be it [m].
_SAME_PLACE_M = 20.0


@dataclass(frozen=True)
class LeakRate:
    """Release of pure gas that an event's readings ask for.

    `rate_m3_s`, nan where the wind took no gas to a sensor. `is_upper_bound`: less may have been enough, for the model
    gives next to no gas where readings were high, or the readings are no more than noise.
    """

    rate_m3_s: float
    is_upper_bound: bool


@dataclass(frozen=True)
class LeakEstimate:
    """Estimate for one event.

    `place` the name of the likeliest candidate; `correlation` of readings and response for each; `rate_m3_s` of pure
    gas, nan where the wind took none of it to a sensor; `is_upper_bound` of the rate, as `LeakRate` has it; `certainty`
    of the place.
    """

    event: LeakEvent
    place: str
    correlation: Mapping[str, float]
    rate_m3_s: float
    is_upper_bound: bool
    certainty: PlaceCertainty


def response_correlation(response: Floats, above_ppm: Floats) -> float:
    """Return the correlation of responses and readings over all sensors and times; minus infinity without gas.

    Args:
        response: (m, k) what sensors read per release.
        above_ppm: (m, k) readings above background, nan where nothing was read.
    """
    is_read = np.isfinite(above_ppm) & np.isfinite(response)
    r, o = response[is_read], above_ppm[is_read]
    if len(r) < 2 or np.ptp(r) == 0.0 or np.ptp(o) == 0.0:
        return -np.inf
    return float(np.corrcoef(r, o)[0, 1])


def mean_rate_m3_s(response: Floats, above_ppm: Floats) -> float:
    """Return the release with which the response has the mean of the readings that it reaches.

    Q = sum above / sum r, over readings at which r is at least 5 % of its largest value in the event; see
    `source_search.rates_that_carry_the_mean` for why a ratio of means.
    """
    is_reached = _is_reached(response, above_ppm)
    total = float(response[is_reached].sum())
    return max(float(above_ppm[is_reached].sum()), 0.0) / total if total > 0.0 else float("nan")


# The readings that constrain a rate.
def _is_reached(response: Floats, above_ppm: Floats) -> NDArray[np.bool_]:
    is_read = np.isfinite(above_ppm) & np.isfinite(response)
    largest = float(response[is_read].max(initial=0.0))
    return np.asarray(is_read & (response >= _REACHED_SHARE * largest))


def bounded_rate(response: Floats, turned: Floats, above_ppm: Floats, noise_ppm: Floats) -> LeakRate:
    """Return the release of an event, as an upper bound where the model gives next to no gas.

    Q = sum above / sum r as `mean_rate_m3_s` has it. Where errors of the wind's direction alone would double sum r, the
    sensors are in the tail of the plume, where it tells nothing: Q is then that of the mean over those errors. Where
    the sum of readings is within two deviations of noise, Q is what would be above them.

    Args:
        response: (m, k) r, what sensors read per release.
        turned: (m, k) its mean over errors of the wind's direction.
        above_ppm: (m, k) readings above background, nan where nothing was read.
        noise_ppm: (k,) deviation of quiet readings.

    Source:
        Ours; the limit of detection as twice the deviation of a blank is Currie's 1968, doi:10.1021/ac60259a007, in
        round figures.
    Held by:
        extensions/search/tests/unit/fixed_sensors/test_leak_certainty.py
    """
    is_reached = _is_reached(response, above_ppm)
    total, wide = float(response[is_reached].sum()), float(turned[is_reached].sum())
    if not total > 0.0:
        return LeakRate(float("nan"), is_upper_bound=False)
    is_tail = total < _TAIL_SHARE * wide
    gas = max(float(above_ppm[is_reached].sum()), 0.0)
    variance = np.broadcast_to(np.square(noise_ppm), above_ppm.shape)[is_reached].sum()
    least = CLEAR_DEVIATIONS * math.sqrt(float(variance))
    is_noise = math.isfinite(least) and gas < least
    return LeakRate((gas + least if is_noise else gas) / (wide if is_tail else total), is_tail or is_noise)


def locate_among(
    event: LeakEvent, excess: Excess, wind: WindRecord, sensors_m: Floats, places_m: Mapping[str, Floats]
) -> LeakEstimate:
    """Return the candidate place whose puffs go best with an event's readings, how surely, and the rate from there.

    Args:
        event: Of `detect_events`.
        excess: Of `find_excess`.
        wind: Of the same rows.
        sensors_m: (k, 3) places of the sensors [m].
        places_m: Candidate places by name, (3,) each [m].

    Source:
        Correlation of a forward model with readings as Daniels, Jia and Hammerling 2024, Elementa (DLQ) rank places;
        puffs, detection and rates are ours.
    """
    return _choose_place(_PlaceScores(event, excess, wind, sensors_m), event, places_m)


def _choose_place(scores: "_PlaceScores", event: LeakEvent, places_m: Mapping[str, Floats]) -> LeakEstimate:
    correlation = {name: scores.correlate(place_m) for name, place_m in places_m.items()}
    best = max(correlation, key=lambda name: correlation[name])
    names = list(correlation)
    certainty = scores.certainty(np.array([name == best for name in names]), names)
    rate = scores.rate([places_m[best]], [1.0])
    return LeakEstimate(event, best, correlation, rate.rate_m3_s, rate.is_upper_bound, certainty)


def locate_in_plane(
    event: LeakEvent,
    excess: Excess,
    wind: WindRecord,
    sensors_m: Floats,
    *,
    height_m: float,
    margin_m: float = 20.0,
    coarse_m: float = 10.0,
    fine_m: float = 2.5,
) -> tuple[float, float]:
    """Return the place x, y [m] whose puffs go best with an event's readings, anywhere about the sensors.

    Args:
        event: Of `detect_events`.
        excess: Of `find_excess`.
        wind: Of the same rows.
        sensors_m: (k, 3) places of the sensors [m].
        margin_m: How far outside the sensors it may be.
        coarse_m: Spacing of the first grid of places.
    """
    scores = _PlaceScores(event, excess, wind, sensors_m)
    return _search_plane(scores, sensors_m, height_m, margin_m=margin_m, coarse_m=coarse_m, fine_m=fine_m)[0]


@dataclass(frozen=True)
class LeakPosition:
    """Where an event comes from: the candidate place, None without candidates; x, y [m]; pure gas [m3/s].

    `is_upper_bound` of the rate, as `LeakRate` has it; `certainty` of the place.
    """

    place: str | None
    position_m: tuple[float, float]
    rate_m3_s: float
    is_upper_bound: bool
    certainty: PlaceCertainty


def locate_event(
    event: LeakEvent,
    excess: Excess,
    wind: WindRecord,
    sensors_m: Floats,
    places_m: Mapping[str, Floats],
    *,
    source_height_m: float,
    coarse_m: float = 10.0,
    fine_m: float = 2.5,
) -> LeakPosition:
    """Return place and rate of an event: among candidate places, or where there are none anywhere in the plane.

    Args:
        event: Of `detect_events`.
        excess: Of `find_excess`.
        wind: Of the same rows.
        sensors_m: (k, 3) places of the sensors [m].
        places_m: Candidate places by name, (3,) each [m]; may be empty.
        source_height_m: Height of the source where there are none [m].
        coarse_m: Spacing of the first grid of places in the plane.
        fine_m: And of the last.
    """
    if places_m:
        found = locate_among(event, excess, wind, sensors_m, places_m)
        x_m, y_m = (float(x) for x in places_m[found.place][:2])
        return LeakPosition(found.place, (x_m, y_m), found.rate_m3_s, found.is_upper_bound, found.certainty)
    scores = _PlaceScores(event, excess, wind, sensors_m)
    best_m, visited_m = _search_plane(scores, sensors_m, source_height_m, coarse_m=coarse_m, fine_m=fine_m)
    is_same = np.array([elementary.distance(place_m, best_m) <= _SAME_PLACE_M for place_m in visited_m])
    certainty = scores.certainty(is_same, visited_m)
    rate = scores.rate([np.array([*best_m, source_height_m])], [1.0])
    return LeakPosition(None, best_m, rate.rate_m3_s, rate.is_upper_bound, certainty)


def locate_sources(
    event: LeakEvent,
    excess: Excess,
    wind: WindRecord,
    sensors_m: Floats,
    places_m: Mapping[str, Floats],
    *,
    source_height_m: float,
) -> list[LeakPosition]:
    """Return places and rates of all sources that were open in an event; without candidate places it is one.

    The first is that of `locate_event`. Another candidate joins as long as the readings, fitted jointly with a rate for
    each place, become likelier by more than errors of the model make them; then each place is tried against the
    others. What all release carries the mean of the readings, and is shared as the joint fit has it.

    Args:
        event: Of `detect_events`.
        excess: Of `find_excess`.
        wind: Of the same rows.
        sensors_m: (k, 3) places of the sensors [m].
        places_m: Candidate places by name, (3,) each [m]; may be empty.
        source_height_m: Height of the source where there are none [m].
    """
    if not places_m:
        return [locate_event(event, excess, wind, sensors_m, places_m, source_height_m=source_height_m)]
    scores = _PlaceScores(event, excess, wind, sensors_m)
    first = _choose_place(scores, event, places_m)
    names, sure = [first.place], [first.certainty]
    while len(names) < len(places_m):
        more, certainty = scores.add_place(names, list(places_m))
        if scores.gain(names, more, list(places_m)) < 1.0:
            break
        names, sure = more, [*sure, certainty]
    shares = [1.0] if len(names) == 1 else scores.share(names, list(places_m))
    rate = scores.rate([places_m[name] for name in names], shares)
    return [
        LeakPosition(
            name,
            (float(places_m[name][0]), float(places_m[name][1])),
            share * rate.rate_m3_s,
            rate.is_upper_bound,
            certainty,
        )
        for name, share, certainty in zip(names, shares, sure, strict=True)
    ]


def _search_plane(
    scores: "_PlaceScores",
    sensors_m: Floats,
    height_m: float,
    *,
    margin_m: float = 20.0,
    coarse_m: float = 10.0,
    fine_m: float = 2.5,
) -> tuple[tuple[float, float], list[tuple[float, float]]]:
    low_m, high_m = sensors_m.min(axis=0) - margin_m, sensors_m.max(axis=0) + margin_m
    visited_m: list[tuple[float, float]] = []

    def goodness(place_m: tuple[float, float]) -> float:
        visited_m.append(place_m)
        return scores.correlate(np.array([*place_m, height_m]))

    corners = ((float(low_m[0]), float(low_m[1])), (float(high_m[0]), float(high_m[1])))
    return search_place(goodness, *corners, coarse_m=coarse_m, fine_m=fine_m), visited_m


class _PlaceScores:
    # Correlation of an event's readings with puffs from one place after another, whole and by blocks of rows.
    def __init__(self, event: LeakEvent, excess: Excess, wind: WindRecord, sensors_m: Floats) -> None:
        self._event, self._sensors_m, self._noise_ppm = event, sensors_m, excess.noise_ppm
        self._above_ppm = excess.above_ppm[event.first : event.last + 1]
        self._period_s = wind.period_s
        first = max(event.first - _ROWS_BEFORE, 0)
        self._n_before, rows = event.first - first, wind.rows(first, event.last + 1)
        self._wind = rows
        start_s = wind.start_s[event.first : event.last + 1]
        self._block, self._draws = draw_blocks(start_s, f"fixed_sensors.leak_location.{event.first}")
        self._start_s = start_s
        self._means_ppm = self._mean(self._above_ppm)
        self._responses: list[Floats] = []
        self._correlations: list[float] = []
        self._sums: list[Floats] = []

    def correlate(self, place_m: Floats) -> float:
        response = self._mean(self._respond(self._wind, place_m))
        self._responses.append(response)
        self._correlations.append(response_correlation(response, self._means_ppm))
        self._sums.append(self._sum_blocks(response))
        return self._correlations[-1]

    # Of the places so far, of which some count as the best.
    def certainty(self, is_best: NDArray[np.bool_], places: "list[str] | list[tuple[float, float]]") -> PlaceCertainty:
        # (blocks, 6 p), of which a draw takes some several times.
        sums = np.stack(self._sums, axis=2).reshape(len(self._sums[0]), -1)
        n, r, a, rr, aa, ra = elementary.product(self._draws, sums).reshape(len(self._draws), 6, -1).transpose(1, 0, 2)
        with np.errstate(divide="ignore", invalid="ignore"):
            drawn = (ra - r * a / n) / np.sqrt((rr - r * r / n) * (aa - a * a / n))
        drawn = np.where(np.isfinite(drawn), drawn, -1.0)
        return rank_places(np.array(self._correlations), drawn, is_best, places, least_margin=_LEAST_MARGIN)

    # Of sources at some places, of which each has a share of the release.
    def rate(self, places_m: Sequence[Floats], shares: Sequence[float]) -> LeakRate:
        response, turned = np.zeros_like(self._above_ppm), np.zeros_like(self._above_ppm)
        for place_m, share in zip(places_m, shares, strict=True):
            response += share * self._respond(self._wind, place_m)
            for deviate, weight in _DEVIATES:
                turned += share * weight * self._respond(_turn(self._wind, deviate), place_m)
        return bounded_rate(response, turned, self._above_ppm, self._noise_ppm)

    # The likeliest further candidate, after which each is tried against those that are left; names are in the order of
    # `correlate`.
    def add_place(self, names: list[str], candidates: list[str]) -> tuple[list[str], PlaceCertainty]:
        left = [name for name in candidates if name not in names]
        fits = [self._fit([*names, name], candidates) for name in left]
        best = int(np.argmax([fit.log_likelihood for fit in fits]))
        more = [*names, left[best]]
        for i in range(len(more)):
            others = [name for name in candidates if name not in more]
            options = [more, *([*more[:i], name, *more[i + 1 :]] for name in others)]
            more = max(options, key=lambda each: self._fit(each, candidates).log_likelihood)
        blocks = np.stack([np.bincount(self._block, fit.row_log_likelihood) for fit in fits], axis=1)
        is_best = np.arange(len(left)) == best
        scores = np.array([fit.log_likelihood for fit in fits])
        drawn = elementary.product(self._draws, blocks)
        return more, rank_places(scores, drawn, is_best, left, least_margin=LEAST_LOG_MARGIN)

    def gain(self, names: list[str], more: list[str], candidates: list[str]) -> float:
        n = int(np.isfinite(self._means_ppm).sum())
        return gain_of_sources(self._fit(names, candidates), self._fit(more, candidates), n, self._block)

    # Of what all release, by place.
    def share(self, names: list[str], candidates: list[str]) -> list[float]:
        rates = self._fit(names, candidates).rates_m3_s
        return (rates / rates.sum()).tolist()

    def _fit(self, names: list[str], candidates: list[str]) -> TermsFit:
        error_ppm = float(np.max(self._noise_ppm, where=np.isfinite(self._noise_ppm), initial=_LEAST_ERROR_PPM))
        return fit_terms(
            np.stack([self._responses[candidates.index(name)] for name in names]),
            self._means_ppm,
            np.zeros(len(self._means_ppm), dtype=np.int64),
            BackgroundPrior(0.0, error_ppm),
            reading_error_ppm=error_ppm,
        )

    # With puffs from a little before the event.
    def _respond(self, wind: WindRecord, place_m: Floats) -> Floats:
        return puff_responses(self._sensors_m, wind, place_m)[self._n_before :]

    # Means over `_MEAN_S` about each row, of what was read; rows on the other side of a gap take no part.
    def _mean(self, values: Floats) -> Floats:
        half = max(round(0.5 * (_MEAN_S / self._period_s - 1.0)), 0)
        total, count = np.zeros(values.shape), np.zeros(values.shape)
        n = len(values)
        for off in range(-half, half + 1):
            here, there = slice(max(-off, 0), n - max(off, 0)), slice(max(off, 0), n - max(-off, 0))
            if here.start >= here.stop:
                continue
            is_near = np.abs(self._start_s[there] - self._start_s[here]) <= (abs(off) + 0.5) * self._period_s
            is_read = np.isfinite(values[there]) & is_near[:, None]
            total[here] += np.where(is_read, values[there], 0.0)
            count[here] += is_read
        return np.where(np.isfinite(values), total / np.maximum(count, 1.0), np.nan)

    # (blocks, 6): how many, and sums of r, a, r^2, a^2 and r a.
    def _sum_blocks(self, response: Floats) -> Floats:
        is_read = np.isfinite(self._means_ppm) & np.isfinite(response)
        r, a = np.where(is_read, response, 0.0), np.where(is_read, self._means_ppm, 0.0)
        of_rows = np.stack([is_read.sum(axis=1), *(x.sum(axis=1) for x in (r, a, r * r, a * a, r * a))], axis=1)
        return np.stack(
            [np.bincount(self._block, column) for column in of_rows.T.astype(np.float64)], axis=1, dtype=np.float64
        )


# Wind whose direction is off by so many deviations of a period's direction: one place is a sample of the yard's air.
def _turn(wind: WindRecord, deviate: float) -> WindRecord:
    if deviate == 0.0:
        return wind
    speed = np.linalg.norm(wind.mean_world_m_s, axis=1)
    angle = deviate * wind.across_std_m_s / np.maximum(speed, wind.across_std_m_s)
    cos, sin = elementary.cos_each(angle), elementary.sin_each(angle)
    east, north = wind.mean_world_m_s.T
    return replace(wind, mean_world_m_s=np.column_stack([cos * east - sin * north, sin * east + cos * north]))
