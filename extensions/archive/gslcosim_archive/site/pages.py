"""Pages of a site as text and bytes: the table, a page for each method and each case, plans, and data of the player."""

import math
import shlex
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any
from urllib.parse import quote

import jinja2
import numpy as np
from markupsafe import Markup

from gslcosim.environment.plan_view import space_arrows
from gslcosim.methods.card import MethodCard
from gslcosim_archive.site.facts import CaseFacts, MethodFacts, describe_cases, describe_methods
from gslcosim_archive.site.file_names import assign_file_names
from gslcosim_archive.site.tracks import GAS_DECADES, TrackFormat, choose_format, encode_gas
from gslcosim_bench.report.analysis import Analysis
from gslcosim_bench.report.page import (
    FOLDER,
    MOST_LISTED,
    LineStyle,
    assign_line_styles,
    build_page_environment,
    build_page_values,
    describe_entry,
    describe_room,
    make_breakable,
    read_page_file,
    to_plain,
    to_script_json,
)
from gslcosim_bench.report.plans import PlanDrawing
from gslcosim_bench.report.report_data import EnvironmentMap, ReportEntry
from gslcosim_bench.report.tables import build_leaderboard_json, describe_provenance
from gslcosim_bench.report.tracks import QUANTA, AgentTrack, read_tracks

METHODS, CASES, PLANS, TRACKS = "methods", "cases", "plans", "tracks"
"""Folders of a site."""

PAGE_FOLDER = Path(__file__).parent / "page"
_WIND_PER_SIDE = 14
_MAX_FAMILY_LINES = 100
_SAME_PLACE_M = 0.05
_MIN_LETTERS = 8
_WITHOUT_GAS = "-without-gas"
_CONTROL, _SUCCESS, _NO_RESULT = 1, 2, 4


@dataclass(frozen=True, kw_only=True)
class SiteData:
    """All that a site is made of.

    Attributes:
        analysis: Figures of the report.
        cards: Cards by the hash of the program that they lie beside.
        recordings: Of each trial with a recording, the folder of it.
        keys: Of each entry, the fingerprint of the key that has signed its results; None where nobody has.
    """

    analysis: Analysis
    cards: Mapping[str, MethodCard]
    recordings: Mapping[str, Path]
    keys: Mapping[str, str | None]


@dataclass(frozen=True, kw_only=True)
class _Site:
    data: SiteData
    looks: Sequence[LineStyle]
    order: Sequence[int]
    case_files: Mapping[str, str]
    method_files: Mapping[str, str]
    cases: Sequence[CaseFacts]
    methods: Sequence[MethodFacts]
    n_letters: int

    def trial_id(self, row: int) -> str:
        """Return the beginning of a trial's id that no other trial has."""
        return str(self.data.analysis.material.rows["trial"][row])[: self.n_letters]


def build_site(data: SiteData) -> Iterator[tuple[str, bytes]]:
    """Yield the path below the site's folder, and the content, of each file."""
    analysis = data.analysis
    material = analysis.material
    case_files = assign_file_names(material.rows["case"].tolist())
    method_files = assign_file_names(entry.name for entry in material.entries)
    cases = describe_cases(analysis, case_files)
    site = _Site(
        data=data,
        looks=assign_line_styles(analysis),
        order=[row.entry for row in analysis.everything.standings],
        case_files=case_files,
        method_files=method_files,
        cases=cases,
        methods=describe_methods(analysis, cases, method_files, cards=data.cards, keys=data.keys),
        n_letters=_count_letters(material.rows["trial"].tolist()),
    )
    for path, text in (*_shared_files(site), *_pages(site), *_track_files(site)):
        yield path, text.encode()
    for room in analysis.rooms:
        if room.picture is not None:
            yield f"{PLANS}/{_plan_file(site, room)}.png", room.picture.to_png()
            if any(_own_source(site, room, row) for row in room.rows.tolist()):
                yield f"{PLANS}/{_plan_file(site, room)}{_WITHOUT_GAS}.png", room.picture.to_png(with_gas=False)


# With as many letters no two ids begin alike.
def _count_letters(trials: Sequence[str]) -> int:
    longest = max(map(len, trials), default=0)
    lengths = range(_MIN_LETTERS, longest)
    return next((n for n in lengths if len({trial[:n] for trial in trials}) == len(trials)), longest)


def _shared_files(site: _Site) -> Iterator[tuple[str, str]]:
    yield "site.css", read_page_file("report.css") + (PAGE_FOLDER / "site.css").read_text(encoding="utf-8")
    yield "pieces.js", read_page_file("pieces.js")
    yield "report.js", read_page_file("report.js")
    yield "flights.js", (PAGE_FOLDER / "flights.js").read_text(encoding="utf-8")
    yield "leaderboard.json", build_leaderboard_json(_first_page(site.data.analysis))


def _pages(site: _Site) -> Iterator[tuple[str, str]]:
    analysis, entries = site.data.analysis, site.data.analysis.material.entries
    first = _environment(site, "").get_template("index.html")
    yield (
        "index.html",
        first.render(
            **(build_page_values(_first_page(analysis)) | {"cases": site.cases}),
            columns_of_grid=site.order,
            cells_of=lambda case: {each.entry: each for each in case.entries},
            files=site.method_files,
        ),
    )
    inner = _environment(site, "../")
    inner.globals["sorts"] = False
    common = {
        "title": describe_provenance(analysis).title,
        "entries": entries,
        "looks": site.looks,
        "files": site.method_files,
    }
    template = inner.get_template("case.html")
    for before, case, after in _with_neighbours(site.cases):
        has_wind = bool(_wind_strokes(case.room.plan))
        yield (
            f"{CASES}/{case.file}.html",
            template.render(**common, case=case, before=before, after=after, has_wind=has_wind),
        )
    template = inner.get_template("method.html")
    ordered = [*site.order, *(i for i in range(len(entries)) if i not in site.order)]
    for before, i, after in _with_neighbours(ordered):
        around = (None if j is None else (entries[j].name, site.method_files[entries[j].name]) for j in (before, after))
        yield f"{METHODS}/{site.method_files[entries[i].name]}.html", template.render(
            **common, **dict(zip(("before", "after"), around, strict=True)), analysis=analysis, entry=entries[i],
            method=site.methods[i], look=site.looks[i], most_listed=MOST_LISTED,
        )  # fmt: skip


# What is of one method or one case is on its own page, and figures of families only where entries are few.
def _first_page(analysis: Analysis) -> Analysis:
    families = [view for view in analysis.views if view.kind == "family"]
    is_small = len(analysis.material.entries) * len(families) <= _MAX_FAMILY_LINES
    views = (analysis.everything, *(families if is_small else ()))
    return replace(analysis, views=views, rooms=(), starts=(), tracks=(), failures=())


def _environment(site: _Site, root: str) -> jinja2.Environment:
    environment = build_page_environment(
        [PAGE_FOLDER, FOLDER],
        entry_name=partial(_link_with_seal, site, root),
        case_name=partial(_link_of_case, site, root),
    )
    environment.globals["entry_link"] = partial(_link_of_entry, site, root)
    return environment


def _link_of_entry(site: _Site, root: str, entry: ReportEntry) -> Markup:
    file = site.method_files[entry.name]
    return Markup('<a href="{}{}/{}.html">{}</a>').format(root, METHODS, file, make_breakable(entry.name))


# In tables of figures only: elsewhere a name alone is enough.
def _link_with_seal(site: _Site, root: str, entry: ReportEntry) -> Markup:
    key = site.data.keys.get(entry.name)
    seal = Markup(' <span class="seal" title="signed with the key {}">signed</span>').format(key) if key else ""
    return _link_of_entry(site, root, entry) + seal


def _link_of_case(site: _Site, root: str, case: str, trial: str = "") -> Markup:
    place = f"#{quote(trial[: site.n_letters], safe='')}" if trial else ""
    return Markup('<a href="{}{}/{}.html{}">{}</a>').format(root, CASES, site.case_files[case], place, case)


def _outcome(site: _Site, row: int) -> str:
    rows = site.data.analysis.material.rows
    if rows["status"][row] != "flown":
        return str(rows["status"][row])
    off_m = float(rows["declared_error_m"][row])
    if rows["outcome"][row] == "declared" and not rows["success"][row] and math.isfinite(off_m):
        return f"declared {off_m:.2g} m off"
    return str(rows["outcome"][row]) or "ended"


def _with_neighbours(items: Sequence[Any]) -> Iterator[tuple[Any, Any, Any]]:
    yield from zip([None, *items[:-1]], items, [*items[1:], None], strict=True)


def _track_files(site: _Site) -> Iterator[tuple[str, str]]:
    tracks = read_tracks(site.data.analysis.material, with_gas=True)
    form = choose_format(tracks)
    for case in site.cases:
        rows = [row for each in case.entries for row in (*each.rows.tolist(), *each.controls.tolist())]
        text = to_script_json(_case_data(site, case, rows, tracks, form))
        yield f"{TRACKS}/{case.file}.js", f'flights("{case.file}", {text});\n'


def _case_data(
    site: _Site, case: CaseFacts, flown: Collection[int], tracks: Mapping[int, Sequence[AgentTrack]], form: TrackFormat
) -> dict[str, Any]:
    room = case.room
    full_ppm = max((float(agent.gas_ppm.max()) for row in flown for agent in tracks.get(row, ())), default=0.0)
    outcomes = list(dict.fromkeys(_outcome(site, row) for row in flown))
    return {
        "name": case.name,
        "room": describe_room(room),
        "plan": None if room.picture is None else _plan_file(site, room),
        "plan_without_gas": None if room.picture is None else _plan_file(site, room) + _WITHOUT_GAS,
        "wind": _wind_strokes(room.plan),
        "quanta": QUANTA,
        "full_ppm": to_plain(full_ppm),
        "decades": GAS_DECADES,
        "methods": [_describe_method(site, each.entry) for each in case.entries],
        "outcomes": outcomes,
        "flights": [_flight(site, case, row, tracks.get(row, ()), form, full_ppm, outcomes) for row in flown],
    }


def _describe_method(site: _Site, i: int) -> dict[str, Any]:
    material = site.data.analysis.material
    return describe_entry(material, i, site.looks[i]) | {"file": site.method_files[material.entries[i].name]}


def _flight(
    site: _Site,
    case: CaseFacts,
    row: int,
    team: Sequence[AgentTrack],
    form: TrackFormat,
    full_ppm: float,
    outcomes: Sequence[str],
) -> list[Any]:
    rows = site.data.analysis.material.rows
    trial, repetition, end_s = str(rows["trial"][row]), int(rows["repetition"][row]), float(rows["end_s"][row])
    is_kept = repetition % form.every == 0
    last_s = max((float(agent.t_s[-1]) for agent in team), default=0.0)
    end_s = end_s if math.isfinite(end_s) else last_s
    flags = (
        _CONTROL * bool(rows.is_control[row])
        + _SUCCESS * bool(rows["success"][row])
        + _NO_RESULT * (rows["status"][row] != "flown")
    )
    recording = site.data.recordings.get(trial)
    own = _own_source(site, case.room, row)
    method = next(k for k, each in enumerate(case.entries) if each.entry == rows.entry[row])
    return [
        site.trial_id(row), method, repetition, int(flags), outcomes.index(_outcome(site, row)),
        to_plain(end_s), to_plain(float(rows.time_s[row])),
        to_plain(float(rows["nearest_m"][row])),
        [agent.pack(form.tolerance_m) for agent in team] if is_kept else [],
        encode_gas(team, end_s, full_ppm),
        "" if recording is None else f"gslcosim view {shlex.quote(str(recording))}",
        *([own] if own else []),
    ]  # fmt: skip


# Where a repetition draws its source anew, the map's gas and sources are those of another one.
def _own_source(site: _Site, room: PlanDrawing, row: int) -> list[float]:
    rows = site.data.analysis.material.rows
    own_m = [float(rows[f"source_{axis}_m"][row]) for axis in "xy"]
    is_mapped = any(math.dist(own_m, source_m) < _SAME_PLACE_M for source_m in room.sources_m)
    return [] if is_mapped or not all(map(math.isfinite, own_m)) else [round(x, 2) for x in own_m]


# Cases of one room share its plan, so it has the name of the first.
def _plan_file(site: _Site, room: PlanDrawing) -> str:
    rows = site.data.analysis.material.rows
    return site.case_files[str(rows["case"][room.rows[0]])]


def _wind_strokes(plan: EnvironmentMap | None) -> list[list[float]]:
    if plan is None or plan.wind_toward is None:
        return []
    toward = plan.wind_toward
    is_blowing = ~plan.occupied & np.isfinite(toward).all(axis=-1) & (np.hypot(toward[..., 0], toward[..., 1]) > 0.0)
    cells, _ = space_arrows(is_blowing, _WIND_PER_SIDE)
    places_m = np.array(plan.origin_m) + (cells + 0.5) * plan.cell_m
    return np.round(np.concatenate([places_m, toward[tuple(cells.T)]], axis=1), 2).tolist()
