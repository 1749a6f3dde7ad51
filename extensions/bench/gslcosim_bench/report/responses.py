"""Responses of the report: figures of entries that are one method with several values of its parameters."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from gslcosim.base.errors import UsageError
from gslcosim_bench.cases.models import MAX_COMPARED_SETTINGS
from gslcosim_bench.report.report_data import Flags, Ints, ReportData, TrialRows
from gslcosim_bench.statistics.settings import SettingFigures, SettingRuns, compute_figures, group_runs
from gslcosim_bench.store import ResultsFolder

_COLUMNS = ("case", "scenario", "repetition", "status", "success", "time_limit_s", "environment_hash", "gas_seed")


@dataclass(frozen=True, kw_only=True)
class ResponsePoint:
    """An entry with its values of the parameters that vary, and what its runs with gas came to."""

    entry: int
    values: Mapping[str, Any]
    figures: SettingFigures


@dataclass(frozen=True, kw_only=True)
class ParameterResponse:
    """Response of a method to its parameters.

    Attributes:
        key: Distinguishes those of several methods.
        title: Of the method.
        units: Of the parameters that vary, by their names; 1 where there is none or nobody says.
        defaults: Of the same parameters, as the method's card has them; absent without a card.
        points: One for each setting that has flown.
    """

    key: str
    title: str
    units: Mapping[str, str]
    defaults: Mapping[str, Any]
    points: tuple[ResponsePoint, ...]


def compute_responses(material: ReportData, within: Flags) -> tuple[ParameterResponse, ...]:
    """Return the responses of methods whose entries differ in parameters alone; see `group_settings` of the plan."""
    index = {entry.name: i for i, entry in enumerate(material.entries)}
    found: list[ParameterResponse] = []
    for group, settings in _groups(material):
        if len(settings) > MAX_COMPARED_SETTINGS and not within.all():
            continue
        points: list[ResponsePoint] = []
        for name, values in settings.items():
            some = np.flatnonzero(within & ~material.rows.is_control & (material.rows.entry == index.get(name, -1)))
            if some.size:
                figures = compute_figures(_runs(material.rows, some))
                points.append(ResponsePoint(entry=index[name], values=values, figures=figures))
        if len(points) > 1:
            found.append(replace(group, points=tuple(points)))
    return tuple(found)


# Each method without its points, and its settings by their entries.
def _groups(material: ReportData) -> list[tuple[ParameterResponse, dict[str, dict[str, Any]]]]:
    found: list[tuple[ParameterResponse, dict[str, dict[str, Any]]]] = []
    groups: Sequence[Mapping[str, Any]] = material.manifest.get("settings") or ()
    try:
        for k, listed in enumerate(groups):
            units = {str(name): str(unit) for name, unit in listed["units"].items()}
            settings = {
                str(entry): {name: values[name] for name in units} for entry, values in listed["values"].items()
            }
            group = ParameterResponse(
                key=f"response_{k + 1}" if k else "response", title=str(listed["title"]), units=units,
                defaults=dict(listed.get("defaults") or {}), points=(),
            )  # fmt: skip
            found.append((group, settings))
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        path = ResultsFolder(material.folder).manifest
        raise UsageError(f"{path}: expected settings of entries, was a damaged file. Take it from a copy.") from error
    return found


def _runs(rows: TrialRows, some: Ints) -> SettingRuns:
    columns = {name: rows[name] for name in _COLUMNS} | {"score": rows.score, "time_s": rows.time_s}
    indices: list[int] = some.tolist()
    return group_runs({name: column[i] for name, column in columns.items()} for i in indices)
