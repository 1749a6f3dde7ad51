"""Provenance of results in words: what ran, on which machine, how long it took, and what is missing."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from gslcosim.bench.report.analysis import Analysis
from gslcosim.bench.report.number_formats import format_duration
from gslcosim.bench.report.report_data import ReportData
from gslcosim.bench.store.verification_marks import VerificationMark

PARTS = ("preparing", "starting", "flying", "judging", "storing")


@dataclass(frozen=True, kw_only=True)
class Provenance:
    """Facts that the page states around the figures.

    Attributes:
        title: Of the suite.
        question: That it asks; may be empty.
        flown: One line of what was run.
        warnings: What the reader has to know before the figures.
        made: Pairs of what and how, for the last section.
        split_s: Time by the clock of all trials together, by part [s].
        dropped: Combinations that were no case, and why.
    """

    title: str
    question: str
    flown: str
    warnings: tuple[str, ...]
    made: tuple[tuple[str, str], ...]
    split_s: tuple[tuple[str, float], ...]
    dropped: tuple[tuple[str, str], ...]


def describe_provenance(analysis: Analysis) -> Provenance:
    """Return what the page says around the figures."""
    material, manifest = analysis.material, analysis.material.manifest
    dropped = tuple((str(d.get("case", "")), str(d.get("reason", ""))) for d in manifest.get("dropped") or ())
    return Provenance(
        title=str(manifest.get("title") or material.suite.get("title") or material.name),
        question=str(manifest.get("question") or material.suite.get("question") or ""),
        flown=_flown(analysis),
        warnings=tuple(_warnings(analysis)),
        made=tuple(_made(manifest, analysis)),
        split_s=_split_s(analysis),
        dropped=dropped,
    )


def _flown(analysis: Analysis) -> str:
    material, rows = analysis.material, analysis.material.rows
    n_cases = len({*rows["case"][~rows.is_control].tolist()})
    n_controls = int(rows.is_control.sum())
    text = (
        f"{_count(len(rows) - n_controls, 'flight')} of {_count(len(material.entries), 'entry', 'entries')} "
        f"in {_count(n_cases, 'case')} of {_count(len(set(rows['scenario'].tolist())), 'scenario')}"
    )
    if n_controls:
        text += f", and {_count(n_controls, 'flight')} without gas as controls"
    if limits := sorted({float(limit) for limit in rows["time_limit_s"].tolist() if np.isfinite(limit)}):
        text += f"; time limit {' to '.join(dict.fromkeys(f'{x:g}' for x in (limits[0], limits[-1])))} s"
    if radii := sorted({float(radius) for radius in rows["within_m"].tolist() if np.isfinite(radius)}):
        text += f", success within {' to '.join(dict.fromkeys(f'{x:g}' for x in (radii[0], radii[-1])))} m"
    return text + "."


def _count(n: int, one: str, many: str = "") -> str:
    return f"{n:,} {one if n == 1 else many or one + 's'}".replace(",", "\u202f")


def _warnings(analysis: Analysis) -> list[str]:
    material, rows = analysis.material, analysis.material.rows
    found: list[str] = []
    planned = material.n_planned
    if planned is not None and planned > len(rows):
        found.append(
            f"Not complete: {len(rows)} of {planned} trials have been flown. Entries may not have met the same cases."
        )
    if not len(rows):
        found.append("No trial has been flown yet.")
    if n_without := int((rows["status"] != "flown").sum()):
        found.append(
            f"{_count(n_without, 'trial')} ended without a result and count as failures that took all the time; "
            "see failures."
        )
    if not len(rows):
        return found
    if material.index_of_anchor("lower") is None:
        found.append("The oracle has not flown: there is no profile, and no score is normalised.")
    if not rows.is_control.any():
        found.append("There are no flights without gas: luck and false alarms cannot be told.")
    if not material.maps:
        found.append("There are no maps of the rooms: tracks and starts are drawn on bare ground.")
    if material.tracks is None:
        found.append("There are no tracks.")
    if unverified := _unverified(material):
        found.append(unverified)
    return found


def _unverified(material: ReportData) -> str:
    checked = [entry for entry in material.entries if entry.is_verified is not None]
    if checked:
        names = [entry.name for entry in checked if not entry.is_verified]
        return f"Not verified by flying a sample again: {', '.join(names)}." if names else ""
    if material.mark is None or not material.mark.sample:
        return "Not verified: no sample of these trials has been flown again."
    return ""


def _made(manifest: Mapping[str, Any], analysis: Analysis) -> list[tuple[str, str]]:
    rows = analysis.material.rows
    versions, machine, wall = (manifest.get(key) or {} for key in ("versions", "machine", "wall"))
    seeds = rows["seed"]
    made = [
        ("suite", f"{analysis.material.name} {str(manifest.get('suite_hash') or '')[:16]}".strip()),
        ("versions", ", ".join(f"{name} {version}" for name, version in versions.items())),
        ("software", str(manifest.get("software_hash") or "")[:16]),
        ("seeds", f"{len(set(seeds.tolist()))} of runs, {len(set(rows['gas_seed'].tolist()))} of gas"),
        ("digests", f"{sum(map(bool, rows['digest'].tolist()))} of {len(rows)} trials have one (tables/trials.csv)"),
        ("verified", "" if "merged_from" in manifest else _verified(analysis.material.mark)),
        ("machine", ", ".join(str(p) for p in (machine.get("cpu"), _cores(machine), machine.get("platform")) if p)),
        ("reference loop", _seconds(machine.get("reference_loop_s"), " in plain Python, to compare machines by")),
        ("begun", str(wall.get("started_at") or "")),
        ("wall time", _wall(wall)),
        ("workers", f"{wall['jobs']}, flying for {100 * wall['busy_share']:.0f} % of the time after preparation"
            if isinstance(wall.get("busy_share"), int | float) and "jobs" in wall else str(wall.get("jobs") or "")),
        ("merged from", ", ".join(map(str, manifest.get("merged_from") or ()))),
        ("trials", f"{len(rows)} of {analysis.material.n_planned or '?'} planned"),
    ]  # fmt: skip
    return [(what, how) for what, how in made if how]


def _cores(machine: Mapping[str, Any]) -> str:
    return f"{machine['cores']} cores" if machine.get("cores") else ""


def _seconds(value: Any, after: str) -> str:
    return format_duration(float(value)) + after if isinstance(value, int | float) else ""


def _wall(wall: Mapping[str, Any]) -> str:
    parts = [
        f"{format_duration(float(wall[key]))} {word}"
        for key, word in (("total_s", "in all"), ("preparing_s", "preparing rooms and tapes"), ("flying_s", "flying"))
        if isinstance(wall.get(key), int | float)
    ]
    return ", ".join(parts)


def _verified(mark: VerificationMark | None) -> str:
    if mark is None or not mark.sample:
        return "no"
    return f"{mark.same} of {mark.sample} trials flown again here gave the same digest, {mark.at}"


def _split_s(analysis: Analysis) -> tuple[tuple[str, float], ...]:
    rows = analysis.material.rows
    parts = [(part, float(np.nansum(rows[f"wall_{part}_s"]))) for part in PARTS]
    return tuple(parts) if sum(seconds for _, seconds in parts) > 0 else ()
