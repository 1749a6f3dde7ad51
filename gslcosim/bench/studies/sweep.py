"""Sweep: a method with each of several parameter values in the same cases, and figures of each setting."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gslcosim.base.errors import UsageError
from gslcosim.bench.cases.suite_files import LoadedSuite
from gslcosim.bench.statistics.aggregates import stratified_bootstrap
from gslcosim.bench.statistics.estimates import Estimate
from gslcosim.bench.statistics.pairs import paired_difference, sign_flip
from gslcosim.bench.statistics.rates import wilson
from gslcosim.bench.statistics.times import restricted_mean
from gslcosim.bench.studies.target import Setting, StudyTarget, build_setting_suite, build_settings
from gslcosim.contract.messages import ParameterValue

# With fewer plumes in a room than this, drawing whole plumes tells nothing; as in the report.
_FEWEST_PLUMES = 5
_FLOWN = "flown"


@dataclass(frozen=True, kw_only=True)
class SettingRuns:
    """Runs of one setting by case and repetition, so that those of two settings go in pairs.

    Attributes:
        score: (n,) score; 0 where there is no result.
        success: (n,) whether the source was found.
        time_s: (n,) time as it is counted, the limit for every failure [s].
        limit_s: (n,) time limit [s].
        strata: (n,) cell that is drawn from apart; None: one.
        clusters: (n,) plume, where there are enough of them to draw whole ones; None: each run for itself.
        n_without_result: Crashed, hung and the like: they count as failures.
    """

    score: NDArray[np.float64]
    success: NDArray[np.bool_]
    time_s: NDArray[np.float64]
    limit_s: NDArray[np.float64]
    strata: NDArray[Any] | None
    clusters: NDArray[Any] | None
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
        strata=_strata(ordered),
        clusters=_clusters(ordered),
        n_without_result=sum(row["status"] != _FLOWN for row in ordered),
    )


def compute_figures(flights: SettingRuns) -> SettingFigures:
    """Return the figures of a setting, failures included in all of them."""
    return SettingFigures(
        n=flights.score.size,
        n_without_result=flights.n_without_result,
        success=wilson(int(flights.success.sum()), flights.success.size),
        score=_with_spread(
            stratified_bootstrap(flights.score, flights.strata, clusters=flights.clusters), flights.score
        ),
        time_s=restricted_mean(flights.time_s, flights.success, flights.limit_s, clusters=flights.clusters),
    )


def compute_difference(a: SettingRuns, b: SettingRuns) -> Estimate:
    """Return by how much the mean score of a is above that of b over the same runs."""
    return _with_spread(paired_difference(a.score, b.score, clusters=a.clusters, strata=a.strata), a.score - b.score)


def paired_p_value(a: SettingRuns, b: SettingRuns) -> float:
    """Return the p value of the paired permutation test that a and b score the same: honest also for few runs."""
    return sign_flip(a.score, b.score, clusters=a.clusters)


# Draws from equal values are all equal: that is no certainty, so no interval is reported.
def _with_spread(estimate: Estimate, values: NDArray[np.float64]) -> Estimate:
    return estimate if values.size and np.ptp(values) > 0.0 else replace(estimate, low=math.nan, high=math.nan)


# The finest cells that all have two runs or more: a cell of one shows no spread.
def _strata(rows: list[Mapping[str, Any]]) -> NDArray[Any] | None:
    for column in ("case", "scenario"):
        labels = np.array([row[column] for row in rows])
        if labels.size and np.unique(labels, return_counts=True)[1].min() > 1:
            return labels
    return None


def _clusters(rows: list[Mapping[str, Any]]) -> NDArray[Any] | None:
    plumes: dict[str, set[str]] = {}
    labels = [f"{row['environment_hash']}/{row['gas_seed']}" for row in rows]
    for row, label in zip(rows, labels, strict=True):
        plumes.setdefault(row["environment_hash"], set()).add(label)
    counts = [len(some) for some in plumes.values()]
    is_shared = bool(counts) and min(counts) >= _FEWEST_PLUMES and sum(counts) < len(rows)
    return np.array(labels) if is_shared else None


MAX_SETTINGS = 500
"""More combinations than this are no sweep but a search."""


@dataclass(frozen=True, kw_only=True)
class SweepPoint:
    """A setting and what its runs came to; `difference` is that of its mean score from the reference's."""

    setting: Setting
    figures: SettingFigures
    difference: Estimate | None


@dataclass(frozen=True, kw_only=True)
class SweepResult:
    """A response curve: a point for each combination of the values of `varied`.

    `reference` is the setting that the others are compared with: the default where it was run, else the first.
    `units` are those of the parameters; 1 where they have none or nobody says.
    """

    suite: str
    entry: str
    seed: int
    varied: Mapping[str, tuple[ParameterValue, ...]]
    units: Mapping[str, str]
    reference: Setting
    is_reference_default: bool
    points: tuple[SweepPoint, ...]


class SweepPlan:
    """A sweep before it is run, and what its rows say afterwards."""

    def __init__(self, subject: StudyTarget, varied: Mapping[str, tuple[ParameterValue, ...]]) -> None:
        """Take a method and the values of its parameters.

        Raises:
            UsageError: there are too many combinations.
        """
        self.subject = subject
        self.varied = varied
        self.settings = build_settings(subject.entry.name, varied)
        if len(self.settings) > MAX_SETTINGS:
            raise UsageError(
                f"--vary: expected at most {MAX_SETTINGS} combinations, was {len(self.settings)}. "
                "Vary less at a time, or search: gslcosim bench tune."
            )
        self.name = f"sweep_{subject.loaded.suite.name}_{subject.entry.name}"

    def suite(self) -> LoadedSuite:
        """Return the suite that has to be run."""
        return build_setting_suite(self.subject, self.settings, name=self.name)

    def sweep(self, rows: Sequence[Mapping[str, Any]]) -> SweepResult:
        """Return the response curve.

        Args:
            rows: Those of `trials.parquet`, of all settings.
        """
        flights = {
            setting.name: group_runs(row for row in rows if row["entry"] == setting.name) for setting in self.settings
        }
        default = next((each for each in self.settings if self._is_default(each)), None)
        reference = default or self.settings[0]
        return SweepResult(
            suite=self.subject.loaded.suite.name,
            entry=self.subject.entry.name,
            seed=self.subject.loaded.suite.seed,
            varied=self.varied,
            units={name: self._unit(name) for name in self.varied},
            reference=reference,
            is_reference_default=default is not None,
            points=tuple(
                SweepPoint(
                    setting=each,
                    figures=compute_figures(flights[each.name]),
                    difference=None
                    if each is reference
                    else compute_difference(flights[each.name], flights[reference.name]),
                )
                for each in self.settings
            ),
        )

    def _is_default(self, setting: Setting) -> bool:
        return all(self.subject.default_of(name) == value for name, value in setting.parameters.items())

    def _unit(self, name: str) -> str:
        known = self.subject.card.parameters.get(name) if self.subject.card is not None else None
        return known.unit if known is not None else "1"
