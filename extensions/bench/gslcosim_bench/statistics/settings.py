"""Figures of one setting of a method: success, mean score and mean time of its runs, and differences in pairs."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gslcosim_bench.statistics.estimates import Estimate, bootstrap_mean
from gslcosim_bench.statistics.pairs import paired_difference, sign_flip
from gslcosim_bench.statistics.rates import rate_over_units
from gslcosim_bench.statistics.sampling_units import SamplingUnits, find_sampling_units
from gslcosim_bench.statistics.times import restricted_mean

_FLOWN = "flown"


@dataclass(frozen=True, kw_only=True)
class SettingRuns:
    """Runs of one setting by case and repetition, so that those of two settings go in pairs.

    Attributes:
        score: (n,) score; 0 where there is no result.
        success: (n,) whether the source was found.
        time_s: (n,) time as it is counted, the limit for every failure [s].
        limit_s: (n,) time limit [s].
        units: Rooms, plumes or runs that are drawn.
        n_without_result: Crashed, hung and the like: they count as failures.
    """

    score: NDArray[np.float64]
    success: NDArray[np.bool_]
    time_s: NDArray[np.float64]
    limit_s: NDArray[np.float64]
    units: SamplingUnits
    n_without_result: int


@dataclass(frozen=True, kw_only=True)
class SettingFigures:
    """Success rate, mean score and restricted mean time [s] of n runs."""

    n: int
    n_without_result: int
    success: Estimate
    score: Estimate
    time_s: Estimate


def group_runs(rows: Iterable[Mapping[str, Any]]) -> SettingRuns:
    """Return runs from rows of `trials.parquet` of one setting."""
    ordered = sorted(rows, key=lambda row: (row["case"], row["repetition"]))
    limit_s = np.array([row["time_limit_s"] for row in ordered], dtype=np.float64)
    time_s = [limit if row["time_s"] is None else row["time_s"] for row, limit in zip(ordered, limit_s)]
    return SettingRuns(
        score=np.array([row["score"] or 0.0 for row in ordered], dtype=np.float64),
        success=np.array([bool(row["success"]) for row in ordered], dtype=np.bool_),
        time_s=np.array(time_s, dtype=np.float64),
        limit_s=limit_s,
        units=find_sampling_units(
            *([row[name] for row in ordered] for name in ("environment_hash", "gas_seed", "case"))
        ),
        n_without_result=sum(row["status"] != _FLOWN for row in ordered),
    )


def compute_figures(runs: SettingRuns) -> SettingFigures:
    """Return the figures of a setting, failures included in all of them."""
    return SettingFigures(
        n=runs.score.size,
        n_without_result=runs.n_without_result,
        success=rate_over_units(runs.success, runs.units),
        score=_with_spread(bootstrap_mean(runs.score, runs.units.stratum, clusters=runs.units.clusters), runs.score),
        time_s=restricted_mean(
            runs.time_s, runs.success, runs.limit_s, clusters=runs.units.clusters, cells=runs.units.case
        ),
    )


def compute_difference(a: SettingRuns, b: SettingRuns) -> Estimate:
    """Return by how much the mean score of a is above that of b over the same runs."""
    units = a.units
    difference = paired_difference(a.score, b.score, clusters=units.clusters, strata=units.stratum)
    return _with_spread(difference, a.score - b.score)


def paired_p_value(a: SettingRuns, b: SettingRuns) -> float:
    """Return the p value of the paired permutation test that a and b score the same: honest also for few runs."""
    return sign_flip(a.score, b.score, clusters=a.units.clusters)


# Draws from equal values are all equal: that is no certainty, so no interval is reported.
def _with_spread(estimate: Estimate, values: NDArray[np.float64]) -> Estimate:
    return estimate if values.size and np.ptp(values) > 0.0 else replace(estimate, low=math.nan, high=math.nan)
