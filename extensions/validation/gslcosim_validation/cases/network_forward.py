"""Known leaks seen by masts: our puffs in the wind of each minute beside the readings (METEC)."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from gslcosim_validation.agreement import (
    agreement_estimate,
    factor_of_two_share,
    fractional_bias,
    normalised_mean_square_error,
)
from gslcosim_validation.mast_data import find_hourly_background, predict_releases
from gslcosim_validation.readers.mast_network import MastNetwork
from gslcosim_validation.results import Effort, Figure, Findings, Progress

Floats = NDArray[np.float64]

# As the comparison with the authors' model has it: means of half an hour, pairs of which one side exceeds this.
MEAN_S = 1800.0
LEAST_PPM = 0.1
_LOW_PERCENTILE, _LOW_S = 10.0, 4 * 3600.0
_MEASURES = {"fac2": factor_of_two_share, "bias": fractional_bias, "nmse": normalised_mean_square_error}


def measure(network: MastNetwork, effort: Effort, progress: Progress) -> Findings:
    """Return how well means of half an hour agree with puffs, above two backgrounds."""
    if not network.has_several_places:
        return Findings(remarks={"one_place": {}})
    progress("puffs", None)
    predicted = predict_releases(network)
    beside = find_hourly_background(network, predicted)
    backgrounds = {
        "hour": ("above the hour's background", beside),
        "low": ("above the 10th percentile of 4 h", _low(network)),
    }
    figures: list[Figure] = []
    scatter: dict[str, tuple[Floats, Floats]] = {}
    for kind_of_background, (name, background) in backgrounds.items():
        p, o, release = _half_hours(network, predicted, network.readings_ppm - background)
        scatter[name] = (p, o)
        kinds = {
            "largest": _pairs(np.nanmax(p, axis=1), np.nanmax(o, axis=1), release),
            "paired": _pairs(p.ravel(), o.ravel(), np.repeat(release, p.shape[1])),
        }
        for kind, pairs in kinds.items():
            for row, agreement in _MEASURES.items():
                ours = agreement_estimate(agreement, *pairs)
                figures.append(Figure(f"{kind}_{row}", ours, of=kind_of_background, background=name))
    return Findings(figures=figures, drawings={"scatter": lambda figure: _draw(figure, scatter)}, remarks={"low": {}})


def _low(network: MastNetwork) -> Floats:
    background = np.full(network.readings_ppm.shape, np.nan)
    part = ((network.clock_s - network.clock_s[0]) // _LOW_S).astype(np.int64)
    for label in np.unique(part):
        inside = part == label
        has_any = np.isfinite(network.readings_ppm[inside]).any(axis=0)
        low = np.nanpercentile(network.readings_ppm[np.ix_(inside, has_any)], _LOW_PERCENTILE, axis=0)
        background[np.ix_(inside, has_any)] = low
    return background


# Whole half hours from each release's start: (m, k) predicted, (m, k) measured, (m,) numbers of releases.
def _half_hours(network: MastNetwork, predicted: Floats, above: Floats) -> tuple[Floats, Floats, NDArray[np.int64]]:
    p, o, release = [], [], []
    for each in network.releases:
        for start_s in np.arange(each.start_s, each.end_s - MEAN_S + 1.0, MEAN_S):
            inside = (network.clock_s >= start_s) & (network.clock_s < start_s + MEAN_S)
            readings = above[inside]
            is_known = np.isfinite(readings)
            count = is_known.sum(axis=0)
            with np.errstate(invalid="ignore"):
                o.append(np.where(count > 0, np.where(is_known, readings, 0.0).sum(axis=0) / count, np.nan))
                p.append(np.where(count > 0, np.where(is_known, predicted[inside], 0.0).sum(axis=0) / count, np.nan))
            release.append(each.number)
    return np.array(p), np.array(o), np.array(release)


def _pairs(p: Floats, o: Floats, release: NDArray) -> tuple[Floats, Floats, NDArray]:
    is_kept = np.isfinite(p) & np.isfinite(o) & (np.maximum(p, o) > LEAST_PPM)
    return p[is_kept], o[is_kept], release[is_kept]


def _draw(figure: Any, scatter: dict[str, tuple[Floats, Floats]]) -> None:
    for axes, (title, (p, o)) in zip(figure.subplots(1, 2), scatter.items(), strict=True):
        axes.loglog(np.maximum(o, 0.02), np.maximum(p, 0.02), ".", color="0.7", ms=3)
        axes.loglog(np.maximum(np.nanmax(o, axis=1), 0.02), np.maximum(np.nanmax(p, axis=1), 0.02), "o", ms=3)
        ends = np.array([0.02, 30.0])
        for factor, style in ((1.0, "-"), (2.0, "--"), (0.5, "--")):
            axes.plot(ends, factor * ends, color="0.4", lw=0.8, ls=style)
        axes.set(title=title, xlabel="measured [ppm]", xlim=ends, ylim=ends)
    figure.axes[0].set_ylabel("puffs [ppm]")
