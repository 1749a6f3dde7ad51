"""Estimators of logs: what an entry of the suite is, and the bundled ones."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from gslcosim.base.rng import stream
from gslcosim.runtime.processes.sandbox.selection import NONE_IN_THIS_PROCESS
from gslcosim_search.bayes.source_terms import PlumeSensor, SourcePrior, SourceTermFilter, TermPrior
from gslcosim_search.beliefs import CellGrid
from gslcosim_search.fixed_sensors.events import Excess, LeakEvent, detect_events, find_excess
from gslcosim_search.fixed_sensors.laser_sources import PathRecord, find_sources
from gslcosim_search.fixed_sensors.leak_location import locate_sources
from gslcosim_search.fixed_sensors.plume_response import WindStatistics
from gslcosim_search.fixed_sensors.puff_response import WindRecord
from gslcosim_search.fixed_sensors.source_search import SURE_SHARE
from gslcosim_search.maps.kernel_dm import KernelMap, KernelWidths
from gslcosim_validation.measured_suite.logs import LogRow, LogSite, MeasuredLog

Floats = NDArray[np.float64]

AVERAGE_S = 1800.0
"""Particles weigh means over this, as plume models are judged: minutes say much the same as their neighbours [s]."""

_DAY_S = 86_400.0
_AREA_MARGIN_M = 20.0
_PARTICLES = 700
_THRESHOLD_PPM = 0.2
_RATE_PPM_M3_S = (1.0, 1e6)
FLOOR = "nearest_sensor"
"""The entry that bounds the others from above, as the random walker does in flown suites."""


@dataclass(frozen=True, kw_only=True)
class Claim:
    """Estimate of one event by an estimator.

    Attributes:
        start_s: When it began [s since 1970].
        end_s: When it ended.
        place: Name of the candidate place; None where there are none, or it does not know.
        position_m: x, y [m]; None where it does not know.
        rate_kg_s: nan where it does not know.
        source: Where rows say which source is open, which this is about; else -1. Sources that were open together have
            the same number, and a claim each.
        is_upper_bound: The rate may have been less: the model gives next to no gas where readings were high, or they
            are no more than noise.
        margin: How much better the place is than the next, by the estimator's own measure; nan where it does not say.
        confidence: Of the place, 0 to 1; nan where it does not say.
        runner_up: The next place: a candidate's name, or x, y [m]; None where it does not say.
    """

    start_s: float
    end_s: float
    place: str | None = None
    position_m: tuple[float, float] | None = None
    rate_kg_s: float = math.nan
    source: int = -1
    is_upper_bound: bool = False
    margin: float = math.nan
    confidence: float = math.nan
    runner_up: str | tuple[float, float] | None = None

    @property
    def is_unsure(self) -> bool:
        """True if the estimator says that another place may as well be it."""
        return self.confidence < SURE_SHARE


class LogEstimator(Protocol):
    """Entry of the suite: receives a log row by row and returns events at its end."""

    def observe(self, row: LogRow) -> None:
        """Take a row, in the order of time."""
        ...

    def conclude(self) -> Sequence[Claim]:
        """Return the events, in any order."""
        ...


class HindsightEstimator:
    """Base of estimators that look at the whole log at its end; a method fills in `claims`."""

    def __init__(self, site: LogSite) -> None:
        """Begin with an empty log."""
        self.site = site
        self._rows: list[LogRow] = []

    def observe(self, row: LogRow) -> None:
        """Keep a row."""
        self._rows.append(row)

    def conclude(self) -> Sequence[Claim]:
        """Return what `claims` finds in the whole log; nothing in an empty one."""
        if not self._rows:
            return ()
        rows = self._rows
        return self.claims(
            MeasuredLog(
                np.array([row.start_s for row in rows]),
                np.stack([row.readings_ppm for row in rows]),
                np.stack([row.wind_world_m_s for row in rows]),
                np.stack([row.wind_std_m_s for row in rows]),
                np.array([row.gas_m3_per_kg for row in rows]),
                np.array([row.source for row in rows]),
            )
        )

    def claims(self, log: MeasuredLog) -> Sequence[Claim]:
        """Return the events of a whole log."""
        raise NotImplementedError


class EventEstimator(HindsightEstimator):
    """Base of estimators that detect events as `gslcosim_search.fixed_sensors.events` does and then place each."""

    def claims(self, log: MeasuredLog) -> Sequence[Claim]:
        """Return a claim for each event."""
        excess = find_excess(log.start_s, log.readings_ppm)
        wind = WindRecord.of_means(
            log.start_s, log.wind_world_m_s, self.site.wind_height_m, period_s=self.site.period_s
        )
        return [
            claim
            for event in detect_events(log.start_s, excess)
            for claim in self.claim_sources(
                event, excess, wind, float(np.median(log.gas_m3_per_kg[event.first : event.last + 1]))
            )
        ]

    def claim_sources(self, event: LeakEvent, excess: Excess, wind: WindRecord, gas_m3_per_kg: float) -> list[Claim]:
        """Return the claims of one event, one for each source; by default `claim` alone."""
        return [self.claim(event, excess, wind, gas_m3_per_kg)]

    def claim(self, event: LeakEvent, excess: Excess, wind: WindRecord, gas_m3_per_kg: float) -> Claim:
        """Return the claim of one event."""
        raise NotImplementedError

    def claim_at(self, event: LeakEvent, position_m: Sequence[float], rate_kg_s: float = math.nan) -> Claim:
        """Return the claim of a position: where there are candidate places, the nearest of them."""
        place, place_m = self.site.snap(position_m[0], position_m[1])
        return Claim(start_s=event.start_s, end_s=event.end_s, place=place, position_m=place_m, rate_kg_s=rate_kg_s)

    @property
    def source_height_m(self) -> float:
        """Height of the source as far as the site says, else that of the sensors."""
        height_m = self.site.source_height_m
        return height_m if math.isfinite(height_m) else float(np.median(self.site.sensors_m[:, 2]))


class LeakNetwork(EventEstimator):
    """Readings of each event beside puffs from each place; laser paths by a plume that is fitted at each place."""

    def claims(self, log: MeasuredLog) -> Sequence[Claim]:
        """Return a claim for each event, or for each source where rows say which is open."""
        return super().claims(log) if self.site.finds_events else _find_sources(self.site, log)

    def claim_sources(self, event: LeakEvent, excess: Excess, wind: WindRecord, gas_m3_per_kg: float) -> list[Claim]:
        """Return the places whose puffs go best with the readings, and the rates that carry their mean."""
        site = self.site
        sources = locate_sources(
            event, excess, wind, site.sensors_m, site.places_m, source_height_m=self.source_height_m
        )
        return [
            Claim(
                start_s=event.start_s,
                end_s=event.end_s,
                place=found.place,
                position_m=found.position_m,
                rate_kg_s=found.rate_m3_s / gas_m3_per_kg,
                is_upper_bound=found.is_upper_bound,
                margin=found.certainty.margin,
                confidence=found.certainty.confidence,
                runner_up=found.certainty.runner_up,
            )
            for found in sources
        ]


class NearestSensor(EventEstimator):
    """The place nearest to the sensor with the largest mean reading, found without wind."""

    def claim(self, event: LeakEvent, excess: Excess, wind: WindRecord, gas_m3_per_kg: float) -> Claim:
        """Return that place."""
        return self.claim_at(event, self.site.sensors_m[int(np.argmax(_mean_above(event, excess)))])


class KernelDmvw(EventEstimator):
    """Kernel DM+V/W of the event's readings, kernels as wide as sensors are apart; where gas varies most."""

    def claim(self, event: LeakEvent, excess: Excess, wind: WindRecord, gas_m3_per_kg: float) -> Claim:
        """Return the place of the largest variance."""
        sensors_m = self.site.sensors_m
        grid = _grid_about(sensors_m)
        # Median of the distances from each sensor to its nearest neighbour.
        between_m = np.hypot(*(sensors_m[:, None, :2] - sensors_m[None, :, :2]).transpose(2, 0, 1))
        np.fill_diagonal(between_m, np.inf)
        nearest_m = between_m.min(axis=1)
        apart_m = max(float(np.median(nearest_m)), 1.0) if np.isfinite(nearest_m).all() else 10.0
        gas = KernelMap(grid, KernelWidths(sigma_m=0.5 * apart_m, stretch_s=0.1 * apart_m))
        for i in range(event.first, event.last + 1):
            for k, above_ppm in enumerate(excess.above_ppm[i]):
                gas.add(sensors_m[k, :2].tolist(), float(above_ppm), wind_m_s=wind.mean_world_m_s[i].tolist())
        variance = gas.maps().variance
        cell = np.unravel_index(int(variance.argmax()), variance.shape)
        return self.claim_at(event, [grid.origin_m[a] + (int(cell[a]) + 0.5) * grid.cell_m for a in range(2)])


class SourceTerms(EventEstimator):
    """Particles of source terms, as the method `source_term_estimation` has them, weighed by half-hour means."""

    def claim(self, event: LeakEvent, excess: Excess, wind: WindRecord, gas_m3_per_kg: float) -> Claim:
        """Return the candidate place with most particles near it, or their mean; and their mean rate."""
        low_m, high_m = area_about(self.site.sensors_m)
        height_m = self.source_height_m
        prior = SourcePrior(
            {
                "x_m": TermPrior(kind="uniform", a=low_m[0], b=high_m[0]),
                "y_m": TermPrior(kind="uniform", a=low_m[1], b=high_m[1]),
                "z_m": TermPrior(kind="uniform", a=0.0, b=2.0 * height_m),
                "rate": TermPrior(kind="log_uniform", a=_RATE_PPM_M3_S[0], b=_RATE_PPM_M3_S[1]),
                "speed": TermPrior(kind="log_uniform", a=0.5, b=2.0),
                "direction_rad": TermPrior(kind="normal", a=0.0, b=0.35),
                "diffusivity_m2_s": TermPrior(kind="log_uniform", a=0.1, b=10.0),
                "lifetime_s": TermPrior(kind="log_uniform", a=100.0, b=1000.0),
            }
        )
        model = PlumeSensor(
            plume="gaussian", sensor="log_normal", threshold_ppm=_THRESHOLD_PPM, noise_frac=1.0, source_radius_m=0.5
        )
        rng = stream(1, f"measured_suite.source_terms.{event.first}")
        terms = SourceTermFilter(prior, model, _PARTICLES, rng)
        for rows in split_into_blocks(event, wind):
            above_ppm = excess.above_ppm[rows]
            mean_m_s = wind.mean_world_m_s[rows].mean(axis=0)
            for k, sensor_m in enumerate(self.site.sensors_m):
                known = above_ppm[np.isfinite(above_ppm[:, k]), k]
                if len(known):
                    terms.read(
                        sensor_m.tolist(),
                        max(float(known.mean()), 0.0),
                        speed_m_s=max(float(np.hypot(*mean_m_s)), 0.1),
                        direction_rad=float(np.arctan2(mean_m_s[1], mean_m_s[0])),
                    )
        weights, mean = terms.weights(), terms.mean()
        rate_kg_s = mean["rate"] * 1e-6 / gas_m3_per_kg
        if not self.site.places_m:
            return self.claim_at(event, (mean["x_m"], mean["y_m"]), rate_kg_s)
        return self.claim_at(event, self.site.find_likeliest_m(terms.terms[:, :2], weights), rate_kg_s)


@dataclass(frozen=True, kw_only=True)
class Entry:
    """A method of the suite.

    Attributes:
        name: Of rows and of `--only entry=`.
        title: In words.
        family: As in method cards.
        build: From the site to a new estimator.
        can_take: Whether it can say something of a site.
        sandbox: What confines its process, in the words of `result.json`.
        parameters: Its settings.
    """

    name: str
    title: str
    family: str
    build: Callable[[LogSite], LogEstimator]
    can_take: Callable[[LogSite], bool]
    sandbox: str = NONE_IN_THIS_PROCESS
    parameters: Mapping[str, Any] = field(default_factory=dict[str, Any])


def is_network(site: LogSite) -> bool:
    """Return whether a log has masts between whose readings events are to be found."""
    return site.has_points and site.finds_events


def is_room(site: LogSite) -> bool:
    """Return whether a log has point sensors and a source that is open all the time."""
    return site.has_points and not site.finds_events


ENTRIES = (
    Entry(
        name="leak_network",
        title="Leak network: events, puffs from each place",
        family="network",
        build=LeakNetwork,
        can_take=lambda site: not is_room(site),
    ),
    Entry(
        name="source_term_estimation",
        title="Source-term estimation on standing sensors",
        family="bayesian",
        build=SourceTerms,
        can_take=is_network,
    ),
    Entry(
        name="kernel_dmvw",
        title="Kernel DM+V/W on standing sensors",
        family="mapping",
        build=KernelDmvw,
        can_take=is_network,
    ),
    Entry(
        name=FLOOR,
        title="Nearest sensor: the largest mean reading",
        family="reactive",
        build=NearestSensor,
        can_take=is_network,
    ),
)


def _mean_above(event: LeakEvent, excess: Excess) -> Floats:
    above = excess.above_ppm[event.first : event.last + 1]
    count = np.isfinite(above).sum(axis=0)
    return np.where(count > 0, np.nansum(above, axis=0) / np.maximum(count, 1), -np.inf)


def area_about(sensors_m: Floats) -> tuple[list[float], list[float]]:
    """Return the lower and upper corner of the area in which a source is looked for [m]."""
    low, high = sensors_m.min(axis=0) - _AREA_MARGIN_M, sensors_m.max(axis=0) + _AREA_MARGIN_M
    return low.tolist(), high.tolist()


def _grid_about(sensors_m: Floats) -> CellGrid:
    low_m, high_m = area_about(sensors_m)
    cell_m = max(high_m[0] - low_m[0], high_m[1] - low_m[1]) / 60.0
    shape = tuple(math.ceil((high_m[a] - low_m[a]) / cell_m) for a in range(2))
    return CellGrid((low_m[0], low_m[1]), cell_m, shape)


def split_into_blocks(event: LeakEvent, wind: WindRecord) -> list[NDArray[np.int64]]:
    """Return the rows of an event in blocks of `AVERAGE_S` that begin at whole multiples of it."""
    rows = np.arange(event.first, event.last + 1)
    return np.split(rows, np.flatnonzero(np.diff(wind.start_s[rows] // AVERAGE_S) > 0) + 1)


# Sources that rows or their readings tell apart, with rates by backgrounds that the sources of a day share.
def _find_sources(site: LogSite, log: MeasuredLog) -> list[Claim]:
    needed = (log.wind_world_m_s, log.wind_std_m_s, log.gas_m3_per_kg[:, None])
    usable = np.logical_and.reduce([np.isfinite(values).all(axis=1) for values in needed])
    usable &= np.isfinite(log.readings_ppm).any(axis=1)
    if not usable.any():
        return []
    start_s = log.start_s[usable]
    sources, source = np.unique(log.source[usable], return_inverse=True)
    record = PathRecord(
        sensors=site.sensors,
        source=source.astype(np.int64),
        start_s=start_s,
        wind=WindStatistics.of_components(
            np.column_stack([log.wind_world_m_s[usable], np.zeros(len(start_s))]), log.wind_std_m_s[usable]
        ),
        gas_m3_per_kg=log.gas_m3_per_kg[usable],
        readings_ppm=log.readings_ppm[usable],
        day=np.unique(start_s // _DAY_S, return_inverse=True)[1].astype(np.int64),
    )
    height_m = {"source_height_m": site.source_height_m} if math.isfinite(site.source_height_m) else {}
    return [
        Claim(
            start_s=float(start_s[source == found.source].min()),
            end_s=float(start_s[source == found.source].max()) + site.period_s,
            position_m=found.position_m,
            rate_kg_s=found.rate_kg_s,
            source=int(sources[found.source]),
            is_upper_bound=found.is_upper_bound,
            margin=found.certainty.margin,
            confidence=found.certainty.confidence,
            runner_up=found.certainty.runner_up,
        )
        for found in find_sources(record, **height_m)
    ]
