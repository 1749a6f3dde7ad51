"""Events in the log of a sensor network: readings well above a background that drifts and differs by sensor."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

_NORMAL_BY_MEDIAN = 1.4826
# A background changes little within this, and is computed so often.
_STEP_S = 300.0


@dataclass(frozen=True, kw_only=True)
class DetectionSettings:
    """Constants of the detection.

    Chosen on the weeks of METEC and Stanford that are in the reference data, one set for both; what they find elsewhere
    is a test of them.

    Attributes:
        background_half_s: The background of a time is a percentile of this time before and after it.
        background_percentile: Which; low, so that leaks of hours do not become background.
        noise_factor: A reading counts above so many deviations of its sensor's quiet readings.
        least_ppm: And above this, which a change of the weather does not reach.
        gap_s: Quiet times up to this are part of an event: gas comes and goes as the wind turns.
        least_readings: Readings that count, without which it is no event.
    """

    background_half_s: float = 4 * 3600.0
    background_percentile: float = 10.0
    noise_factor: float = 4.0
    least_ppm: float = 0.5
    gap_s: float = 3600.0
    least_readings: int = 3


@dataclass(frozen=True)
class Excess:
    """Readings above their background.

    `above_ppm` (n, k), nan where nothing was read, quiet readings around zero; `noise_ppm` (k,) deviation of quiet
    readings; `counts` (n,) whether some sensor is well above at that time.
    """

    above_ppm: Floats
    noise_ppm: Floats
    counts: NDArray[np.bool_]


@dataclass(frozen=True)
class LeakEvent:
    """One event: first and last row of a log whose readings count, and their times [s]."""

    first: int
    last: int
    start_s: float
    end_s: float


def running_percentile(clock_s: Floats, readings_ppm: Floats, *, half_s: float, percentile: float) -> Floats:
    """Return (n, k) percentiles of each sensor's readings within some time before and after each row.

    Args:
        clock_s: (n,) rising times [s].
        readings_ppm: (n, k), nan where nothing was read.
        half_s: Time before and after.
        percentile: Which, 0 to 100.

    Returns:
        (n, k); nan where a sensor read nothing in that time.
    """
    knots_s = np.arange(clock_s[0], clock_s[-1] + _STEP_S, _STEP_S)
    values = np.full((len(knots_s), readings_ppm.shape[1]), np.nan)
    first = np.searchsorted(clock_s, knots_s - half_s)
    last = np.searchsorted(clock_s, knots_s + half_s, side="right")
    for i in range(len(knots_s)):
        part = readings_ppm[first[i] : last[i]]
        has_any = np.isfinite(part).any(axis=0)
        if has_any.any():
            values[i, has_any] = np.nanpercentile(part[:, has_any], percentile, axis=0)
    return values[np.clip(np.rint((clock_s - clock_s[0]) / _STEP_S).astype(np.int64), 0, len(knots_s) - 1)]


def find_excess(clock_s: Floats, readings_ppm: Floats, settings: DetectionSettings | None = None) -> Excess:
    """Return readings above their background, and at which times they count.

    The percentile is below what a quiet sensor reads on average, so the median of all that remains is taken away, and
    the noise is the median deviation about it: leaks are rarer than quiet hours.

    Args:
        clock_s: (n,) rising times [s].
        readings_ppm: (n, k), nan where nothing was read.
        settings: Constants; by default those of `DetectionSettings`.
    """
    chosen = settings or DetectionSettings()
    above = readings_ppm - running_percentile(
        clock_s, readings_ppm, half_s=chosen.background_half_s, percentile=chosen.background_percentile
    )
    has_any = np.isfinite(above).any(axis=0)
    middle, noise = np.zeros(above.shape[1]), np.full(above.shape[1], np.inf)
    middle[has_any] = np.nanmedian(above[:, has_any], axis=0)
    noise[has_any] = _NORMAL_BY_MEDIAN * np.nanmedian(np.abs(above[:, has_any] - middle[has_any]), axis=0)
    bound = np.maximum(chosen.least_ppm, chosen.noise_factor * noise)
    with np.errstate(invalid="ignore"):
        counts = np.asarray((above > bound).any(axis=1))
    return Excess(above - middle, noise, counts)


def detect_events(clock_s: Floats, excess: Excess, settings: DetectionSettings | None = None) -> tuple[LeakEvent, ...]:
    """Return the events of a log, in the order of time.

    Args:
        clock_s: (n,) rising times [s].
        excess: Of `find_excess`.
        settings: Constants; by default those of `DetectionSettings`.
    """
    chosen = settings or DetectionSettings()
    rows = np.flatnonzero(excess.counts)
    parts = np.split(rows, np.flatnonzero(np.diff(clock_s[rows]) > chosen.gap_s) + 1) if len(rows) else []
    return tuple(
        LeakEvent(int(part[0]), int(part[-1]), float(clock_s[part[0]]), float(clock_s[part[-1]]))
        for part in parts
        if len(part) >= chosen.least_readings
    )
