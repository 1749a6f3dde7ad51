"""Sweeps: a method with each of several values of its parameters, in the same cases."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from gslcosim.benchmark.statistics.estimates import Estimate
from gslcosim.benchmark.suite.loading import LoadedSuite
from gslcosim.benchmark.tuning.deriving import Setting, derived, settings_of
from gslcosim.benchmark.tuning.figures import Figures, difference_of, figures_of, flights_of
from gslcosim.benchmark.tuning.subject import Subject
from gslcosim.contract.knowledge import ParameterValue
from gslcosim.errors import UsageError

MOST_SETTINGS = 500
"""More combinations than this are no sweep but a search."""


@dataclass(frozen=True, kw_only=True)
class Point:
    """A setting and what its flights came to; `difference` is that of its mean score from the reference's."""

    setting: Setting
    figures: Figures
    difference: Estimate | None


@dataclass(frozen=True, kw_only=True)
class Sweep:
    """A response curve: a point for each combination of the values of `varied`.

    `reference` is the setting that the others are compared with: the default where it was flown, else the first.
    `units` are those of the parameters; 1 where they have none or nobody says.
    """

    suite: str
    entry: str
    seed: int
    varied: Mapping[str, tuple[ParameterValue, ...]]
    units: Mapping[str, str]
    reference: Setting
    is_reference_default: bool
    points: tuple[Point, ...]


class Sweeper:
    """A sweep before it is flown, and what its rows say afterwards."""

    def __init__(self, subject: Subject, varied: Mapping[str, tuple[ParameterValue, ...]]) -> None:
        """Take a method and the values of its parameters.

        Raises:
            UsageError: there are too many combinations.
        """
        self.subject = subject
        self.varied = varied
        self.settings = settings_of(subject.entry.name, varied)
        if len(self.settings) > MOST_SETTINGS:
            raise UsageError(
                f"--vary: expected at most {MOST_SETTINGS} combinations, was {len(self.settings)}. "
                "Vary less at a time, or search: gslcosim tune."
            )
        self.name = f"sweep_{subject.loaded.suite.name}_{subject.entry.name}"

    def suite(self) -> LoadedSuite:
        """Return the suite that has to be flown."""
        return derived(self.subject, self.settings, name=self.name)

    def sweep(self, rows: Sequence[Mapping[str, Any]]) -> Sweep:
        """Return the response curve.

        Args:
            rows: Those of `trials.parquet`, of all settings.
        """
        flights = {
            setting.name: flights_of(row for row in rows if row["entry"] == setting.name) for setting in self.settings
        }
        default = next((each for each in self.settings if self._is_default(each)), None)
        reference = default or self.settings[0]
        return Sweep(
            suite=self.subject.loaded.suite.name,
            entry=self.subject.entry.name,
            seed=self.subject.loaded.suite.seed,
            varied=self.varied,
            units={name: self._unit(name) for name in self.varied},
            reference=reference,
            is_reference_default=default is not None,
            points=tuple(
                Point(
                    setting=each,
                    figures=figures_of(flights[each.name]),
                    difference=None
                    if each is reference
                    else difference_of(flights[each.name], flights[reference.name]),
                )
                for each in self.settings
            ),
        )

    def _is_default(self, setting: Setting) -> bool:
        return all(self.subject.default_of(name) == value for name, value in setting.parameters.items())

    def _unit(self, name: str) -> str:
        known = self.subject.card.parameters.get(name) if self.subject.card is not None else None
        return known.unit if known is not None else "1"
