"""Known leaks seen by lasers: our plume from the measured wind beside the readings (Chilbolton)."""

from typing import Any

import numpy as np

from gslcosim_search.fixed_sensors.background import background_beside_plumes
from gslcosim_search.fixed_sensors.laser_sources import READING_ERROR_PPM
from gslcosim_search.fixed_sensors.plume_response import plume_responses
from gslcosim_validation.agreement import (
    agreement_estimate,
    factor_of_two_share,
    fractional_bias,
    normalised_mean_square_error,
)
from gslcosim_validation.laser_data import collect_laser_rows
from gslcosim_validation.readers.folder import MeasuredData
from gslcosim_validation.readers.laser_paths import LaserPaths
from gslcosim_validation.results import Case, CaseResult, Comparison, Drawing, Effort, Goal, Progress

# Pairs below this on both sides are noise of the background; the METEC authors' bound, ten errors of a reading.
LEAST_PPM = 0.1
_PLAIN_PLUME = "plain Gaussian plume 0.60 and 0.43 (sources 1 and 2)"
_BIAS = "The rate is what the layout says, but the cylinder's weight shows that it was not the same in all releases."
_SCATTER = (
    "A minute's wind is measured at one place; its direction there is not that of all the air between source and beam, "
    "and a beam at the plume's edge is wrong by more than two with every few degrees."
)


def _run(data: MeasuredData, effort: Effort, progress: Progress) -> CaseResult:
    del effort
    rows: list[Comparison] = []
    drawings: list[Drawing] = []
    for each in data.of_format("laser_paths"):
        progress(f"{each.name}: reading", None)
        paths = data.read(each, LaserPaths)
        laser = collect_laser_rows(paths)
        predicted = np.empty_like(laser.readings_ppm)
        for i, minutes in enumerate(paths.sources):
            its = laser.source == i
            response = plume_responses(laser.sensors, laser.wind_of(i), np.array(minutes.position_m))
            predicted[its] = minutes.rate_kg_s * laser.gas_m3_per_kg[its, None] * response
        background = background_beside_plumes(
            laser.readings_ppm, predicted, laser.day, negligible_ppm=READING_ERROR_PPM
        )
        above = laser.readings_ppm - background
        scatter = []
        for i, name in enumerate(laser.names):
            is_seen = (np.maximum(above, predicted) > LEAST_PPM) & (laser.source == i)[:, None]
            p, o = predicted[is_seen], above[is_seen]
            block = np.broadcast_to(laser.block[:, None], is_seen.shape)[is_seen]
            scatter.append((name, p, o))
            rows += [
                Comparison(
                    measured_set=each.name,
                    quantity=f"{name}: FAC2 of {len(p)} beam minutes",
                    ours=agreement_estimate(factor_of_two_share, p, o, block),
                    anchor=_PLAIN_PLUME if each.campaign == "chilbolton" else "",
                    goal=Goal.at_least(0.5),
                    if_missed=_SCATTER,
                ),
                Comparison(
                    measured_set=each.name,
                    quantity=f"{name}: fractional bias",
                    ours=agreement_estimate(fractional_bias, p, o, block),
                    anchor="acceptance of Hanna and Chang 2012",
                    goal=Goal.between(-0.3, 0.3),
                    if_missed=_BIAS if each.campaign == "chilbolton" else _SCATTER,
                ),
                Comparison(
                    measured_set=each.name,
                    quantity=f"{name}: NMSE",
                    ours=agreement_estimate(normalised_mean_square_error, p, o, block),
                ),
            ]
        drawings.append(_drawing(each.name, scatter))
    return CaseResult(rows=rows, drawings=drawings)


def _drawing(name: str, scatter: list[tuple[str, np.ndarray, np.ndarray]]) -> Drawing:
    def draw(figure: Any) -> None:
        for axes, (source, p, o) in zip(figure.subplots(1, len(scatter), squeeze=False)[0], scatter, strict=True):
            axes.loglog(np.maximum(o, 0.02), np.maximum(p, 0.02), ".", ms=2, alpha=0.4)
            ends = np.array([0.02, 20.0])
            for factor, style in ((1.0, "-"), (2.0, "--"), (0.5, "--")):
                axes.plot(ends, factor * ends, color="0.4", lw=0.8, ls=style)
            axes.set(title=source, xlabel="measured above background [ppm]", xlim=ends, ylim=ends)
        figure.axes[0].set_ylabel("plume from the measured wind [ppm]")

    caption = f"{name}: each dot is one beam in one minute; dashed: a factor of two. Smaller values stand at 0.02."
    return Drawing(name=f"{name}-scatter", caption=caption, draw=draw, aspect=0.45)


CASE = Case(
    name="laser-forward",
    title="A known leak seen by lasers",
    what="A Gaussian plume whose spread comes from the measured fluctuation of the wind within each minute "
    "(`gslcosim_search.fixed_sensors.plume_response`), as seen along the beams, beside what the beams read above their "
    "background: the median of a beam on a day while no plume reaches it. Nothing is fitted.",
    formats=("laser_paths",),
    run=_run,
)
