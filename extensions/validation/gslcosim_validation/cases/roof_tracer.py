"""A tracer on a roof: statistics of the measured record, by the functions that score our plumes."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from gslcosim_search.fixed_sensors.events import running_percentile
from gslcosim_validation.plume_statistics import RecordSettings, score_record
from gslcosim_validation.readers.roof_tracer import RoofTracer
from gslcosim_validation.results import Effort, Figure, Findings, Progress

Floats = NDArray[np.float64]

# The bound that the set's own figures have; the analysers answer within a second and read one value in it.
WHIFF_PPM = 20.0
STEP_S = 1.0
_BACKGROUND_HALF_S = 600.0
_FAR_BELOW_PPM = 50.0
# The analysers' second and the record's length leave this part of the durations and the spectrum.
_SETTINGS = RecordSettings(step_s=STEP_S, threshold=WHIFF_PPM, durations_s=(1.0, 40.0), spectrum_hz=(0.03, 0.3))
_FIGURES = (
    "presence",
    "intensity",
    "conditional_intensity",
    "skewness_ratio",
    "kurtosis_ratio",
    "blank_exponent",
    "whiff_exponent",
)


def tracer_above_background(record: RoofTracer) -> Floats:
    """Return the (n,) CO2 behind the release above its own running median [ppm], a value a second.

    The analyser before the release is not adjusted to it, and meets gas itself now and then. Readings far below what
    air ever has are an analyser that warms up. Seconds without a value are left out, so neighbours may be further apart
    than a second in a few places.
    """
    ppm = record.downwind_ppm
    with np.errstate(invalid="ignore"):
        known = np.where(ppm > np.nanmedian(ppm) - _FAR_BELOW_PPM, ppm, np.nan)
    background = running_percentile(record.downwind_s, known[:, None], half_s=_BACKGROUND_HALF_S, percentile=50.0)
    above = known - background[:, 0]
    return above[np.isfinite(above)]


def measure(record: RoofTracer, effort: Effort, progress: Progress) -> Findings:
    """Return the statistics of the record."""
    progress("statistics", None)
    above = tracer_above_background(record)
    scores = score_record(above, _SETTINGS, n_draws=100 if effort == "quick" else 400)
    return Findings(
        figures=[Figure(name, getattr(scores, name)) for name in _FIGURES],
        drawings={"record": lambda figure: _draw(figure, above)},
    )


def _draw(figure: Any, above: Floats) -> None:
    axes = figure.subplots()
    axes.plot(np.arange(len(above)) * STEP_S / 60.0, above, lw=0.5)
    axes.axhline(WHIFF_PPM, color="0.5", lw=0.8, ls="--")
    axes.set(xlabel="minutes", ylabel="CO2 above background [ppm]")
