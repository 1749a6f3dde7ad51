"""Known leaks seen by lasers: our plume from the measured wind beside the readings (Chilbolton)."""

from typing import Any

import numpy as np

from gslcosim_validation.agreement import (
    agreement_estimate,
    factor_of_two_share,
    fractional_bias,
    normalised_mean_square_error,
)
from gslcosim_validation.laser_data import collect_laser_rows, find_daily_background, predict_plumes
from gslcosim_validation.readers.laser_paths import LaserPaths
from gslcosim_validation.results import Effort, Figure, Findings, Progress

# Pairs below this on both sides are noise of the background; the METEC authors' bound, ten errors of a reading.
LEAST_PPM = 0.1
_MEASURES = {"fac2": factor_of_two_share, "bias": fractional_bias, "nmse": normalised_mean_square_error}


def measure(paths: LaserPaths, effort: Effort, progress: Progress) -> Findings:
    """Return how well the readings of each source agree with its plume."""
    laser = collect_laser_rows(paths)
    predicted = predict_plumes(paths, laser)
    above = laser.readings_ppm - find_daily_background(laser, predicted)
    figures: list[Figure] = []
    scatter: list[tuple[str, np.ndarray, np.ndarray]] = []
    for i, name in enumerate(laser.names):
        is_seen = (np.maximum(above, predicted) > LEAST_PPM) & (laser.source == i)[:, None]
        p, o = predicted[is_seen], above[is_seen]
        block = np.broadcast_to(laser.block[:, None], is_seen.shape)[is_seen]
        scatter.append((name, p, o))
        for row, agreement in _MEASURES.items():
            figures.append(Figure(row, agreement_estimate(agreement, p, o, block), source=name))
    return Findings(figures=figures, drawings={"scatter": lambda figure: _draw(figure, scatter)})


def _draw(figure: Any, scatter: list[tuple[str, np.ndarray, np.ndarray]]) -> None:
    for axes, (source, p, o) in zip(figure.subplots(1, len(scatter), squeeze=False)[0], scatter, strict=True):
        axes.loglog(np.maximum(o, 0.02), np.maximum(p, 0.02), ".", ms=2, alpha=0.4)
        ends = np.array([0.02, 20.0])
        for factor, style in ((1.0, "-"), (2.0, "--"), (0.5, "--")):
            axes.plot(ends, factor * ends, color="0.4", lw=0.8, ls=style)
        axes.set(title=source, xlabel="measured above background [ppm]", xlim=ends, ylim=ends)
    figure.axes[0].set_ylabel("plume from the measured wind [ppm]")
