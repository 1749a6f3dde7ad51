"""Place and rate of one source from sensors that stand: a robust fit at each place, and a search that refines."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gslcosim_search import elementary
from gslcosim_search.fixed_sensors.background import background_beside_plumes

Floats = NDArray[np.float64]

# Degrees of freedom of Student's t: plumes that pass beside a sensor are outliers of a plume model, not noise.
_FREEDOM = 4.0
_ITERATIONS = 12
# Readings at which the plume exceeds so many errors of a reading tell how far the model is off.
_CLEAR_ERRORS = 20.0
_MODEL_ERROR = (0.1, 1.5)
_NORMAL_BY_MEDIAN = 1.4826
# Neighbours of the best place that each step of the search looks at.
_RING = 3


@dataclass(frozen=True)
class BackgroundPrior:
    """Prior of backgrounds: mean and standard deviation over sensors and groups [ppm]."""

    mean_ppm: float
    std_ppm: float

    @classmethod
    def of_readings(cls, readings_ppm: Floats, *, reading_error_ppm: float) -> "BackgroundPrior":
        """Return the prior of (n, k) readings, nan where there is none: median and spread of 5th percentiles."""
        low = np.nanpercentile(readings_ppm[:, np.isfinite(readings_ppm).any(axis=0)], 5.0, axis=0)
        spread = _NORMAL_BY_MEDIAN * float(np.median(np.abs(low - np.median(low))))
        return cls(float(np.median(low)), max(spread, reading_error_ppm))


@dataclass(frozen=True)
class TermsFit:
    """Best rate and backgrounds at one place.

    `log_likelihood` but for a constant; `rate_m3_s`; `background_ppm` (groups, k).
    """

    log_likelihood: float
    rate_m3_s: float
    background_ppm: Floats


def fit_terms(
    response: Floats,
    readings_ppm: Floats,
    group: NDArray[np.int64],
    prior: BackgroundPrior,
    *,
    reading_error_ppm: float,
    weight: Floats | None = None,
) -> TermsFit:
    """Return the rate and the backgrounds under which readings are likeliest, for the responses of one place.

    reading = b + Q r + e,  e Student's t with 4 degrees of freedom and scale sqrt(s^2 + (f Q r)^2)
    [ppm] = [ppm] + [m3/s] [ppm s/m3] + [ppm];  b ~ N(mean, std^2) for each sensor and group

    The relative error f of the plume model is what the residuals say where the plume is clear. Solved by weights that
    follow the residuals.

    Args:
        response: (n, k) r, what a sensor reads per release; nan where it is not known.
        readings_ppm: (n, k); nan where nothing was read.
        group: (n,) 0 … g - 1: rows that share backgrounds.
        prior: Of b.
        reading_error_ppm: s. Of the average of a period it is larger than that of one reading.
        weight: (n,) how often each row counts (bootstrap); None: once.

    Source:
        Lange, Little and Taylor 1989, Robust statistical modeling using the t distribution; the rest is ours.
    Held by:
        extensions/search/tests/unit/fixed_sensors/test_source_search.py
    """
    n, k = response.shape
    cell = (group[:, None] * k + np.arange(k)[None, :]).ravel()
    n_cells = (int(group.max()) + 1) * k
    r, o = response.ravel(), readings_ppm.ravel()
    is_known = np.isfinite(r) & np.isfinite(o)
    r, o = np.where(is_known, r, 0.0), np.where(is_known, o, prior.mean_ppm)
    counted = is_known * (1.0 if weight is None else np.repeat(weight, k))
    pull = 1.0 / (prior.std_ppm * prior.std_ppm)
    w, model_error = counted.copy(), 0.5
    rate, background, residual, variance = 0.0, np.full(n_cells, prior.mean_ppm), o, np.ones(n * k)
    for _ in range(_ITERATIONS):
        sum_w, sum_r, sum_o = (np.bincount(cell, w * x, n_cells) for x in (np.ones(n * k), r, o))
        with_prior = sum_w + pull
        rr = float((w * r * r).sum() - (np.square(sum_r) / with_prior).sum())
        ro = float((w * r * o).sum() - (sum_r * (sum_o + pull * prior.mean_ppm) / with_prior).sum())
        rate = max(ro / rr, 0.0) if rr > 0.0 else 0.0
        background = (sum_o - rate * sum_r + pull * prior.mean_ppm) / with_prior
        plume = rate * r
        residual = o - background[cell] - plume
        is_clear = (plume > _CLEAR_ERRORS * reading_error_ppm) & (counted > 0.0)
        if is_clear.sum() > _CLEAR_ERRORS:
            relative = np.abs(residual[is_clear]) / plume[is_clear]
            model_error = float(np.clip(_NORMAL_BY_MEDIAN * np.median(relative), *_MODEL_ERROR))
        variance = reading_error_ppm * reading_error_ppm + np.square(model_error * plume)
        w = counted * (_FREEDOM + 1.0) / (_FREEDOM + np.square(residual) / variance) / variance
    tails = elementary.log1p_each(np.square(residual) / (_FREEDOM * variance))
    each = -0.5 * (_FREEDOM + 1.0) * tails - 0.5 * elementary.log_each(variance)
    log_prior = -0.5 * pull * np.square(background - prior.mean_ppm).sum()
    return TermsFit(float((counted * each).sum() + log_prior), rate, background.reshape(-1, k))


def search_place(
    objective: Callable[[tuple[float, float]], float],
    low_m: tuple[float, float],
    high_m: tuple[float, float],
    *,
    coarse_m: float = 4.0,
    fine_m: float = 0.25,
) -> tuple[float, float]:
    """Return the place where an objective is largest: a coarse grid, then ever finer ones around the best so far.

    Args:
        objective: Of x, y [m]; asked once for each place.
        coarse_m: Spacing of the first grid.
    """
    values: dict[tuple[float, float], float] = {}
    step_m = coarse_m
    places = [
        (float(x), float(y))
        for x in np.arange(low_m[0], high_m[0] + 0.5 * step_m, step_m)
        for y in np.arange(low_m[1], high_m[1] + 0.5 * step_m, step_m)
    ]
    while True:
        for place in places:
            if place not in values:
                values[place] = objective(place)
        best = max(values, key=lambda place: values[place])
        if step_m <= fine_m:
            return best
        step_m /= 2.0
        around = np.arange(-_RING, _RING + 1) * step_m
        places = [(best[0] + float(dx), best[1] + float(dy)) for dx in around for dy in around]


def rates_that_carry_the_mean(
    response: Floats,
    readings_ppm: Floats,
    source: NDArray[np.int64],
    group: NDArray,
    first_rate_m3_s: Floats,
    *,
    negligible_ppm: float,
    n_rounds: int = 5,
) -> Floats:
    """Return the rates of sources under which predictions have the mean of what is read above background.

    Q = sum (reading - background) / sum r, over readings that the plume reaches

    A wind that is a little wrong moves gas from one reading to another but loses none of it, so the ratio of means is
    right where a regression is not: errors of r pull its slope toward zero. Backgrounds are medians of readings that
    no plume reaches, by group, and follow the rates in a few rounds.

    Args:
        response: (n, k), for each row that of its own source.
        readings_ppm: (n, k).
        source: (n,) which source was open, 0 … s - 1.
        group: (n,) labels of rows that share backgrounds.
        first_rate_m3_s: (s,) to begin with.
        negligible_ppm: Plumes below this count as none.
        n_rounds: Of backgrounds and rates.

    Returns:
        (s,) [m3/s]; nan for a source whose plume reaches no sensor.

    Source:
        Ratio estimation, Cochran 1977, Sampling techniques, chapter 6; its use against errors of the wind is ours.
    Held by:
        extensions/search/tests/unit/fixed_sensors/test_source_search.py (a regression falls short there)
    """
    rate = np.array(first_rate_m3_s, dtype=np.float64)
    for _ in range(n_rounds):
        predicted = rate[source][:, None] * response
        background = background_beside_plumes(readings_ppm, predicted, group, negligible_ppm=negligible_ppm)
        above = readings_ppm - background
        for i in range(len(rate)):
            is_reached = (predicted >= negligible_ppm) & (source == i)[:, None] & np.isfinite(above)
            total = float(response[is_reached].sum())
            rate[i] = float(above[is_reached].sum()) / total if total > 0.0 else np.nan
    return rate
