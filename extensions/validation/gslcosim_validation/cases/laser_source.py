"""Leaks found by lasers: place and rate by our estimator, from wind and readings alone (Chilbolton)."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from gslcosim.base.rng import stream
from gslcosim_bench.statistics.estimates import Estimate, percentile_interval
from gslcosim_search.fixed_sensors.laser_sources import Place, PlaceSearch, build_searches, find_rates_kg_s
from gslcosim_validation.laser_data import LaserRows, collect_laser_rows
from gslcosim_validation.readers.laser_paths import LaserPaths
from gslcosim_validation.results import Effort, Figure, Findings, Progress

Floats = NDArray[np.float64]

_AROUND_M, _AROUND_STEP_M = 4.0, 0.5
_DRAWS = {"quick": 8, "full": 60}


def measure(paths: LaserPaths, effort: Effort, progress: Progress) -> Findings:
    """Return the errors of place and rate of each source."""
    laser = collect_laser_rows(paths)
    searches = build_searches(laser)
    places: list[Place] = []
    for i, search in enumerate(searches):
        progress(f"search for {laser.names[i]}", 0.5 * i / len(searches))
        places.append(search.find_best())
    rates = find_rates_kg_s(laser, searches, places)
    drawn_places, drawn_rates = _bootstrap(laser, searches, places, _DRAWS[effort], progress)
    figures: list[Figure] = []
    for i, minutes in enumerate(paths.sources):
        n, truth = int((laser.source == i).sum()), np.array(minutes.position_m[:2])
        error_m = float(np.hypot(*(places[i] - truth)))
        ends_m = percentile_interval(np.hypot(*(drawn_places[:, i] - truth).T))
        off = 100.0 * (rates[i] / minutes.rate_kg_s - 1.0)
        ends = percentile_interval(100.0 * (drawn_rates[:, i] / minutes.rate_kg_s - 1.0))
        for row, ours in (("place", Estimate(error_m, *ends_m, n)), ("rate", Estimate(off, *ends, n))):
            figures.append(Figure(row, ours, of=minutes.source, source=minutes.source))
    return Findings(figures=figures, drawings={"places": lambda figure: _draw(figure, paths, places, drawn_places)})


# Quarters of an hour are drawn together; the place is sought around that of all.
def _bootstrap(
    laser: LaserRows, searches: list[PlaceSearch], places: list[Place], n_draws: int, progress: Progress
) -> tuple[Floats, Floats]:
    rng = stream(1, "validation.laser_source.bootstrap")
    blocks, block_of = np.unique(laser.block, return_inverse=True)
    around = np.arange(-_AROUND_M, _AROUND_M + 0.5 * _AROUND_STEP_M, _AROUND_STEP_M)
    found, rates = np.empty((n_draws, len(searches), 2)), np.empty((n_draws, len(searches)))
    for d in range(n_draws):
        progress(f"bootstrap {d + 1} of {n_draws}", 0.5 + 0.5 * d / n_draws)
        times = np.bincount(rng.integers(len(blocks), size=len(blocks)), minlength=len(blocks)).astype(np.float64)
        weight = times[block_of]
        drawn = []
        for search, (x_m, y_m) in zip(searches, places, strict=True):
            near = [(x_m + float(dx), y_m + float(dy)) for dx in around for dy in around]
            its = weight[search.rows]
            drawn.append(max(near, key=lambda place, search=search, its=its: search.log_likelihood(place, its)))
        found[d] = drawn
        rates[d] = find_rates_kg_s(laser, searches, drawn, weight)
    return found, rates


def _draw(figure: Any, paths: LaserPaths, places: list[Place], draws: Floats) -> None:
    for i, axes in enumerate(figure.subplots(1, len(places), squeeze=False)[0]):
        for end_m in paths.reflectors_m:
            axes.plot(*zip(paths.instrument_m[:2], end_m[:2], strict=True), color="0.8", lw=0.8)
        axes.plot(*draws[:, i].T, ".", ms=3, alpha=0.4, label="bootstrap")
        axes.plot(*places[i], "o", ms=5, label="found")
        axes.plot(*paths.sources[i].position_m[:2], "x", color="k", ms=7, label="true")
        axes.set(title=paths.sources[i].source, xlabel="x [m]", aspect="equal")
    figure.axes[0].set_ylabel("y [m]")
    figure.axes[0].legend(loc="lower left")
