"""Leak monitor: a sensor network that is read row by row, and reports each leak once it is over."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gslcosim_search.fixed_sensors.events import DetectionSettings, LeakEvent, detect_events, find_excess
from gslcosim_search.fixed_sensors.leak_location import locate_sources
from gslcosim_search.fixed_sensors.puff_response import WindRecord
from gslcosim_search.fixed_sensors.source_search import PlaceCertainty

Floats = NDArray[np.float64]

# What is older than this takes no part: background and event before it are known.
_MEMORY_S = 86_400.0


@dataclass(frozen=True)
class LeakReport:
    """A leak that is over: when, at which place x, y [m], and the release of pure gas [m3/s], nan where unknown.

    `is_upper_bound` of the release: it may have been less; `certainty` of the place.
    """

    start_s: float
    end_s: float
    position_m: tuple[float, float]
    rate_m3_s: float
    is_upper_bound: bool
    certainty: PlaceCertainty


class LeakMonitor:
    """Reads a network as time goes on: events against the background of what was read so far, then places and rates.

    An event is over when nothing has counted for `DetectionSettings.gap_s`. The background after it is not known yet,
    so events may begin or end some minutes elsewhere than with the whole log at hand.

    State: rows of the last day, and until when events were reported.

    Held by:
        extensions/search/tests/unit/fixed_sensors/test_leak_monitor.py
    """

    def __init__(
        self,
        sensors_m: Floats,
        *,
        source_height_m: float,
        period_s: float,
        places_m: Mapping[str, Floats] | None = None,
        check_every_s: float = 1800.0,
        settings: DetectionSettings | None = None,
    ) -> None:
        """Begin without rows.

        Args:
            sensors_m: (k, 3) places of the sensors [m].
            places_m: Candidate places by name, (3,) each [m]; without them the source may be anywhere.
            check_every_s: How often events are looked for [s].
            settings: Constants of the detection; by default those of `DetectionSettings`.
        """
        self._sensors_m, self._places_m = sensors_m, places_m or {}
        self._height_m, self._period_s, self._every_s = source_height_m, period_s, check_every_s
        self._settings = settings or DetectionSettings()
        self._rows: list[tuple[float, Floats, Floats]] = []
        self._reported_until_s = -np.inf
        self._checked_s = -np.inf

    def add(self, time_s: float, readings_ppm: Sequence[float], wind_m_s: Sequence[float]) -> list[LeakReport]:
        """Take a row; return the leaks that are over and were not reported, mostly none.

        Args:
            time_s: Begin of its period, later than that of the row before [s].
            readings_ppm: (k,), nan where a sensor read nothing.
            wind_m_s: Toward x and y, nan where not measured.
        """
        self._rows.append((time_s, np.array(readings_ppm, dtype=np.float64), np.array(wind_m_s, dtype=np.float64)))
        if time_s - self._checked_s < self._every_s:
            return []
        self._checked_s = time_s
        while self._rows[0][0] < time_s - _MEMORY_S:
            del self._rows[0]
        return self._find_reports(time_s)

    def _find_reports(self, now_s: float) -> list[LeakReport]:
        clock_s = np.array([row[0] for row in self._rows])
        excess = find_excess(clock_s, np.stack([row[1] for row in self._rows]), self._settings)
        events = [event for event in detect_events(clock_s, excess, self._settings) if self._is_news(event, now_s)]
        if not events:
            return []
        wind = WindRecord.of_means(
            clock_s,
            np.stack([row[2] for row in self._rows]),
            float(np.median(self._sensors_m[:, 2])),
            period_s=self._period_s,
        )
        reports: list[LeakReport] = []
        for event in events:
            self._reported_until_s = event.end_s
            span = event.start_s, event.end_s
            reports += [
                LeakReport(*span, found.position_m, found.rate_m3_s, found.is_upper_bound, found.certainty)
                for found in locate_sources(
                    event, excess, wind, self._sensors_m, self._places_m, source_height_m=self._height_m
                )
            ]
        return reports

    def _is_news(self, event: LeakEvent, now_s: float) -> bool:
        return event.start_s > self._reported_until_s and event.end_s < now_s - self._settings.gap_s
