"""Estimators of rooms: the place of one of the sensors, by when it rises, how lively it is, or how much it reads."""

import warnings
from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray

from gslcosim_validation.cases.room_sensors import compute_sensor_figures
from gslcosim_validation.measured_suite.estimators import FLOOR, Claim, Entry, HindsightEstimator, is_room
from gslcosim_validation.measured_suite.logs import LogSite, MeasuredLog

Floats = NDArray[np.float64]

QUIET_S = 240.0
"""Experiments begin with clean air for at least this long, which is the baseline of each sensor [s]."""


class SensorChoice(HindsightEstimator):
    """Estimator that names the place of one sensor for each experiment.

    Args:
        site: The room.
        rate: From times (n,) [s] and readings (n, k) [ppm] of an experiment to (k,) how much speaks for each sensor,
            nan where nothing can be said.
    """

    def __init__(self, site: LogSite, rate: Callable[[Floats, Floats], Floats]) -> None:
        super().__init__(site)
        self._rate = rate

    def claims(self, log: MeasuredLog) -> Sequence[Claim]:
        """Return a claim for each experiment; without a place where no sensor has what is looked for."""
        claims: list[Claim] = []
        for source in np.unique(log.source):
            rows = log.source == source
            time_s = log.start_s[rows] - log.start_s[rows][0]
            merit = np.full(len(self.site.names), np.nan)
            if time_s[-1] > QUIET_S:
                # Of a sensor that never read anything nothing can be said, and numpy need not warn.
                with warnings.catch_warnings():
                    warnings.simplefilter("ignore", RuntimeWarning)
                    merit = self._rate(time_s, log.readings_ppm[rows])
            position_m = None
            if np.isfinite(merit).any():
                x_m, y_m, _ = self.site.sensors_m[int(np.nanargmax(merit))]
                position_m = (float(x_m), float(y_m))
            start_s, end_s = float(log.start_s[rows][0]), float(log.start_s[rows][-1]) + self.site.period_s
            claims.append(Claim(start_s=start_s, end_s=end_s, position_m=position_m, source=int(source)))
        return claims


def rate_mean(time_s: Floats, readings_ppm: Floats) -> Floats:
    """Return the means above the baselines."""
    base = np.nanmean(readings_ppm[time_s < QUIET_S], axis=0)
    return np.asarray(np.nanmean(readings_ppm, axis=0) - base)


def rate_onset(time_s: Floats, readings_ppm: Floats) -> Floats:
    """Return the times of first gas, each by the sensor's own high readings, the earliest largest."""
    return -compute_sensor_figures(time_s, readings_ppm, quiet_until_s=QUIET_S).onset_s


def rate_intensity(time_s: Floats, readings_ppm: Floats) -> Floats:
    """Return how much readings vary about their trend, for their level: near a source gas comes in whiffs."""
    return compute_sensor_figures(time_s, readings_ppm, quiet_until_s=QUIET_S).intensity


ROOM_ENTRIES = tuple(
    Entry(name=name, title=title, family="reactive", build=partial(SensorChoice, rate=rate), can_take=is_room)
    for name, title, rate in (
        ("liveliest_sensor", "Liveliest sensor: the largest deviation for its level", rate_intensity),
        ("first_sensor", "First sensor: the earliest rise", rate_onset),
        (FLOOR, "Nearest sensor: the largest mean reading", rate_mean),
    )
)
