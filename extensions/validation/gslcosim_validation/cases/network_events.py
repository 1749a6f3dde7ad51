"""Leaks found by masts: events, places and rates from a log, beside the releases (METEC, Stanford)."""

import math
from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from gslcosim_bench.statistics.estimates import Estimate
from gslcosim_bench.statistics.rates import wilson
from gslcosim_search.fixed_sensors.events import Excess, LeakEvent, detect_events, find_excess
from gslcosim_search.fixed_sensors.leak_location import LeakPosition, locate_event, locate_sources
from gslcosim_search.fixed_sensors.source_search import PlaceCertainty
from gslcosim_validation.mast_data import methane_m3_per_kg, wind_record
from gslcosim_validation.readers.mast_network import LoggedRelease, MastNetwork
from gslcosim_validation.results import Effort, Figure, Findings, Progress, median_estimate, plain_estimate

Floats = NDArray[np.float64]

# An event overlaps a release by a minute at least, as the published method is scored.
OVERLAP_S = 60.0
SOON_S = 900.0
# Releases that are over sooner can hardly be alarmed within `SOON_S`.
LONG_S = 300.0
NEAR_M = 20.0
_HOUR_S = 3600.0


class _Span(Protocol):
    @property
    def start_s(self) -> float: ...
    @property
    def end_s(self) -> float: ...


def find_overlaps(events: Sequence[_Span], release: _Span) -> list[int]:
    """Return the indices of the events that overlap a release by a minute at least; either may be shorter."""
    return [
        i
        for i, event in enumerate(events)
        if min(event.end_s + OVERLAP_S, release.end_s) - max(event.start_s, release.start_s) >= OVERLAP_S
    ]


def measure(network: MastNetwork, effort: Effort, progress: Progress) -> Findings:
    """Return how events agree with releases: in time, in place, in rate."""
    progress("events", None)
    excess = find_excess(network.clock_s, network.readings_ppm)
    events = detect_events(network.clock_s, excess)
    overlaps = [find_overlaps(events, release) for release in network.releases]
    figures = _detection_figures(network, excess, events, overlaps)
    wind, labels = wind_record(network), [["event"]] * len(events)
    if network.has_several_places:
        places_m = {name: np.array(place_m) for name, place_m in network.places_m.items()}
        found = [
            locate_sources(event, excess, wind, network.masts_m, places_m, source_height_m=math.nan) for event in events
        ]
        figures += _place_figures(network, events, found, overlaps)
        figures.append(_unsure_figure([each.certainty for sources in found for each in sources]))
        labels = [[str(each.place) for each in sources] for sources in found]
    else:
        figures += _plane_figures(network, excess, events, overlaps, effort, progress)
    return Findings(
        figures=figures, drawings={"timeline": lambda figure: _draw(figure, network, excess, labels, events)}
    )


# A count of n with the ends of a binomial interval.
def _count(k: int, n: int) -> Estimate:
    share = wilson(k, n)
    return Estimate(float(k), n * share.low, n * share.high, n)


def _detection_figures(
    network: MastNetwork, excess: Excess, events: tuple[LeakEvent, ...], overlaps: list[list[int]]
) -> list[Figure]:
    n_false = len(events) - len({i for some in overlaps for i in some})
    is_long = [release for release in network.releases if release.end_s - release.start_s > LONG_S]
    n_soon = sum(_delay_s(network, excess, release) <= SOON_S for release in is_long)
    return [
        Figure("touched", _count(sum(bool(some) for some in overlaps), len(network.releases))),
        Figure("false", plain_estimate(n_false, len(events))),
        Figure("soon", _count(n_soon, len(is_long))),
    ]


def _delay_s(network: MastNetwork, excess: Excess, release: LoggedRelease) -> float:
    within = excess.counts & (network.clock_s >= release.start_s) & (network.clock_s <= release.end_s)
    return float(network.clock_s[np.argmax(within)] - release.start_s) if within.any() else math.inf


def _place_figures(
    network: MastNetwork, events: Sequence[LeakEvent], found: list[list[LeakPosition]], overlaps: list[list[int]]
) -> list[Figure]:
    n, volume = len(network.releases), methane_m3_per_kg(network)
    n_exact = n_partly = n_bounds = 0
    ratios: list[float] = []
    for release, some in zip(network.releases, overlaps, strict=True):
        names = [{each.place for each in found[i]} for i in some]
        # Places of other releases that were open at the same time are right, too.
        others = {other.place for other in network.releases if _shared_s(other, release) >= OVERLAP_S}
        n_partly += any(release.place in each for each in names)
        n_exact += bool(some) and all(release.place in each and each <= {release.place, *others} for each in names)
        if some:
            sources = found[max(some, key=lambda i: events[i].end_s - events[i].start_s)]
            mine = next((each for each in sources if each.place == release.place), sources[0])
            ratios.append(mine.rate_m3_s / volume / release.rate_kg_s)
            n_bounds += mine.is_upper_bound
    return [
        Figure("exact", _count(n_exact, n)),
        Figure("partly", _count(n_partly, n)),
        Figure("rate", median_estimate(ratios), n_bounds=n_bounds),
    ]


def _shared_s(a: LoggedRelease, b: LoggedRelease) -> float:
    return min(a.end_s, b.end_s) - max(a.start_s, b.start_s)


def _unsure_figure(certainties: list[PlaceCertainty]) -> Figure:
    margin = min((each.margin for each in certainties if each.is_unsure), default=math.nan)
    least = f", the nearest other place {margin:.2f} behind" if math.isfinite(margin) else ""
    return Figure("unsure", plain_estimate(sum(each.is_unsure for each in certainties), len(certainties)), least=least)


def _plane_figures(
    network: MastNetwork,
    excess: Excess,
    events: tuple[LeakEvent, ...],
    overlaps: list[list[int]],
    effort: Effort,
    progress: Progress,
) -> list[Figure]:
    wind, true_m = wind_record(network), np.array(next(iter(network.places_m.values())))
    error_m: list[float] = []
    certainties: list[PlaceCertainty] = []
    for i, event in enumerate(events):
        progress(f"place of event {i + 1} of {len(events)}", i / len(events))
        steps = {"coarse_m": 20.0, "fine_m": 10.0} if effort == "quick" else {}
        found = locate_event(event, excess, wind, network.masts_m, {}, source_height_m=float(true_m[2]), **steps)
        error_m.append(float(np.hypot(*(np.array(found.position_m) - true_m[:2]))))
        certainties.append(found.certainty)
    n_near = sum(any(error_m[i] <= NEAR_M for i in some) for some in overlaps)
    return [Figure("near", _count(n_near, len(network.releases))), _unsure_figure(certainties)]


def _draw(
    figure: Any, network: MastNetwork, excess: Excess, labels: Sequence[Sequence[str]], events: tuple[LeakEvent, ...]
) -> None:
    begin_s = network.clock_s[0]
    order = list(network.places_m) if network.has_several_places else ["event"]
    above, below = figure.subplots(2, 1, sharex=True)
    hours = (network.clock_s - begin_s) / _HOUR_S
    with np.errstate(invalid="ignore"):
        largest = np.nanmax(np.where(np.isfinite(excess.above_ppm), excess.above_ppm, -np.inf), axis=1)
    above.semilogy(hours, np.maximum(largest, 0.1), lw=0.5)
    above.set(ylabel="largest mast above\nbackground [ppm]")
    for release in network.releases:
        y = order.index(release.place) if release.place in order else 0
        ends = [(release.start_s - begin_s) / _HOUR_S, (release.end_s - begin_s) / _HOUR_S]
        below.plot(ends, [y, y], color="0.75", lw=8, solid_capstyle="butt")
    for event, some in zip(events, labels, strict=True):
        ends = [(event.start_s - begin_s) / _HOUR_S, (event.end_s - begin_s) / _HOUR_S]
        for label in some:
            y = order.index(label)
            below.plot(ends, [y, y], color="C1", lw=2.5, solid_capstyle="butt")
    below.set(yticks=range(len(order)), yticklabels=order, xlabel="hours since the log began")
    below.set_ylim(-0.6, len(order) - 0.4)
