"""Sweep: a suite whose entry has several values of its parameters, and figures of each setting."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from gslcosim.base.errors import UsageError
from gslcosim.contract.messages import ParameterValue
from gslcosim_bench.cases.models import MAX_SETTINGS
from gslcosim_bench.cases.suite_files import LoadedSuite
from gslcosim_bench.statistics.estimates import Estimate
from gslcosim_bench.statistics.settings import SettingFigures, compute_difference, compute_figures, group_runs
from gslcosim_bench.studies.target import Setting, StudyTarget, build_study_suite


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
        """Take a method and the values of its parameters."""
        self.subject = subject
        self.varied = varied
        self._entry = subject.entry.model_copy(update={"vary": varied})
        self.settings = tuple(
            Setting(name=each.name, parameters={name: each.parameters[name] for name in varied})
            for each in self._entry.settings
        )
        if len(self.settings) > MAX_SETTINGS:
            raise UsageError(
                f"--vary: expected at most {MAX_SETTINGS} combinations, was {len(self.settings)}. "
                "Vary less at a time, or search: gslcosim bench tune."
            )
        self.name = f"sweep_{subject.loaded.suite.name}_{subject.entry.name}"

    def suite(self) -> LoadedSuite:
        """Return the suite that has to be run."""
        return build_study_suite(self.subject, [self._entry], name=self.name)

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
