"""Difference of each entry's success to that of the best null in the same cases."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from gslcosim_bench.report.leaderboard import build_matrix, sampling_units
from gslcosim_bench.report.report_data import Flags, Floats, Ints, ReportData
from gslcosim_bench.statistics.estimates import Estimate, encode_labels
from gslcosim_bench.statistics.nulls import best_null_elsewhere
from gslcosim_bench.statistics.ranking import estimate_family, estimate_means


@dataclass(frozen=True, kw_only=True)
class NullDifference:
    """An entry's success beside that of the best null, over the runs with gas that both made.

    Attributes:
        part: `all`, or a family.
        entry: Index of the entry.
        success: Its success.
        null: That of the null that is best in the other runs of the same scenario; where these are few, of its family
            or of all.
        difference: Success less null; its intervals over the entries of a part hold together.
        p: That there is no difference, corrected for the entries of the part.
    """

    part: str
    entry: int
    success: Estimate
    null: Estimate
    difference: Estimate
    p: float


def find_nulls(material: ReportData) -> tuple[int, ...]:
    """Return the indices of the suite's nulls that have rows."""
    names = material.suite.get("nulls") or ()
    listed = [str(name) for name in names] if isinstance(names, list | tuple) else []
    return tuple(i for i, entry in enumerate(material.entries) if entry.name in listed)


def compare_with_nulls(material: ReportData) -> tuple[NullDifference, ...]:
    """Return the difference of each entry but the nulls to the best null, over all cases and in each family.

    Empty where the suite names no null, or none of them has rows.
    """
    rows, nulls = material.rows, find_nulls(material)
    anchor = material.index_of_anchor("lower")
    entries = [i for i in range(len(material.entries)) if i not in nulls and i != anchor]
    if not nulls or not entries:
        return ()
    matrix, some = build_matrix(rows, np.ones(len(rows), dtype=bool), [*nulls, *entries], _success(material))
    groupings = [encode_labels(rows[name][some]) for name in ("scenario", "family")]
    null = best_null_elsewhere(matrix[:, : len(nulls)], groupings)
    return tuple(
        found
        for part, chosen in _parts(material, some)
        for found in _compare_part(material, part, entries, matrix[chosen, len(nulls) :], null[chosen], some[chosen])
    )


def _success(material: ReportData) -> Floats:
    return material.rows["success"].astype(np.float64)


# All cases, and each family where there are several.
def _parts(material: ReportData, some: Ints) -> Iterator[tuple[str, Flags]]:
    families = material.rows["family"][some]
    yield "all", np.ones(len(some), dtype=bool)
    names = list(dict.fromkeys(families.tolist()))
    if len(names) > 1:
        yield from ((name, np.asarray(families == name, dtype=bool)) for name in names)


def _compare_part(
    material: ReportData, part: str, entries: list[int], success: Floats, null: Floats, some: Ints
) -> Iterator[NullDifference]:
    difference = success - null[:, None]
    has_any = np.asarray(~np.isnan(difference).all(axis=0))
    if not has_any.any():
        return
    difference, success = difference[:, has_any], success[:, has_any]
    rows = material.rows
    units, cases = sampling_units(rows, some), encode_labels(rows.cells[some])
    beside = np.where(np.isnan(difference), np.nan, null[:, None])
    differences, p = estimate_family(difference, units, cases, limit=1.0)
    shares = (estimate_means(values, units, cases, bounds=(0.0, 1.0)) for values in (success, beside))
    flown = [entry for entry, has in zip(entries, has_any.tolist(), strict=True) if has]
    for entry, found, own, best, p_value in zip(flown, differences, *shares, p.tolist(), strict=True):
        yield NullDifference(part=part, entry=entry, success=own, null=best, difference=found, p=p_value)
