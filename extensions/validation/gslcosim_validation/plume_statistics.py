"""Statistics of plumes: of a concentration record at a point, of the spread of tracers, and of a well-mixed room.

The same functions score our gas models and measured records. `score_record` gives all figures of a record with
bootstrap intervals over blocks of it; `PUBLISHED` has published bands for them.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from gslcosim.base.errors import ShapeError
from gslcosim_bench.statistics.estimates import SEED, Estimate, percentile_interval

F64 = NDArray[np.float64]

PUBLISHED: dict[str, tuple[float, float]] = {
    "blank_exponent": (1.2, 1.8),
    "whiff_exponent": (1.2, 1.8),
    "conditional_intensity": (0.8, 1.2),
    "skewness_ratio": (0.75, 1.25),
    "kurtosis_ratio": (0.75, 1.25),
    "spectral_slope": (-5 / 3 - 0.3, -5 / 3 + 0.3),
}
"""Bands around published figures, by the name of a figure of `PlumeScores`.

Durations: t^(-3/2), Celani, Villermaux and Vergassola 2014, Physical Review X 4, 041015. Conditional intensity: about
1, Peterson, Lamb and Stock 1990, Journal of Applied Meteorology 29. Moments: gamma distribution, Nironi et al. 2015,
Boundary-Layer Meteorology 156, 415. Spectrum: -5/3, Mylne and Mason 1991, QJRMS 117, 177. The widths are chosen here.
"""


@dataclass(frozen=True, kw_only=True)
class Moments:
    """Moments of a record: mean, intensity i (standard deviation over mean), skewness and kurtosis (3 if Gaussian)."""

    mean: float
    intensity: float
    skewness: float
    kurtosis: float

    @property
    def skewness_ratio(self) -> float:
        """Skewness over that of a gamma distribution of the same intensity, 2 i."""
        return self.skewness / (2.0 * self.intensity) if self.intensity > 0 else math.nan

    @property
    def kurtosis_ratio(self) -> float:
        """Kurtosis over that of a gamma distribution of the same intensity, 3 + 6 i^2."""
        return self.kurtosis / (3.0 + 6.0 * self.intensity**2) if self.intensity > 0 else math.nan


def compute_moments(values: F64) -> Moments:
    """Return the moments of (n,) values; not numbers where they are all equal or their mean is not above zero."""
    mean = float(values.mean())
    deviation = values - mean
    variance = float((deviation**2).mean())
    if not (mean > 0 and variance > 0):
        return Moments(mean=mean, intensity=0.0 if mean > 0 else math.nan, skewness=math.nan, kurtosis=math.nan)
    return Moments(
        mean=mean,
        intensity=math.sqrt(variance) / mean,
        skewness=float((deviation**3).mean()) / variance**1.5,
        kurtosis=float((deviation**4).mean()) / variance**2,
    )


def conditional_intensity(values: F64, threshold: float) -> float:
    """Return standard deviation over mean of those values that are above a threshold; not a number below two."""
    present = values[values > threshold]
    return float(present.std() / present.mean()) if len(present) > 1 else math.nan


def list_durations(is_present: NDArray[np.bool_], step_s: float) -> tuple[F64, F64]:
    """Return the durations of whiffs and of blanks [s] in an (n,) record of presence.

    The first and the last stretch are left out: the record cuts them.
    """
    changes = np.flatnonzero(is_present[1:] != is_present[:-1]) + 1
    durations_s = np.diff(changes) * step_s
    if len(durations_s) == 0:
        return np.zeros(0), np.zeros(0)
    is_whiff = is_present[changes[:-1]]
    return durations_s[is_whiff], durations_s[~is_whiff]


def power_law_exponent(durations_s: F64, *, step_s: float, low_s: float, high_s: float) -> float:
    """Return a in the density t^(-a) of durations between two times, by maximum likelihood.

    Durations are whole steps, so each stands for an interval of one step, and the ends of the range are put between
    two steps. Not a number with fewer than ten durations in the range.

    Source:
        Clauset, Shalizi and Newman 2009, SIAM Review 51, 661, section 3.3, with an upper end.
    Held by:
        extensions/validation/tests/unit/test_plume_statistics.py
    """
    low, high = math.ceil(low_s / step_s - 1e-9) - 0.5, math.floor(high_s / step_s + 1e-9) + 0.5
    steps = durations_s / step_s
    steps = steps[(steps > low) & (steps < high)]
    if len(steps) < 10:
        return math.nan
    # Of whole steps n: ((n - 1/2)^(1 - a) - (n + 1/2)^(1 - a)) / (low^(1 - a) - high^(1 - a)), integrals of t^(-a).
    exponents = np.arange(0.005, 4.0, 0.01)
    numbers, counts = np.unique(np.rint(steps), return_counts=True)
    power = 1.0 - exponents[:, None]
    mass = ((numbers - 0.5) ** power - (numbers + 0.5) ** power) / (low**power - high**power)
    return float(exponents[np.argmax(np.log(mass) @ counts)])


def spectral_density(values: F64, step_s: float, *, n_segment: int) -> tuple[F64, F64]:
    """Return frequencies [1/s] and density of a record, by Welch's method: half-overlapping Hann windows."""
    if len(values) < n_segment:
        raise ShapeError(f"spectrum: expected at least {n_segment} values, was {len(values)}.")
    # scipy-stubs take names of windows alone.
    window: Any = np.hanning(n_segment)
    overlap = n_segment - n_segment // 2
    frequency_hz, density = signal.welch(values, 1.0 / step_s, window=window, noverlap=overlap, detrend="constant")
    return frequency_hz[1:], density[1:]


def spectral_slope(frequency_hz: F64, density: F64, *, low_hz: float, high_hz: float) -> float:
    """Return the slope of log density over log frequency between two frequencies.

    Means over twelve equal parts of the logarithm are fitted, so that each octave weighs the same.
    """
    is_in = (frequency_hz >= low_hz) & (frequency_hz <= high_hz) & (density > 0)
    x, y = np.log(frequency_hz[is_in]), np.log(density[is_in])
    if len(x) < 3:
        return math.nan
    part = np.minimum(((x - math.log(low_hz)) / math.log(high_hz / low_hz) * 12).astype(np.int64), 11)
    parts = np.unique(part)
    x, y = (np.array([values[part == i].mean() for i in parts]) for values in (x, y))
    return float(np.polyfit(x, y, 1)[0]) if len(x) > 2 else math.nan


@dataclass(frozen=True, kw_only=True)
class RecordSettings:
    """Settings for the analysis of a record.

    Attributes:
        step_s: Time between values [s].
        threshold: A value above it is a whiff's.
        durations_s: Range of the fit to durations [s].
        spectrum_hz: Range of the fit to the spectrum [1/s].
        n_segment: Values in a segment of the spectrum, at most those of a block.
        n_blocks: Contiguous blocks that are drawn for the intervals.
    """

    step_s: float
    threshold: float
    durations_s: tuple[float, float] = (0.5, 20.0)
    spectrum_hz: tuple[float, float] = (0.3, 3.0)
    n_segment: int = 512
    n_blocks: int = 20


@dataclass(frozen=True, kw_only=True)
class PlumeScores:
    """Figures of one record, each with its bootstrap interval.

    Attributes:
        mean: Mean of the record.
        presence: Share of the time above the threshold: the intermittency factor.
        intensity: Standard deviation over mean, i.
        conditional_intensity: The same of what is above the threshold.
        skewness_ratio: Skewness over 2 i.
        kurtosis_ratio: Kurtosis over 3 + 6 i^2.
        blank_exponent: a of t^(-a), durations of blanks.
        whiff_exponent: a of t^(-a), durations of whiffs.
        spectral_slope: Slope of the spectrum in the range of the settings.
    """

    mean: Estimate
    presence: Estimate
    intensity: Estimate
    conditional_intensity: Estimate
    skewness_ratio: Estimate
    kurtosis_ratio: Estimate
    blank_exponent: Estimate
    whiff_exponent: Estimate
    spectral_slope: Estimate


# What a block adds to the figures: its values, durations and spectrum. Whiffs and blanks belong to where they began.
@dataclass(frozen=True, kw_only=True)
class _Block:
    values: F64
    whiffs_s: F64
    blanks_s: F64
    density: F64


def score_record(values: F64, settings: RecordSettings, *, n_draws: int = 400, seed: int = SEED) -> PlumeScores:
    """Return the figures of an (n,) record of concentrations with 95 % intervals, by drawing blocks with replacement.

    Blocks have to be longer than the correlation time of the air, or intervals are too narrow.

    Args:
        values: The record; background subtracted.

    Source:
        Künsch 1989, Annals of Statistics 17, 1217, with blocks that do not overlap.
    Held by:
        extensions/validation/tests/unit/test_plume_statistics.py
    """
    values = np.asarray(values, np.float64)
    n_block = len(values) // settings.n_blocks
    if n_block < 16 or not np.isfinite(values).all():
        raise ShapeError(
            f"record: expected at least {16 * settings.n_blocks} values, all finite, for {settings.n_blocks} blocks, "
            f"was {len(values)} with {int((~np.isfinite(values)).sum())} not finite."
        )
    n_segment = min(settings.n_segment, n_block)
    blocks = [
        _analyse_block(values[i * n_block : (i + 1) * n_block], settings, n_segment) for i in range(settings.n_blocks)
    ]
    frequency_hz = np.asarray(np.fft.rfftfreq(n_segment, settings.step_s)[1:], np.float64)
    found = _figures(blocks, frequency_hz, settings)
    rng = np.random.default_rng(seed)
    draws = [
        _figures([blocks[i] for i in rng.integers(len(blocks), size=len(blocks))], frequency_hz, settings)
        for _ in range(n_draws)
    ]
    return PlumeScores(
        **{name: _interval(value, [draw[name] for draw in draws], len(blocks)) for name, value in found.items()}
    )


def _analyse_block(values: F64, settings: RecordSettings, n_segment: int) -> _Block:
    whiffs_s, blanks_s = list_durations(values > settings.threshold, settings.step_s)
    _, density = spectral_density(values, settings.step_s, n_segment=n_segment)
    return _Block(values=values, whiffs_s=whiffs_s, blanks_s=blanks_s, density=density)


def _figures(blocks: Sequence[_Block], frequency_hz: F64, settings: RecordSettings) -> dict[str, float]:
    values = np.concatenate([block.values for block in blocks])
    moments = compute_moments(values)
    low_s, high_s = settings.durations_s

    def exponent(durations_s: list[F64]) -> float:
        return power_law_exponent(np.concatenate(durations_s), step_s=settings.step_s, low_s=low_s, high_s=high_s)

    low_hz, high_hz = settings.spectrum_hz
    return {
        "mean": moments.mean,
        "presence": float((values > settings.threshold).mean()),
        "intensity": moments.intensity,
        "conditional_intensity": conditional_intensity(values, settings.threshold),
        "skewness_ratio": moments.skewness_ratio,
        "kurtosis_ratio": moments.kurtosis_ratio,
        "blank_exponent": exponent([block.blanks_s for block in blocks]),
        "whiff_exponent": exponent([block.whiffs_s for block in blocks]),
        "spectral_slope": spectral_slope(
            frequency_hz, np.stack([block.density for block in blocks]).mean(axis=0), low_hz=low_hz, high_hz=high_hz
        ),
    }


def _interval(value: float, draws: Sequence[float], n: int) -> Estimate:
    known = np.array([draw for draw in draws if math.isfinite(draw)])
    # No interval where most draws are undefined.
    low, high = percentile_interval(known, freedom=n - 1) if len(known) >= 0.5 * len(draws) else (math.nan, math.nan)
    return Estimate(value, low, high, n)


def taylor_variance_m2(time_s: F64, *, velocity_std_m_s: float, time_scale_s: float) -> F64:
    """Return the variance of displacement along an axis after times [m2]: absolute dispersion.

    s^2 = 2 sv^2 TL (t - TL (1 - exp(-t / TL)))
    [m2] = [m2/s2] [s] [s]

    Source:
        Taylor 1922, Proceedings of the London Mathematical Society s2-20, 196.
    """
    scale = time_scale_s
    return 2.0 * velocity_std_m_s**2 * scale * (time_s - scale * (1.0 - np.exp(-time_s / scale)))


def score_absolute_dispersion(
    displacement_m: F64,
    time_s: F64,
    *,
    velocity_std_m_s: float,
    time_scale_s: float,
    histories: NDArray[np.integer] | None = None,
    seed: int = SEED,
) -> tuple[Estimate, ...]:
    """Return the measured variance over Taylor's at each time, with intervals by drawing tracers with replacement.

    Args:
        displacement_m: (n_tracers, n_times) displacements along an axis, the path of the mean wind subtracted [m].
        time_s: (n_times,) times since their release [s].
        velocity_std_m_s: Standard deviation of the velocity along the axis [m/s].
        time_scale_s: Lagrangian time scale [s].
        histories: (n_tracers,) labels; tracers of one history share its eddies and are drawn together. None: each for
            itself.
    """
    law_m2 = taylor_variance_m2(time_s, velocity_std_m_s=velocity_std_m_s, time_scale_s=time_scale_s)
    return _bootstrap_rows(displacement_m, lambda rows: (rows**2).mean(axis=0) / law_m2, histories, seed)


def score_richardson_constant(
    separation2_m2: F64,
    time_s: F64,
    *,
    dissipation_m2_s3: float,
    histories: NDArray[np.integer] | None = None,
    seed: int = SEED,
) -> tuple[Estimate, ...]:
    """Return g = <r^2> / (eps t^3) at each time, with intervals by drawing pairs with replacement.

    Args:
        separation2_m2: (n_pairs, n_times) squared separations, that at release subtracted [m2].
        time_s: (n_times,) times since their release [s], well below the Lagrangian time scale.
        dissipation_m2_s3: Rate of dissipation eps [m2/s3].
        histories: (n_pairs,) labels; see `score_absolute_dispersion`.

    Source:
        Ott and Mann 2000, Journal of Fluid Mechanics 422, 207: g = 0.5, uncertainty 0.2.
    """
    law_m2 = dissipation_m2_s3 * time_s**3
    return _bootstrap_rows(separation2_m2, lambda rows: rows.mean(axis=0) / law_m2, histories, seed)


def score_mean_ratio(near: F64, far: F64, *, of: float, n_blocks: int = 20, seed: int = SEED) -> Estimate:
    """Return the ratio of two records' means over a law's, with an interval by drawing blocks with replacement.

    Args:
        near: (n,) record of the mean above the line.
        far: (n,) record of the mean below it, of the same times.
        of: The ratio by the law.
        n_blocks: See `score_record`.
    """
    n = len(near) // n_blocks * n_blocks
    sums = np.stack([near[:n].reshape(n_blocks, -1).sum(axis=1), far[:n].reshape(n_blocks, -1).sum(axis=1)], axis=1)
    return _bootstrap_rows(sums, lambda rows: (rows[:, :1].sum(axis=0) / rows[:, 1].sum()) / of, None, seed)[0]


def _bootstrap_rows(
    rows: F64, figure: Callable[[F64], F64], histories: NDArray[np.integer] | None, seed: int
) -> tuple[Estimate, ...]:
    rng = np.random.default_rng(seed)
    labels = np.arange(len(rows)) if histories is None else histories
    groups = [np.flatnonzero(labels == label) for label in np.unique(labels)]
    values = figure(rows)
    draws = np.array(
        [
            figure(rows[np.concatenate([groups[i] for i in rng.integers(len(groups), size=len(groups))])])
            for _ in range(200)
        ]
    )
    return tuple(_interval(float(value), draws[:, i].tolist(), len(groups)) for i, value in enumerate(values))
