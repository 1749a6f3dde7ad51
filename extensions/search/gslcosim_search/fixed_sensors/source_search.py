"""Places and rates of sources from sensors that stand: a robust fit at given places, and a search that refines."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gslcosim.base.rng import stream
from gslcosim_search import elementary
from gslcosim_search.fixed_sensors.background import background_beside_plumes

Floats = NDArray[np.float64]

LEAST_LOG_MARGIN = 2.0
"""Logarithms of likelihoods that differ by less are nearly equal: odds of seven to one."""
CLEAR_DEVIATIONS = 2.0
"""A sum of readings above so many of its own deviations is gas and not noise."""

# Degrees of freedom of Student's t: plumes that pass beside a sensor are outliers of a plume model, not noise.
_FREEDOM = 4.0
_ITERATIONS = 12
# Readings at which the plume exceeds so many errors of a reading tell how far the model is off.
_CLEAR_ERRORS = 20.0
_MODEL_ERROR = (0.1, 1.5)
_NORMAL_BY_MEDIAN = 1.4826
# Rounds over the rates of several sources, each the best for the others'; two plumes that hardly overlap need few.
_RATE_ROUNDS = 30
# A further source must raise the logarithm of the likelihood by this for each reading. Errors of the model raise it by
# 0.026 and 0.033 on Chilbolton and by 0.007 at most in events of METEC, where sources were alone; a made-up second
# source of the same rate by 0.09 to 0.29 and by 0.41.
_GAIN_PER_READING = 0.05
# And in quarters of an hour as a whole, not in one of them: mean gain over its standard error.
_LEAST_T = 2.0
# Draws of blocks of rows.
_DRAWS = 200
_LEAST_BLOCKS = 8
SURE_SHARE = 0.9
"""A place is sure when it is the best one in such a share of draws of blocks of rows."""
BLOCK_S = 900.0
"""Rows of a quarter of an hour share their weather."""
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
    """Best rates and backgrounds with sources at given places.

    `log_likelihood` but for a constant; `rates_m3_s` (s,) of the sources; `background_ppm` (groups, k);
    `row_log_likelihood` (n,) what each row adds to it.
    """

    log_likelihood: float
    rates_m3_s: Floats
    background_ppm: Floats
    row_log_likelihood: Floats

    @property
    def rate_m3_s(self) -> float:
        """Release of all sources together [m3/s]."""
        return float(self.rates_m3_s.sum())


def fit_terms(
    response: Floats,
    readings_ppm: Floats,
    group: NDArray[np.int64],
    prior: BackgroundPrior,
    *,
    reading_error_ppm: float,
    weight: Floats | None = None,
) -> TermsFit:
    """Return the rates and the backgrounds under which readings are likeliest, for sources at given places.

    reading = b + sum Q r + e,  e Student's t with 4 degrees of freedom and scale sqrt(s^2 + (f sum Q r)^2)
    [ppm] = [ppm] + [m3/s] [ppm s/m3] + [ppm];  b ~ N(mean, std^2) for each sensor and group, Q >= 0

    The relative error f of the plume model is what the residuals say where the plume is clear. Solved by weights that
    follow the residuals; sources that were open together are fitted jointly, each with a rate of its own.

    Args:
        response: (n, k) r of one source, or (s, n, k) of several: what a sensor reads per release; nan where it is not
            known.
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
    n, k = readings_ppm.shape
    cell = (group[:, None] * k + np.arange(k)[None, :]).ravel()
    n_cells = (int(group.max()) + 1) * k
    r, o = response.reshape(-1, n * k), readings_ppm.ravel()
    is_known = np.isfinite(r).all(axis=0) & np.isfinite(o)
    r, o = np.where(is_known, r, 0.0), np.where(is_known, o, prior.mean_ppm)
    counted = is_known * (1.0 if weight is None else np.repeat(weight, k))
    pull = 1.0 / (prior.std_ppm * prior.std_ppm)
    w, model_error = counted.copy(), 0.5
    rates, background, residual, variance = np.zeros(len(r)), np.full(n_cells, prior.mean_ppm), o, np.ones(n * k)
    for _ in range(_ITERATIONS):
        sum_w, sum_o = (np.bincount(cell, w * x, n_cells) for x in (np.ones(n * k), o))
        sum_r = [np.bincount(cell, w * each, n_cells) for each in r]
        with_prior = sum_w + pull
        sources = list(zip(r, sum_r, strict=True))
        rr = [[float((w * a * b).sum() - (x * y / with_prior).sum()) for b, y in sources] for a, x in sources]
        pulled = (sum_o + pull * prior.mean_ppm) / with_prior
        ro = [float((w * a * o).sum() - (x * pulled).sum()) for a, x in sources]
        rates = _rates_above_zero(rr, ro, rates)
        plume, of_plume = np.zeros(n * k), np.zeros(n_cells)
        for rate, (a, x) in zip(rates, sources, strict=True):
            plume, of_plume = plume + rate * a, of_plume + rate * x
        background = (sum_o - of_plume + pull * prior.mean_ppm) / with_prior
        residual = o - background[cell] - plume
        is_clear = (plume > _CLEAR_ERRORS * reading_error_ppm) & (counted > 0.0)
        if is_clear.sum() > _CLEAR_ERRORS:
            relative = np.abs(residual[is_clear]) / plume[is_clear]
            model_error = float(np.clip(_NORMAL_BY_MEDIAN * np.median(relative), *_MODEL_ERROR))
        variance = reading_error_ppm * reading_error_ppm + np.square(model_error * plume)
        w = counted * (_FREEDOM + 1.0) / (_FREEDOM + np.square(residual) / variance) / variance
    tails = elementary.log1p_each(np.square(residual) / (_FREEDOM * variance))
    each = counted * (-0.5 * (_FREEDOM + 1.0) * tails - 0.5 * elementary.log_each(variance))
    log_prior = -0.5 * pull * np.square(background - prior.mean_ppm).sum()
    return TermsFit(float(each.sum() + log_prior), rates, background.reshape(-1, k), each.reshape(n, k).sum(axis=1))


# Least squares with rates that are not negative, source after source: of one source at once.
def _rates_above_zero(rr: list[list[float]], ro: list[float], rates: Floats) -> Floats:
    rates, n = rates.copy(), len(ro)
    for _ in range(1 if n == 1 else _RATE_ROUNDS):
        for i in range(n):
            others = sum(rr[i][j] * rates[j] for j in range(n) if j != i)
            rates[i] = max((ro[i] - others) / rr[i][i], 0.0) if rr[i][i] > 0.0 else 0.0
    return rates


def draw_blocks(start_s: Floats, name: str) -> tuple[NDArray[np.int64], Floats]:
    """Return the block of each row, and how often blocks are drawn in each of 200 bootstrap samples.

    Blocks last a quarter of an hour; there are eight at least where rows allow it.

    Args:
        start_s: (n,) times [s].
        name: Of the random stream.

    Returns:
        (n,) 0 … b - 1, and (200, b).
    """
    first_s = float(start_s.min())
    span_s = max(float(start_s.max()) - first_s, 1.0)
    labels = ((start_s - first_s) // min(BLOCK_S, span_s / _LEAST_BLOCKS)).astype(np.int64)
    block = np.unique(labels, return_inverse=True)[1].astype(np.int64)
    n = int(block.max()) + 1
    picks = stream(1, name).integers(n, size=(_DRAWS, n))
    return block, np.stack([np.bincount(row, minlength=n) for row in picks]).astype(np.float64)


@dataclass(frozen=True)
class PlaceCertainty:
    """How clearly a place is better than all others.

    Attributes:
        margin: Its score less that of the next place that does not count as the same; infinite where there is none.
        confidence: Share of bootstrap samples of quarters of an hour in which it is the best; one half at most where
            the next place is nearly as good.
        runner_up: The next place: its name, or x, y [m]; None without one.
    """

    margin: float
    confidence: float
    runner_up: str | tuple[float, float] | None

    @property
    def is_unsure(self) -> bool:
        """True if another place is nearly as good, or better in more than a tenth of samples of the same hours."""
        return self.confidence < SURE_SHARE


def rank_places(
    scores: Floats,
    drawn: Floats,
    is_best: NDArray[np.bool_],
    places: Sequence[str] | Sequence[tuple[float, float]],
    *,
    least_margin: float,
) -> PlaceCertainty:
    """Return how clearly the best place is better than the others.

    Args:
        scores: (p,) of the places, the higher the better.
        drawn: (d, p) the same in bootstrap samples.
        is_best: (p,) whether a place counts as the best one.
        places: (p,) names, or x, y [m].
        least_margin: Scores that differ by less are nearly equal.
    """
    if is_best.all():
        return PlaceCertainty(math.inf, 1.0, None)
    other = int(np.where(is_best, -np.inf, scores).argmax())
    best = float(scores[is_best].max())
    if not math.isfinite(best):
        return PlaceCertainty(0.0, 0.0, places[other])
    margin, share = best - float(scores[other]), float(is_best[drawn.argmax(axis=1)].mean())
    return PlaceCertainty(margin, share if margin >= least_margin else min(share, 0.5), places[other])


def gain_of_sources(few: TermsFit, many: TermsFit, n_readings: int, block: NDArray[np.int64]) -> float:
    """Return how much likelier readings are with more sources, over the least that counts: 1 and more counts.

    That is what errors of a model bring for each reading, what three more terms of a source bring by chance, and, over
    blocks of rows, two standard errors of the mean.

    Args:
        few: Fit without the further sources.
        many: Fit with them.
        n_readings: How many readings were fitted.
        block: (n,) block of each row.

    Source:
        Schwarz 1978, doi:10.1214/aos/1176344136, for terms that bring something by chance; the rest is ours.
    """
    rows = np.bincount(block, many.row_log_likelihood - few.row_log_likelihood)
    error = float(rows.std()) * math.sqrt(len(rows))
    least = max(_GAIN_PER_READING * n_readings, 1.5 * elementary.log(max(n_readings, 2)))
    gain = (many.log_likelihood - few.log_likelihood) / least
    return min(gain, float(rows.sum()) / (_LEAST_T * error)) if error > 0.0 else gain


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
