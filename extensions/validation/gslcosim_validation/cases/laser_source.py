"""Leaks found by lasers: place and rate by our estimator, from wind and readings alone (Chilbolton)."""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gslcosim.base.rng import stream
from gslcosim_bench.statistics.estimates import Estimate, percentile_interval
from gslcosim_search.fixed_sensors.laser_sources import Place, PlaceSearch, build_searches, find_joint_rates_kg_s
from gslcosim_validation.laser_data import LaserRows, collect_laser_rows
from gslcosim_validation.readers.laser_paths import LaserPaths, OpenSource
from gslcosim_validation.results import Effort, Figure, Findings, Progress, plain_estimate

Floats = NDArray[np.float64]

_AROUND_M, _AROUND_STEP_M = 4.0, 0.5
_DRAWS = {"quick": 8, "full": 60}


def measure(paths: LaserPaths, effort: Effort, progress: Progress) -> Findings:
    """Return the errors of place and rate of each source, and how many were found where they were open together."""
    laser = collect_laser_rows(paths)
    searches = build_searches(laser)
    found: list[list[Place]] = []
    for i, search in enumerate(searches):
        progress(f"search for {laser.names[i]}", 0.5 * i / len(searches))
        found.append(search.find_all()[0])
    rates = find_joint_rates_kg_s(laser, searches, found)
    drawn_places, drawn_rates = _bootstrap(laser, searches, found, _DRAWS[effort], progress)
    figures: list[Figure] = []
    for i, minutes in enumerate(paths.sources):
        n, places = int((laser.source == i).sum()), np.array(found[i])
        truths = minutes.open_sources
        figures.append(Figure("number", plain_estimate(len(places), n), source=minutes.source, n_open=len(truths)))
        for each, j in zip(truths, match_places(places, np.array([one.position_m[:2] for one in truths])), strict=True):
            figures += _source_figures(each, n, places, j, rates[i], drawn_places[i], drawn_rates[i])
    return Findings(figures=figures, drawings={"places": lambda figure: _draw(figure, paths, found, drawn_places)})


def match_places(places_m: Floats, truths_m: Floats) -> list[int | None]:
    """Return which place stands for each true one, the nearest pair first; None where places are fewer."""
    off_m = np.hypot(*(truths_m[:, None] - places_m[None]).transpose(2, 0, 1))
    found: list[int | None] = [None] * len(truths_m)
    for _ in range(min(off_m.shape)):
        i, j = (int(x) for x in np.unravel_index(int(off_m.argmin()), off_m.shape))
        found[i] = j
        off_m[i], off_m[:, j] = np.inf, np.inf
    return found


# A source that was not found has the error of the nearest that was, and no rate.
def _source_figures(
    truth: OpenSource,
    n: int,
    places: Floats,
    j: int | None,
    rates: Floats,
    drawn_places: Floats,
    drawn_rates: Floats,
) -> list[Figure]:
    truth_m = np.array(truth.position_m[:2])
    nearest = int(np.hypot(*(places - truth_m).T).argmin()) if j is None else j
    error_m = float(np.hypot(*(places[nearest] - truth_m)))
    ends_m = percentile_interval(np.hypot(*(drawn_places[:, nearest] - truth_m).T))
    off = 100.0 * ((0.0 if j is None else rates[j]) / truth.rate_kg_s - 1.0)
    ends = (
        (math.nan, math.nan) if j is None else percentile_interval(100.0 * (drawn_rates[:, j] / truth.rate_kg_s - 1.0))
    )
    return [
        Figure(row, ours, of=truth.name, source=truth.name)
        for row, ours in (("place", Estimate(error_m, *ends_m, n)), ("rate", Estimate(off, *ends, n)))
    ]


# Quarters of an hour are drawn together; each place is sought around that of all, the others standing.
def _bootstrap(
    laser: LaserRows, searches: list[PlaceSearch], found: list[list[Place]], n_draws: int, progress: Progress
) -> tuple[list[Floats], list[Floats]]:
    rng = stream(1, "validation.laser_source.bootstrap")
    blocks, block_of = np.unique(laser.block, return_inverse=True)
    around = np.arange(-_AROUND_M, _AROUND_M + 0.5 * _AROUND_STEP_M, _AROUND_STEP_M)
    drawn_places = [np.empty((n_draws, len(places), 2)) for places in found]
    drawn_rates = [np.empty((n_draws, len(places))) for places in found]
    for d in range(n_draws):
        progress(f"bootstrap {d + 1} of {n_draws}", 0.5 + 0.5 * d / n_draws)
        times = np.bincount(rng.integers(len(blocks), size=len(blocks)), minlength=len(blocks)).astype(np.float64)
        weight = times[block_of]
        drawn: list[list[Place]] = []
        for search, places in zip(searches, found, strict=True):
            its, moved = weight[search.rows], list(places)
            for j, (x_m, y_m) in enumerate(places):
                near = [(x_m + float(dx), y_m + float(dy)) for dx in around for dy in around]

                def log_likelihood(
                    place: Place,
                    j: int = j,
                    search: PlaceSearch = search,
                    its: Floats = its,
                    moved: list[Place] = moved,
                ) -> float:
                    return search.fit([*moved[:j], place, *moved[j + 1 :]], its).log_likelihood

                moved[j] = max(near, key=log_likelihood)
            drawn.append(moved)
        for i, rates in enumerate(find_joint_rates_kg_s(laser, searches, drawn, weight)):
            drawn_places[i][d], drawn_rates[i][d] = drawn[i], rates
    return drawn_places, drawn_rates


def _draw(figure: Any, paths: LaserPaths, places: list[list[Place]], draws: list[Floats]) -> None:
    for i, axes in enumerate(figure.subplots(1, len(places), squeeze=False)[0]):
        for end_m in paths.reflectors_m:
            axes.plot(*zip(paths.instrument_m[:2], end_m[:2], strict=True), color="0.8", lw=0.8)
        axes.plot(*draws[i].reshape(-1, 2).T, ".", ms=3, alpha=0.4, label="bootstrap")
        axes.plot(*np.array(places[i]).T, "o", ms=5, label="found")
        truths_m = np.array([each.position_m[:2] for each in paths.sources[i].open_sources])
        axes.plot(*truths_m.T, "x", color="k", ms=7, label="true")
        axes.set(title=paths.sources[i].source, xlabel="x [m]", aspect="equal")
    figure.axes[0].set_ylabel("y [m]")
    figure.axes[0].legend(loc="lower left")
