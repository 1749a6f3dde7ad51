"""Facts that a site shows of each method and each case, taken from the rows and the report's figures."""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from gslcosim.base.untrusted_input import JsonObject, parse_json
from gslcosim.methods.card import MethodCard
from gslcosim_bench.cases.models import select_labels
from gslcosim_bench.report.analysis import Analysis, CaseDifficulty, FailureGroup
from gslcosim_bench.report.leaderboard import LeaderboardRow, sampling_units
from gslcosim_bench.report.number_formats import format_percent, format_three_digits
from gslcosim_bench.report.plans import PlanDrawing
from gslcosim_bench.report.report_data import EnvironmentMap, Floats, Ints, ReportData, ReportEntry
from gslcosim_bench.report.tables import describe_mark
from gslcosim_bench.statistics.estimates import Estimate
from gslcosim_bench.statistics.rates import rate_over_units, wilson

_MAX_VALUES = 12
_ANCHORS = {"lower": "it knows the source: the best possible", "upper": "it smells nothing: the trivial one"}
# Wind whose direction agrees over the room by so much is told as one direction.
_ONE_DIRECTION = 0.5
# By eighths of a turn from the x axis on, with y to the north.
_WINDS = ("east (x)", "north-east", "north (y)", "north-west", "west", "south-west", "south", "south-east")


@dataclass(frozen=True, kw_only=True)
class EntryInCase:
    """Flights of an entry in a case.

    Attributes:
        success: Share of the flights with gas; undefined without such flights.
        time_s: Their restricted mean time [s].
        nearest_m: Median of the smallest distance to a source [m]; nan where it is unknown.
        rows: Flights with gas.
        controls: Flights without.
    """

    entry: int
    success: Estimate
    time_s: float
    nearest_m: float
    rows: Ints
    controls: Ints


@dataclass(frozen=True, kw_only=True)
class CaseFacts:
    """A case: its facts in words, and its entries in the order of the leaderboard."""

    name: str
    file: str
    family: str
    grade: str
    room: PlanDrawing
    facts: tuple[tuple[str, str], ...]
    entries: tuple[EntryInCase, ...]


@dataclass(frozen=True, kw_only=True)
class ParameterSetting:
    """A parameter of a method as it was flown; `is_default` where the entry leaves it as its card has it."""

    name: str
    value: str
    unit: str
    meaning: str
    origin: str
    is_default: bool


@dataclass(frozen=True, kw_only=True)
class FactorLevel:
    """Success of an entry where a factor has one value.

    Of families and scenarios there are score and time too; of labelled axes the change from the core where this axis
    alone differs.
    """

    label: str
    success: Estimate
    score: Estimate | None = None
    time_s: Estimate | None = None
    difference: Estimate | None = None


@dataclass(frozen=True, kw_only=True)
class MethodFacts:
    """A method: what it is, its row of the table, its success by case and by factor, and its failures."""

    entry: int
    file: str
    summary: str
    facts: tuple[tuple[str, str], ...]
    parameters: tuple[ParameterSetting, ...]
    row: LeaderboardRow | None
    factors: tuple[tuple[str, tuple[FactorLevel, ...]], ...]
    cases: tuple[tuple[CaseFacts, EntryInCase], ...]
    failures: tuple[FailureGroup, ...]


def describe_cases(analysis: Analysis, files: Mapping[str, str]) -> tuple[CaseFacts, ...]:
    """Return the facts of all cases, in the order of the suite."""
    material, rows = analysis.material, analysis.material.rows
    grades = {grade.case: grade for grade in analysis.grades}
    room_of = {row: room for room in analysis.rooms for row in room.rows.tolist()}
    order = [row.entry for row in analysis.everything.standings]
    order += [i for i in range(len(material.entries)) if i not in order]
    found: list[CaseFacts] = []
    for name, file in files.items():
        flown = np.flatnonzero(rows["case"] == name)
        room, grade = room_of[int(flown[0])], grades.get(name)
        entries = [_summarise(material, flown[rows.entry[flown] == entry], entry) for entry in order]
        found.append(
            CaseFacts(
                name=name, file=file, family=str(rows["family"][flown[0]]), grade=grade.grade if grade else "",
                room=room, facts=tuple(_case_facts(material, flown, room, grade)),
                entries=tuple(each for each in entries if each.rows.size or each.controls.size),
            )
        )  # fmt: skip
    return tuple(found)


def _summarise(material: ReportData, flown: Ints, entry: int) -> EntryInCase:
    rows = material.rows
    is_control = rows.is_control[flown]
    with_gas = flown[~is_control]
    nearest_m = rows["nearest_m"][with_gas]
    nearest_m = nearest_m[np.isfinite(nearest_m)]
    return EntryInCase(
        entry=entry,
        success=wilson(int(rows["success"][with_gas].sum()), with_gas.size),
        time_s=float(rows.time_s[with_gas].mean()) if with_gas.size else math.nan,
        nearest_m=float(np.median(nearest_m)) if nearest_m.size else math.nan,
        rows=with_gas,
        controls=flown[is_control],
    )


def _case_facts(
    material: ReportData, flown: Ints, room: PlanDrawing, grade: CaseDifficulty | None
) -> list[tuple[str, str]]:
    rows = material.rows
    with_gas = flown[~rows.is_control[flown]]
    x0, y0, x1, y1 = room.box_m
    plan = room.plan
    size = f"{x1 - x0:.3g} by {y1 - y0:.3g} m"
    facts = [
        ("scenario", str(rows["scenario"][flown[0]])),
        ("family", str(rows["family"][flown[0]])),
        ("varied", _describe_varied(str(rows["varied"][flown[0]]))),
        ("room", size if plan is None else f"{size}; the plan is at {plan.height_m:.3g} m height"),
        ("source", _places(rows.columns, flown, "source", list(plan.sources_m) if plan else [])),
        ("start", _places(rows.columns, flown, "start", [])),
        ("time limit", _range(rows["time_limit_s"][flown], "s")),
        ("success", f"{_words(rows['success_of'][flown])} within {_range(rows['within_m'][flown], 'm')}"),
        ("sensors", _words(rows["sensors"][flown], ", or ").replace("+", " and ")),
        ("robots", _range(rows["n_robots"][flown], "")),
        ("gas", _describe_gas(plan)),
        ("wind", _describe_wind(plan, rows["wind_settled"][flown], rows["wind_uncertainty_frac"][flown])),
        ("flights", _describe_flights(material, flown)),
    ]
    if grade is not None and with_gas.size:
        facts += [
            ("difficulty", f"{grade.grade}, {grade.difficulty.value:+.1f} logit" if grade.grade else ""),
            ("shortest way", "" if math.isnan(grade.shortest_m) else f"{grade.shortest_m:.3g} m"),
            ("met gas", _percent(grade.contact, "of all flights")),
        ]
    return [(what, how) for what, how in facts if how]


def _describe_varied(text: str) -> str:
    values = parse_json(text or "{}", JsonObject, place="trials: varied")
    return ", ".join(f"{_brief(key)} {json.dumps(value, ensure_ascii=False)}" for key, value in values.items())


# agents[0].vehicle.start_m: what precedes the first agent's settings is the same in all.
def _brief(key: str) -> str:
    return key.removeprefix("agents[0].")


def _places(columns: Mapping[str, Floats], flown: Ints, what: str, known_m: Sequence[Sequence[float]]) -> str:
    places_m = np.stack([columns[f"{what}_{axis}_m"][flown] for axis in "xyz"], axis=1)
    places_m = np.unique(np.round(places_m[np.isfinite(places_m).all(axis=1)], 2), axis=0)
    if len(known_m) > len(places_m):
        places_m = np.array(known_m)
    if len(places_m) > 4:
        return f"{len(places_m)} places"
    return "; ".join(f"({x:g}, {y:g}, {z:g}) m" for x, y, z in places_m.tolist())


def _range(values: Floats, unit: str) -> str:
    known = sorted({float(value) for value in values.tolist() if math.isfinite(value)})
    if not known:
        return ""
    text = " to ".join(dict.fromkeys(f"{value:g}" for value in (known[0], known[-1])))
    return f"{text} {unit}".strip()


def _words(values: Floats, between: str = ", ") -> str:
    return between.join(dict.fromkeys(str(value) for value in values.tolist() if value))


def _percent(estimate: Estimate, of: str) -> str:
    return "" if math.isnan(estimate.value) else f"{format_percent(estimate.value)} % {of}"


def _describe_gas(plan: EnvironmentMap | None) -> str:
    if plan is None or plan.mean_gas_ppm is None:
        return ""
    air = ~plan.occupied
    text = f"up to {format_three_digits(float(np.nanmax(plan.mean_gas_ppm, initial=0.0)))} ppm on average"
    if plan.intermittency is not None and air.any():
        text += f"; {format_percent(float((plan.intermittency[air] > 0).mean()))} % of the plan ever has some"
    return text


def _describe_wind(plan: EnvironmentMap | None, settled: Floats, uncertainty: Floats) -> str:
    parts: list[str] = []
    if plan is not None and plan.wind_toward is not None:
        toward = plan.wind_toward[~plan.occupied]
        x, y = toward.mean(axis=0).tolist() if toward.size else (0.0, 0.0)
        agreement = math.hypot(x, y)
        name = _WINDS[round(math.atan2(y, x) / (0.25 * math.pi)) % 8]
        parts.append(f"mostly towards {name}" if agreement >= _ONE_DIRECTION else "in no one direction")
    known = {bool(value) for value in settled.tolist() if math.isfinite(value)}
    parts += ["settled" if known == {True} else "not settled"] if known else []
    unsure = uncertainty[np.isfinite(uncertainty)]
    parts += [f"its mean is uncertain by {format_percent(float(unsure.max()))} % at least"] if unsure.size else []
    return "; ".join(parts)


def _describe_flights(material: ReportData, flown: Ints) -> str:
    rows = material.rows
    n_controls = int(rows.is_control[flown].sum())
    n_plumes = len(set(rows["gas_seed"][flown].tolist()))
    text = f"{len(flown) - n_controls} with gas, of {n_plumes} plume{'s' if n_plumes != 1 else ''}"
    return text + (f"; {n_controls} without gas" if n_controls else "")


def describe_methods(
    analysis: Analysis,
    cases: Sequence[CaseFacts],
    files: Mapping[str, str],
    *,
    cards: Mapping[str, MethodCard],
    keys: Mapping[str, str | None],
) -> tuple[MethodFacts, ...]:
    """Return the facts of all entries.

    Args:
        cards: Cards by the hash of the program that they lie beside.
        keys: Fingerprint of the key that has signed the results of each entry; None where nobody has.
    """
    standings = {row.entry: row for row in analysis.everything.standings}
    found: list[MethodFacts] = []
    for i, entry in enumerate(analysis.material.entries):
        card = cards.get(entry.agent_hash)
        rows = analysis.material.rows
        own = [replace(group, rows=group.rows[rows.entry[group.rows] == i]) for group in analysis.failures]
        found.append(
            MethodFacts(
                entry=i,
                file=files[entry.name],
                summary=card.summary if card else "",
                facts=tuple(_method_facts(analysis, i, card, keys.get(entry.name))),
                parameters=tuple(_parameters(entry, card)),
                row=standings.get(i),
                factors=tuple(_factors(analysis, i)),
                cases=tuple((case, each) for case in cases for each in case.entries if each.entry == i),
                failures=tuple(replace(group, by_entry=((i, group.rows.size),)) for group in own if group.rows.size),
            )
        )
    return tuple(found)


def _method_facts(analysis: Analysis, entry: int, card: MethodCard | None, key: str | None) -> list[tuple[str, str]]:
    material = analysis.material
    listed, rows = material.entries[entry], material.rows
    flown = np.flatnonzero(rows.entry == entry)
    facts = [
        ("method", listed.title),
        ("family", listed.family or (card.family if card else "")),
        ("anchor", _ANCHORS.get(listed.anchor, "")),
        ("paper", card.paper if card else ""),
        ("needs", _describe_needs(card) if card else ""),
        ("declares", ("yes" if card.declares else "no") if card else ""),
        ("holds a belief", ("yes" if card.believes else "no") if card else ""),
        ("language", listed.language),
        ("knows beside its sensors", listed.knows or "nothing"),
        ("sensors", _words(rows["sensors"][flown], ", or ").replace("+", " and ")),
        ("robots", _range(rows["n_robots"][flown], "")),
        ("submission", listed.submission),
        ("signed", f"with the key {key}" if key else "no"),
        ("verified", _describe_verification(material, listed.is_verified)),
        ("sandbox", _words(rows["sandbox"][flown], "; ")),
        ("program", listed.agent_hash),
    ]  # fmt: skip
    return [(what, how) for what, how in facts if how]


def _describe_needs(card: MethodCard) -> str:
    parts = [f"{n} {kind}" for kind, n in card.needs.sensors.items()]
    parts += [f"the {what}" for what in card.needs.knows] + (["a radio"] if card.needs.radio else [])
    return ", ".join(parts) or "no sensor"


def _describe_verification(material: ReportData, is_verified: bool | None) -> str:  # noqa: FBT001 - as it is kept
    if is_verified is None:
        return describe_mark(material.mark)
    return "a sample of its submission was flown again here and came out the same" if is_verified else "no"


def _parameters(entry: ReportEntry, card: MethodCard | None) -> list[ParameterSetting]:
    known = card.parameters if card else {}
    found = [
        ParameterSetting(
            name=name,
            value=_text(entry.parameters.get(name, parameter.default)),
            unit="" if parameter.unit == "1" else parameter.unit,
            meaning=parameter.meaning,
            origin=parameter.origin,
            is_default=name not in entry.parameters,
        )
        for name, parameter in known.items()
    ]
    return found + [
        ParameterSetting(name=name, value=_text(value), unit="", meaning="", origin="", is_default=False)
        for name, value in entry.parameters.items()
        if name not in known
    ]


def _text(value: object) -> str:
    if isinstance(value, float):
        return f"{value:g}"
    return value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)


def _factors(analysis: Analysis, entry: int) -> list[tuple[str, tuple[FactorLevel, ...]]]:
    found: list[tuple[str, tuple[FactorLevel, ...]]] = []
    by_axis: dict[str, list[FactorLevel]] = {}
    for level in analysis.levels:
        if level.entry == entry:
            label = f"{level.level} (core)" if level.is_core else level.level
            each = FactorLevel(label=label, success=level.success, difference=level.difference)
            by_axis.setdefault(level.axis, []).append(each)
    found += [(axis, tuple(levels)) for axis, levels in by_axis.items()]
    for kind in ("family", "scenario"):
        views = [(view, row) for view in analysis.views if view.kind == kind for row in view.standings]
        levels = tuple(
            FactorLevel(label=view.label, success=row.success, score=row.score, time_s=row.time_s)
            for view, row in views
            if row.entry == entry
        )
        found += [(kind, levels)] if levels else []
    rows = analysis.material.rows
    flown = np.flatnonzero((rows.entry == entry) & ~rows.is_control)
    by_value: dict[str, dict[str, list[int]]] = {}
    for row in flown.tolist():
        values = parse_json(str(rows["varied"][row]) or "{}", JsonObject, place="trials: varied")
        labels = select_labels(values)
        for key, value in values.items():
            if key in labels:
                continue
            by_value.setdefault(key, {}).setdefault(json.dumps(value, ensure_ascii=False), []).append(row)
    for key, values in by_value.items():
        if 1 < len(values) <= _MAX_VALUES:
            chosen = ((value, np.array(some)) for value, some in values.items())
            levels = [
                FactorLevel(label=value, success=rate_over_units(rows["success"][some], sampling_units(rows, some)))
                for value, some in chosen
            ]
            found.append((_brief(key), tuple(levels)))
    return found
