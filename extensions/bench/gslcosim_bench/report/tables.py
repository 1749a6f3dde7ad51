"""Tables of the report for other programs, and the provenance of results in words."""

import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from gslcosim_bench.report import number_formats
from gslcosim_bench.report.analysis import Analysis, DifficultyCauses, ReportView, find_beaten, find_same
from gslcosim_bench.report.conclusions import CONCLUDED, NOT_CONCLUDED, Conclusions, describe_conclusions
from gslcosim_bench.report.curves import BELIEF_FIGURES, ChartLine
from gslcosim_bench.report.leaderboard import DECLARED_WITHIN_M, LeaderboardRow
from gslcosim_bench.report.number_formats import format_duration
from gslcosim_bench.report.report_data import ReportData
from gslcosim_bench.report.validity import describe_validity
from gslcosim_bench.statistics.estimates import LEVEL, UNDEFINED, Estimate
from gslcosim_bench.store import TRIAL_COLUMNS
from gslcosim_bench.verification_marks import VerificationMark
from gslcosim_data.text_tables import escape_markdown, format_markdown_table, write_csv

PARTS = ("preparing", "starting", "flying", "judging", "storing")
LEADERBOARD_SCHEMA = "gslcosim/leaderboard/1"
FIGURES = (
    "score",
    "worst",
    "normalised",
    "success",
    *DECLARED_WITHIN_M,
    "lift",
    "time_s",
    "spl",
    "overhead",
    "false_alarms",
    "decision_ms",
)
"""Figures of an entry's row, each with its interval and its number of flights."""
_COLUMNS = (
    ("Score", number_formats.format_score),
    ("Worst quarter", number_formats.format_score),
    ("Success [%]", number_formats.format_percent),
    ("Lift [points]", number_formats.format_points),
    ("Mean time [s]", number_formats.format_three_digits),
    ("SPL", number_formats.format_score),
)
_SUMMED = ("score", "worst", "success", "lift", "time_s", "spl")
_NOTES = (
    "Score: mean over cases of q = S (1 - 0.5 t / T), halved for each false declaration, 0 after a collision; worst "
    "quarter: the same over the cases in which it is worst.",
    "Intervals are 95 %.",
    "Highest score first. Rank: the best and the worst place that an entry may have, by how many beat it and how many "
    "it beats; all pairs are compared in one family, so that equal entries all share the first rank in 95 % of "
    "comparisons.",
)
Table = Iterable[Sequence[Any]]
Leaderboard = tuple[list[str], list[list[str]]]
"""Headings and rows of text."""


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
    """Return the facts about a suite that the page states beside the figures."""
    material, manifest = analysis.material, analysis.material.manifest
    dropped = tuple((str(d.get("case", "")), str(d.get("reason", ""))) for d in manifest.get("dropped") or ())
    rows = analysis.material.rows
    parts = [(part, float(np.nansum(rows[f"wall_{part}_s"]))) for part in PARTS]
    return Provenance(
        title=str(manifest.get("title") or material.suite.get("title") or material.name),
        question=str(manifest.get("question") or material.suite.get("question") or ""),
        flown=_describe_trials(analysis),
        warnings=tuple(_warnings(analysis)),
        made=tuple(_made(manifest, analysis)),
        split_s=tuple(parts) if sum(seconds for _, seconds in parts) > 0 else (),
        dropped=dropped,
    )


def _describe_trials(analysis: Analysis) -> str:
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
    return [*found, *describe_validity(analysis)]


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
        ("verified", "" if "merged_from" in manifest else describe_mark(analysis.material.mark)),
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


def describe_mark(mark: VerificationMark | None) -> str:
    """Return in words what came of flying a sample of results again here."""
    if mark is None or not mark.sample:
        return "no"
    return f"{mark.same} of {mark.sample} trials flown again here gave the same digest, {mark.at}"


def write_tables(analysis: Analysis, folder: Path) -> None:
    """Write the CSV tables: numbers in full, a row of names first, empty where there is no value.

    Args:
        folder: Where to; made if need be.
    """
    folder.mkdir(exist_ok=True)
    tables = {
        "leaderboard": _items(analysis, lambda view: view.standings, ("rank", "last_rank", "entry", "n"), FIGURES),
        "success_by_start": _starts(analysis),
        "success_over_time": _lines(analysis, "time_s", lambda view: {"": view.curves}),
        "times": _items(
            analysis,
            lambda view: view.times,
            ("entry", "n", "n_missed"),
            ("restricted_s", "median_s", "expected_s", "found_s"),
        ),
        "profile": _lines(analysis, "factor", lambda view: {"": view.profiles}),
        "runtime": _lines(analysis, "time_s", lambda view: view.runtimes, "radius"),
        "pairs": _pairs(analysis),
        "declarations": _declarations(analysis),
        "declared_errors": _lines(analysis, "error_m", lambda view: {"": view.errors}),
        "roc": _rocs(analysis),
        "beliefs": _lines(analysis, "time_s", lambda view: view.beliefs, "figure"),
        "last_beliefs": _items(analysis, lambda view: view.last_beliefs, ("entry", "n"), BELIEF_FIGURES),
        "difficulty": _difficulty(analysis),
        **({"difference_to_null": _null_differences(analysis)} if analysis.nulls else {}),
        **({"success_by_label": _levels(analysis)} if analysis.levels else {}),
        "failures": _failures(analysis),
        "trials": _trials(analysis),
    }
    for name, rows in tables.items():
        path = folder / f"{name}.csv"
        with path.open("w", encoding="utf-8", newline="") as file:
            # nan is no text.
            write_csv(file, (["" if value != value else value for value in row] for row in rows))


def _heads(name: str) -> list[str]:
    return [name, f"{name}_low", f"{name}_high", f"{name}_n"]


def _parts(estimate: Estimate) -> list[float | int]:
    return [float(estimate.value), float(estimate.low), float(estimate.high), estimate.n]


def _names(analysis: Analysis) -> list[str]:
    return [entry.name for entry in analysis.material.entries]


# A row for each item of each view: its plain fields, `entry` among them by its name, and its estimates.
def _items(
    analysis: Analysis, of_view: Callable[[ReportView], Iterable[Any]], plain: Sequence[str], estimates: Sequence[str]
) -> Iterator[Sequence[Any]]:
    yield ["view", *plain, *(head for name in estimates for head in _heads(name))]
    for view in analysis.views:
        yield from ([view.key, *_cells(analysis, item, plain, estimates)] for item in of_view(view))


def _cells(analysis: Analysis, item: Any, plain: Sequence[str], estimates: Sequence[str]) -> list[Any]:
    names = _names(analysis)
    cells = [names[item.entry] if name == "entry" else getattr(item, name) for name in plain]
    return cells + [part for name in estimates for part in _parts(getattr(item, name))]


def _starts(analysis: Analysis) -> Iterator[Sequence[Any]]:
    yield ["room", "entry", "start_x_m", "start_y_m", *_heads("success")]
    for start in analysis.starts:
        yield [analysis.rooms[start.room].label, *_cells(analysis, start, ("entry", "x_m", "y_m"), ("success",))]


def _levels(analysis: Analysis) -> Iterator[Sequence[Any]]:
    plain, estimates = ("axis", "level", "is_core", "entry"), ("success", "alone", "approach", "difference")
    yield [*plain, *(head for name in estimates for head in _heads(name))]
    yield from (_cells(analysis, each, plain, estimates) for each in analysis.levels)


def _null_differences(analysis: Analysis) -> Iterator[Sequence[Any]]:
    plain, estimates = ("part", "entry", "p"), ("success", "null", "difference")
    yield [*plain, *(head for name in estimates for head in _heads(name))]
    yield from (_cells(analysis, each, plain, estimates) for each in analysis.nulls)


def _lines(
    analysis: Analysis, x: str, of_view: Callable[[ReportView], Mapping[str, Iterable[ChartLine]]], kind: str = ""
) -> Iterator[Sequence[Any]]:
    yield ["view", *([kind] if kind else []), "entry", x, "value", "low", "high", "n"]
    names = _names(analysis)
    for view in analysis.views:
        for label, lines in of_view(view).items():
            for line in lines:
                before = [view.key, *([label] if kind else []), names[line.entry]]
                columns = (getattr(line, end).tolist() for end in ("x", "value", "low", "high"))
                for point in zip(*columns, strict=True):
                    yield [*before, *point, line.n]


def _pairs(analysis: Analysis) -> Iterator[Sequence[Any]]:
    estimates = ("score", "success", "a_better")
    yield ["view", "a", "b", "better", "is_same", "p", *(head for name in estimates for head in _heads(name))]
    names = _names(analysis)
    for view in analysis.views:
        for p in view.pairs:
            better = {1: names[p.a], -1: names[p.b], 0: ""}[p.verdict]
            yield [view.key, names[p.a], names[p.b], better, *_cells(analysis, p, ("is_same", "p"), estimates)]


def _declarations(analysis: Analysis) -> Iterator[Sequence[Any]]:
    counts = ("right", "elsewhere", "silent", "alarms", "quiet")
    rates = ("right_frac", "elsewhere_frac", "silent_frac", "alarm_frac")
    heads = (head for name in (*rates, "roc_area", "localisation_roc_area") for head in _heads(name))
    yield ["view", "entry", *counts, *heads]
    for view in analysis.views:
        for d in view.declarations:
            areas = [part for c in (d.curve, d.place_curve) for part in _parts(c.area if c else UNDEFINED)]
            yield [view.key, *_cells(analysis, d, ("entry", *counts), rates), *areas]


def _rocs(analysis: Analysis) -> Iterator[Sequence[Any]]:
    yield ["view", "entry", "curve", "threshold", "false_positive", "true_positive"]
    names = _names(analysis)
    for view in analysis.views:
        for d in view.declarations:
            for label, curve in (("roc", d.curve), ("localisation_roc", d.place_curve)):
                if curve is not None:
                    columns = (curve.threshold, curve.false_positive, curve.true_positive)
                    for point in zip(*(column.tolist() for column in columns)):
                        yield [view.key, names[d.entry], label, *point]


def _difficulty(analysis: Analysis) -> Iterator[Sequence[Any]]:
    plain = ("case", "family", "grade", "is_informative", "shortest_m")
    estimates = ("difficulty", "success", "walker", "oracle_s", "contact")
    causes = [field.name for field in fields(DifficultyCauses)]
    yield [*plain, *(head for name in estimates for head in _heads(name)), *(f"cause_{name}" for name in causes)]
    for g in analysis.grades:
        yield [*_cells(analysis, g, plain, estimates), *(getattr(g.causes, name) for name in causes)]


def _failures(analysis: Analysis) -> Iterator[Sequence[Any]]:
    names = ("entry", "case", "repetition", "is_control", "status", "outcome", "nearest_m", "end_s", "agent_faults",
            "fault", "trial")  # fmt: skip
    yield [*names, "command"]
    material = analysis.material
    columns = [material.rows[name].tolist() for name in names]
    for group in analysis.failures:
        for row in group.rows.tolist():
            command = material.command_of(int(material.rows.entry[row]))
            yield [*(column[row] for column in columns), command + columns[-1][row]]


def _trials(analysis: Analysis) -> Iterator[Sequence[Any]]:
    yield [column.name for column in TRIAL_COLUMNS]
    yield from zip(*(analysis.material.rows[column.name].tolist() for column in TRIAL_COLUMNS))


def build_leaderboard_json(analysis: Analysis) -> str:
    """Return the leaderboard as JSON of the schema `gslcosim/leaderboard/1`: what `bench rank` and web pages read.

    A figure is `{"value", "low", "high", "n"}`; null is undefined. `beats` and `same_as` are null in views whose pairs
    are not reported: part of the cases with more than 20 entries, or no two entries with flights in common.
    """
    material, manifest = analysis.material, analysis.material.manifest
    content = {
        "schema": LEADERBOARD_SCHEMA,
        "suite": material.name,
        "suite_hash": manifest.get("suite_hash"),
        "title": describe_provenance(analysis).title,
        "software_hash": manifest.get("software_hash"),
        "sorted_by": "score",
        "level": LEVEL,
        "smallest_difference_points": 100.0 * material.smallest_difference,
        "n_trials": len(material.rows),
        "n_planned": material.n_planned,
        "complete": material.n_planned in (None, len(material.rows)),
        "verified": material.mark.model_dump(include={"same", "sample", "at"})
        if material.mark is not None and material.mark.sample else None,
        "conclusions": asdict(describe_conclusions(analysis, analysis.everything)),
        "views": [
            {"key": view.key, "kind": view.kind, "label": view.label, "drawn": view.units.level,
             "n_rooms": view.units.n_rooms, "n_plumes": view.units.n_plumes,
             "rows": [_json_row(analysis, view, row) for row in view.standings]}
            for view in analysis.views
        ],
    }  # fmt: skip
    return json.dumps(content, indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def _json_row(analysis: Analysis, view: ReportView, row: LeaderboardRow) -> dict[str, Any]:
    entry = analysis.material.entries[row.entry]
    names = _names(analysis)
    facts = {
        "rank": row.rank, "last_rank": row.last_rank, "entry": entry.name, "title": entry.title, "family": entry.family,
        "language": entry.language, "knows": entry.knows, "anchor": entry.anchor or None,
        "agent_hash": entry.agent_hash or None, "submission": entry.submission or None, "verified": entry.is_verified,
        "n": row.n, "beats": [names[i] for i in find_beaten(view, row.entry)] if view.pairs else None,
        "same_as": [names[i] for i in find_same(view, row.entry)] if view.pairs else None,
    }  # fmt: skip
    figures = {name: getattr(row, name).to_fields() for name in FIGURES}
    return facts | {name: None if fields["value"] is None else fields for name, fields in figures.items()}


def write_summary(analysis: Analysis) -> str:
    """Return the summary as Markdown: the question, what was run, the leaderboard, and who beats whom."""
    facts, view = describe_provenance(analysis), analysis.everything
    lines = [f"# {escape_markdown(facts.title)}", ""]
    lines += [f"> {escape_markdown(facts.question)}", ""] if facts.question else []
    lines += [facts.flown, ""]
    lines += [*_bullets(f"Note: {warning}" for warning in facts.warnings), ""] if facts.warnings else []
    if view.standings:
        lines += _conclusions(describe_conclusions(analysis, view))
        lines += _table(analysis)
        lines += ["", *_NOTES, ""]
        lines += _verdicts(analysis)
        lines += _headline(analysis)
    lines += ["## How it was made", "", *_bullets(f"{what}: {how}" for what, how in facts.made)]
    return "\n".join(lines).rstrip() + "\n"


def _conclusions(said: Conclusions) -> list[str]:
    parts = ((CONCLUDED, said.holds), (NOT_CONCLUDED, said.limits))
    return [line for head, some in parts if some for line in (f"## {head}", "", *_bullets(some), "")]


def _bullets(texts: Iterable[str]) -> list[str]:
    return [f"- {escape_markdown(text)}" for text in texts]


def _table(analysis: Analysis) -> list[str]:
    heads, rows = build_leaderboard_table(analysis)
    return format_markdown_table(heads, rows, rules=["--:", "---", *["--:"] * (len(heads) - 2)])


def build_leaderboard_table(analysis: Analysis) -> Leaderboard:
    """Return the leaderboard over all cases as headings and rows of text: rank, entry, figures, and their number."""
    standings, names = analysis.everything.standings, _names(analysis)
    columns = [
        (name, head, form)
        for name, (head, form) in zip(_SUMMED, _COLUMNS, strict=True)
        if any(getattr(row, name).n for row in standings)
    ]
    rows = [
        [
            number_formats.format_ranks(row.rank, row.last_rank),
            names[row.entry],
            *(number_formats.format_estimate(getattr(row, name), form) for name, _, form in columns),
            str(row.n),
        ]
        for row in standings
    ]
    return ["#", "Entry", *(head for _, head, _ in columns), "n"], rows


def _verdicts(analysis: Analysis) -> list[str]:
    view, names = analysis.everything, [escape_markdown(name) for name in _names(analysis)]
    if not view.pairs:
        return []
    lines = ["## Who beats whom", ""]
    for row in view.standings:
        found = (("better than", find_beaten(view, row.entry)), ("as successful as", find_same(view, row.entry)))
        said = [f"{words} {', '.join(names[i] for i in some)}" for words, some in found if some]
        if said:
            lines.append(f"- {names[row.entry]}: {'; '.join(said)}.")
    if len(lines) == 2:
        lines.append("No two entries have been told apart, and none are shown to be equally successful.")
    return [*lines, ""]


# Over all cases; families are in the table of the page.
def _headline(analysis: Analysis) -> list[str]:
    some = sorted((each for each in analysis.nulls if each.part == "all"), key=lambda each: -each.difference.value)
    if not some:
        return []
    names = _names(analysis)
    percent, points = number_formats.format_percent, number_formats.format_points
    rows = [
        [
            names[each.entry],
            number_formats.format_estimate(each.success, percent),
            number_formats.format_estimate(each.null, percent),
            number_formats.format_estimate(each.difference, points),
            str(each.difference.n),
        ]
        for each in some
    ]
    heads = ["Entry", "Success [%]", "Best null [%]", "Difference [points]", "n"]
    table = format_markdown_table(heads, rows, rules=["---", *["--:"] * 4])
    return ["## Difference to the null", "", *table, ""]
