"""Source position and rate of an event: comparison of readings with those of puffs from each position."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gslcosim_search.fixed_sensors.events import Excess, LeakEvent
from gslcosim_search.fixed_sensors.puff_response import WindRecord, puff_responses
from gslcosim_search.fixed_sensors.source_search import search_place

Floats = NDArray[np.float64]

# Puffs that left before an event began may still reach a sensor in it.
_ROWS_BEFORE = 10
# Readings at which less than this share of the event's largest response is expected do not constrain the rate.
_REACHED_SHARE = 0.05


@dataclass(frozen=True)
class LeakEstimate:
    """Estimate for one event.

    `place` the name of the likeliest candidate; `correlation` of readings and response for each; `rate_m3_s` of pure
    gas, nan where the wind took none of it to a sensor.
    """

    event: LeakEvent
    place: str
    correlation: Mapping[str, float]
    rate_m3_s: float


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
    is_read = np.isfinite(above_ppm) & np.isfinite(response)
    largest = float(response[is_read].max(initial=0.0))
    is_reached = is_read & (response >= _REACHED_SHARE * largest)
    total = float(response[is_reached].sum())
    return max(float(above_ppm[is_reached].sum()), 0.0) / total if total > 0.0 else float("nan")


def locate_among(
    event: LeakEvent, excess: Excess, wind: WindRecord, sensors_m: Floats, places_m: Mapping[str, Floats]
) -> LeakEstimate:
    """Return the candidate place whose puffs go best with an event's readings, and the rate from there.

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
    above = excess.above_ppm[event.first : event.last + 1]
    responses = {name: _responses(event, wind, sensors_m, place_m) for name, place_m in places_m.items()}
    correlation = {name: response_correlation(response, above) for name, response in responses.items()}
    best = max(correlation, key=lambda name: correlation[name])
    return LeakEstimate(event, best, correlation, mean_rate_m3_s(responses[best], above))


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
    above = excess.above_ppm[event.first : event.last + 1]
    low_m, high_m = sensors_m.min(axis=0) - margin_m, sensors_m.max(axis=0) + margin_m

    def goodness(place_m: tuple[float, float]) -> float:
        return response_correlation(_responses(event, wind, sensors_m, np.array([*place_m, height_m])), above)

    corners = ((float(low_m[0]), float(low_m[1])), (float(high_m[0]), float(high_m[1])))
    return search_place(goodness, *corners, coarse_m=coarse_m, fine_m=fine_m)


@dataclass(frozen=True)
class LeakPosition:
    """Where an event comes from: the candidate place, None without candidates; x, y [m]; pure gas [m3/s]."""

    place: str | None
    position_m: tuple[float, float]
    rate_m3_s: float


def locate_event(
    event: LeakEvent,
    excess: Excess,
    wind: WindRecord,
    sensors_m: Floats,
    places_m: Mapping[str, Floats],
    *,
    source_height_m: float,
) -> LeakPosition:
    """Return place and rate of an event: among candidate places, or where there are none anywhere in the plane.

    Args:
        event: Of `detect_events`.
        excess: Of `find_excess`.
        wind: Of the same rows.
        sensors_m: (k, 3) places of the sensors [m].
        places_m: Candidate places by name, (3,) each [m]; may be empty.
        source_height_m: Height of the source where there are none [m].
    """
    if places_m:
        found = locate_among(event, excess, wind, sensors_m, places_m)
        x_m, y_m = (float(x) for x in places_m[found.place][:2])
        return LeakPosition(found.place, (x_m, y_m), found.rate_m3_s)
    x_m, y_m = locate_in_plane(event, excess, wind, sensors_m, height_m=source_height_m)
    response = _responses(event, wind, sensors_m, np.array([x_m, y_m, source_height_m]))
    return LeakPosition(None, (x_m, y_m), mean_rate_m3_s(response, excess.above_ppm[event.first : event.last + 1]))


# Of the event's rows, with puffs from a little before.
def _responses(event: LeakEvent, wind: WindRecord, sensors_m: Floats, source_m: Floats) -> Floats:
    first = max(event.first - _ROWS_BEFORE, 0)
    response = puff_responses(sensors_m, wind.rows(first, event.last + 1), source_m)
    return response[event.first - first :]
