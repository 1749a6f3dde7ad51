"""A tracer on a roof: statistics of the measured record, by the functions that score our plumes."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from gslcosim_search.fixed_sensors.events import running_percentile
from gslcosim_validation.plume_statistics import PUBLISHED, RecordSettings, score_record
from gslcosim_validation.readers.folder import MeasuredData
from gslcosim_validation.readers.roof_tracer import RoofTracer
from gslcosim_validation.results import Case, CaseResult, Comparison, Drawing, Effort, Goal, Progress

Floats = NDArray[np.float64]

# The bound that the set's own figures have; the analysers answer within a second and read one value in it.
WHIFF_PPM = 20.0
STEP_S = 1.0
_BACKGROUND_HALF_S = 600.0
_FAR_BELOW_PPM = 50.0
# The analysers' second and the record's length leave this part of the durations and the spectrum.
_SETTINGS = RecordSettings(step_s=STEP_S, threshold=WHIFF_PPM, durations_s=(1.0, 40.0), spectrum_hz=(0.03, 0.3))
_QUANTITIES = {
    "presence": ("share of the time above 20 ppm", "0.127 by the set's description, above another background"),
    "intensity": ("intensity i", "2.8 to 3.2 by the same"),
    "conditional_intensity": ("conditional intensity", "about 1 (Peterson, Lamb and Stock 1990)"),
    "skewness_ratio": ("skewness over 2 i", "1 for a gamma distribution"),
    "kurtosis_ratio": ("kurtosis over 3 + 6 i²", "1 for a gamma distribution"),
    "blank_exponent": ("exponent of blanks", "1.5 (Celani and others 2014)"),
    "whiff_exponent": ("exponent of whiffs", "1.5 (Celani and others 2014)"),
}
_WHY = (
    "Here the measured record itself is outside the band that is asked of our plumes: half an hour of gas has few "
    "whiffs to fit, and an analyser with a second of its own cuts the shortest."
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


def _run(data: MeasuredData, effort: Effort, progress: Progress) -> CaseResult:
    rows: list[Comparison] = []
    drawings: list[Drawing] = []
    for each in data.of_format("roof_tracer"):
        progress(f"{each.name}: statistics", None)
        above = tracer_above_background(data.read(each, RoofTracer))
        scores = score_record(above, _SETTINGS, n_draws=100 if effort == "quick" else 400)
        for name, (quantity, anchor) in _QUANTITIES.items():
            band = PUBLISHED.get(name) if name == "blank_exponent" else None
            rows.append(
                Comparison(
                    measured_set=each.name,
                    quantity=f"measured: {quantity}",
                    ours=getattr(scores, name),
                    anchor=anchor,
                    goal=Goal.between(*band) if band else None,
                    if_missed=_WHY,
                )
            )
        drawings.append(_drawing(each.name, above))
    return CaseResult(rows=rows, drawings=drawings)


def _drawing(name: str, above: Floats) -> Drawing:
    def draw(figure: Any) -> None:
        axes = figure.subplots()
        axes.plot(np.arange(len(above)) * STEP_S / 60.0, above, lw=0.5)
        axes.axhline(WHIFF_PPM, color="0.5", lw=0.8, ls="--")
        axes.set(xlabel="minutes", ylabel="CO2 above background [ppm]")

    return Drawing(
        name=f"{name}-record", caption=f"{name}: the record; dashed: above it, a whiff.", draw=draw, aspect=0.3
    )


CASE = Case(
    name="roof-tracer",
    title="A tracer on a roof",
    what="Nothing of ours but the functions that score our plumes: what they say of a measured one, 10 m behind a "
    "release on a roof. No rate is known, so nothing absolute is compared.",
    formats=("roof_tracer",),
    run=_run,
)
