"""Page of the suite: figures of each entry on each log with intervals, releases, and a timeline of events."""

import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from gslcosim.base.errors import build_machine_error
from gslcosim_bench.cases.models import LOWER_ANCHOR
from gslcosim_bench.statistics.estimates import UNDEFINED, Estimate
from gslcosim_bench.statistics.rates import wilson
from gslcosim_data.figures.style import new_figure, styled
from gslcosim_data.text_tables import escape_markdown, format_markdown_table
from gslcosim_validation.measured_suite.estimators import Claim, is_room
from gslcosim_validation.results import median_estimate

if TYPE_CHECKING:
    from gslcosim_validation.measured_suite.run import LogResult

PAGE = "measured.md"
HEADINGS = (
    "log", "entry", "touched", "exact", "partly", "false events", "unsure", "delay [min]", "overlap",
    "place error [m]", "rate / true rate",
)  # fmt: skip
_HOUR_S = 3600.0
_DOTS_PER_INCH = 130


def compute_figures(result: "LogResult") -> dict[str, Any]:
    """Return the figures of an entry on a log: counts as shares with Wilson's interval, medians with a bootstrap."""
    scored = result.score.releases
    n = len(scored)
    touched = [each for each in scored if each.is_touched]
    return {
        "log": result.case.name,
        "entry": result.entry,
        "fault": result.fault,
        "n_releases": n,
        "n_events": len(result.score.claims),
        "n_false_events": len(result.score.false_claims),
        "n_unsure_events": sum(claim.is_unsure for claim in result.score.claims),
        "n_rates_at_most": sum(claim.is_upper_bound for claim in result.score.claims),
        "touched": wilson(len(touched), n),
        "exact": wilson(sum(each.is_exact for each in scored), n),
        "partly": wilson(sum(each.is_partly for each in scored), n),
        "delay_s": median_estimate([each.delay_s for each in touched]),
        "overlap_frac": median_estimate([each.overlap_frac for each in scored]),
        "place_error_m": median_estimate([each.place_error_m for each in touched]),
        "rate_ratio": median_estimate([each.rate_ratio for each in touched]),
    }


def to_json(figures: dict[str, Any]) -> dict[str, Any]:
    """Return figures as JSON has them: `{"value", "low", "high", "n"}`, null for what is undefined."""
    return {key: each.to_fields() if isinstance(each, Estimate) else each for key, each in figures.items()}


def table_rows(results: Sequence["LogResult"]) -> list[tuple[str, ...]]:
    """Return the rows of the table; the truth itself is left out."""
    rows = []
    for result in results:
        if result.entry == LOWER_ANCHOR:
            continue
        f = compute_figures(result)
        n_false = "" if is_room(result.case.site) else str(f["n_false_events"])
        says = any(math.isfinite(claim.confidence) for claim in result.score.claims)
        n_unsure = f"{f['n_unsure_events']} of {f['n_events']}" if says else ""
        counts = [_count(f[key]) for key in ("touched", "exact", "partly")]
        delay = f["delay_s"] if result.case.site.finds_events else UNDEFINED
        minutes = Estimate(delay.value / 60.0, delay.low / 60.0, delay.high / 60.0, delay.n)
        medians = [_figure(each) for each in (minutes, f["overlap_frac"], f["place_error_m"], f["rate_ratio"])]
        rows.append((f["log"], f["entry"], *counts, n_false, n_unsure, *medians))
    return rows


def _count(share: Estimate) -> str:
    if not share.n:
        return ""
    return f"{round(share.value * share.n)} of {share.n} [{share.low * share.n:.1f}, {share.high * share.n:.1f}]"


def _figure(estimate: Estimate) -> str:
    if not math.isfinite(estimate.value):
        return ""
    ends = f" [{estimate.low:.2g}, {estimate.high:.2g}]" if math.isfinite(estimate.low) else ""
    return f"{estimate.value:.3g}{ends}"


def write_page(folder: Path, results: Sequence["LogResult"]) -> Path:
    """Write `measured.md` with its timelines, `measured.json` and `events.json`; return the page."""
    from gslcosim_validation.measured_suite.run import describe_events

    lines = [
        "# Search on measured air",
        "",
        "Counts have Wilson's 95 % intervals, medians those of a bootstrap over releases.",
        "`report.html` has the leaderboard and paired comparisons.",
        "",
        *format_markdown_table(HEADINGS, table_rows(results)),
    ]
    by_log: dict[str, list[LogResult]] = {}
    for result in results:
        by_log.setdefault(result.case.name, []).append(result)
    try:
        for name, some in by_log.items():
            lines += ["", f"## {escape_markdown(name)}"]
            lines += [
                line
                for result in some
                if result.fault
                for line in ("", escape_markdown(f"{result.entry} failed: {result.fault}"))
            ]
            if some[0].case.site.finds_events:
                _draw_timeline(some, folder / f"timeline-{name}.png")
                lines += ["", f"![Events and releases of {escape_markdown(name)} over time](timeline-{name}.png)"]
            lines += ["", *format_markdown_table(*_release_table(some))]
        (folder / "measured.json").write_text(
            _json_text([to_json(compute_figures(result)) for result in results]), "utf-8"
        )
        (folder / "events.json").write_text(_json_text(describe_events(results)), "utf-8")
        page = folder / PAGE
        page.write_text("\n".join(lines) + "\n", "utf-8")
    except OSError as error:
        raise build_machine_error(error, str(folder), "a folder that can be written") from error
    return page


def _json_text(content: Any) -> str:
    return json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def _release_table(some: Sequence["LogResult"]) -> tuple[list[str], list[list[str]]]:
    shown = [result for result in some if result.entry != LOWER_ANCHOR]
    headings = ["release", "true place", "duration [min]", "rate [kg/h]", *(result.entry for result in shown)]
    rows: list[list[str]] = []
    for i, release in enumerate(some[0].case.releases):
        place = release.place or ("" if math.isnan(release.position_m[0]) else _position(release.position_m))
        facts = [f"{(release.end_s - release.start_s) / 60.0:.0f}", _rate(release.rate_kg_s)]
        rows.append([release.name, place, *facts, *(_describe_claims(result, i) for result in shown)])
    return headings, rows


def _rate(rate_kg_s: float) -> str:
    return f"{rate_kg_s * _HOUR_S:.3g}" if math.isfinite(rate_kg_s) else ""


def _position(position_m: Any) -> str:
    return f"{float(position_m[0]):.1f}, {float(position_m[1]):.1f}"


def _describe_claims(result: "LogResult", i: int) -> str:
    scored = result.score.releases[i]
    parts = [scored.outcome]
    names = [
        claim.place or ("" if claim.position_m is None else _position(claim.position_m)) for claim in scored.claims
    ]
    if names := [name for name in dict.fromkeys(names) if name]:
        parts.append("; ".join(names))
    parts += dict.fromkeys(_describe_doubt(claim) for claim in scored.claims if claim.is_unsure)
    if math.isfinite(scored.rate_ratio):
        parts.append(f"{'at most ' if scored.is_upper_bound else ''}{scored.rate_ratio:.2f} of the rate")
    return ", ".join([": ".join(parts[:2]), *parts[2:]])


def _describe_doubt(claim: Claim) -> str:
    if claim.runner_up is None or not math.isfinite(claim.margin):
        return "unsure"
    other = claim.runner_up if isinstance(claim.runner_up, str) else _position(claim.runner_up)
    return f"unsure (next {other}, margin {claim.margin:.2g})"


# The upper lane has the truth, each other an entry; colours are places where there is a choice.
def _draw_timeline(some: Sequence["LogResult"], path: Path) -> None:
    log, places = some[0].case.log, list(some[0].case.site.places_m)
    begin_s = float(log.start_s[0])
    lanes: list[tuple[str, list[tuple[float, float, str | None]]]] = [
        (result.entry, [(claim.start_s, claim.end_s + 60.0, claim.place) for claim in result.score.claims])
        for result in some
        if result.entry != LOWER_ANCHOR
    ]
    lanes.append(("releases", [(each.start_s, each.end_s, each.place) for each in some[0].case.releases]))
    with styled():
        figure = new_figure(2, 0.22 + 0.06 * len(lanes))
        above, below = figure.subplots(2, 1, sharex=True, height_ratios=[1.2, 0.5 * len(lanes)])
        readings = np.where(np.isfinite(log.readings_ppm), log.readings_ppm, -np.inf).max(axis=1)
        hours = (log.start_s - begin_s) / _HOUR_S
        above.semilogy(hours, np.where(readings > 0.0, readings, np.nan), lw=0.4, color="0.3")
        above.set(ylabel="largest\nreading [ppm]")
        for lane, (_, spans) in enumerate(lanes):
            for start_s, end_s, place in spans:
                color = f"C{places.index(place)}" if place in places else "0.4"
                ends = [(start_s - begin_s) / _HOUR_S, (end_s - begin_s) / _HOUR_S]
                below.plot(ends, [lane, lane], color=color, lw=5, solid_capstyle="butt")
        for start_s, end_s, _ in lanes[-1][1]:
            for axes in (above, below):
                axes.axvspan((start_s - begin_s) / _HOUR_S, (end_s - begin_s) / _HOUR_S, color="0.9", lw=0)
        for number, place in enumerate(places):
            below.plot([], [], color=f"C{number}", lw=5, label=place)
        if places:
            figure.legend(loc="outside lower center", ncols=len(places), fontsize=6)
        below.set(yticks=range(len(lanes)), yticklabels=[name for name, _ in lanes], ylim=(-0.6, len(lanes) - 0.4))
        below.set(xlabel="hours since the log began; grey: releases")
        figure.savefig(path, dpi=_DOTS_PER_INCH, metadata={"Software": None})
