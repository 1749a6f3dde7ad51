"""Failures of a method as JSON, Markdown and a page, each with a picture of its room, gas and tracks."""

import base64
import html
import io
import math
import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image, ImageDraw

from gslcosim_bench.cases.models import LOWER_ANCHOR
from gslcosim_bench.statistics.estimates import Estimate
from gslcosim_bench.store import ResultsFolder, Tracks, unpack_tracks
from gslcosim_bench.studies.failures import CaseOutcome, Contrast, FailureSearch, RankedFailure
from gslcosim_bench.studies.output import write_text
from gslcosim_data.text_tables import escape_markdown, format_markdown_table

FAILURES_SCHEMA = "gslcosim/failures/1"
PICTURES = "pictures"
_SHOWN = 8
"""Failures in the gallery, and contrasts in the table."""
_CLEAR_P = 0.1
_PICTURE_PX = 360
_GAS_DECADES = 3.0
_WALL, _FLOOR, _GAS = (88, 92, 98), (244, 244, 241), (196, 92, 20)
_METHOD, _ORACLE, _SOURCE = (24, 84, 190), (30, 130, 70), (190, 20, 40)

Rgb = tuple[int, int, int]


def failures_to_json(search: FailureSearch) -> dict[str, Any]:
    """Return a search for failures as JSON has it: equal for equal calls, whatever the workers and interruptions."""
    return {
        "schema": FAILURES_SCHEMA,
        "entry": search.entry,
        "space": search.space.name,
        "seed": search.seed,
        "budget": search.budget,
        "n_runs": search.n_runs,
        "n_cases": len(search.outcomes),
        "n_random": len(search.random),
        "failure_rate": _interval(search.failure_rate),
        "factors": [{"name": factor.name, "paths": list(factor.paths)} for factor in search.space.factors],
        "contrasts": [
            {
                "factor": each.factor,
                "level": each.level,
                "failures": _interval(each.rate),
                "elsewhere": _interval(each.other),
                "p": each.p,
            }
            for each in search.contrasts
        ],
        "failures": [
            {
                "case": each.outcome.case.name,
                "trial": each.outcome.row["trial"],
                "oracle_trial": (each.outcome.oracle or {}).get("trial"),
                "severity": each.severity,
                "outcome": each.outcome.row["outcome"],
                "nearest_m": each.outcome.row["nearest_m"],
                "start_distance_m": each.outcome.distance_m,
                "first_contact_s": each.outcome.row["first_contact_s"],
                "oracle_time_s": (each.outcome.oracle or {}).get("time_s"),
                "levels": describe_levels(search, each.outcome),
                "values": each.outcome.case.values(search.space),
                "seed": each.outcome.case.seed,
                "beside": {"n": each.n_beside, "failed": each.n_beside_failed},
                "again": {"n": each.n_again, "failed": each.n_again_failed},
            }
            for each in search.failures
        ],
    }


def _interval(estimate: Estimate) -> dict[str, float | int]:
    return {"value": estimate.value, "low": estimate.low, "high": estimate.high, "n": estimate.n}


def describe_levels(search: FailureSearch, outcome: CaseOutcome) -> dict[str, str]:
    """Return what a case has of each factor, in words."""
    pairs = zip(search.space.factors, outcome.case.levels, strict=True)
    return {factor.name: factor.describe(level) for factor, level in pairs}


def build_fly_command(folder: Path, outcome: CaseOutcome) -> str:
    """Return the command that flies a case again, checks that it is the same, and opens its recording."""
    return f"gslcosim bench show {shlex.quote(str(folder))} --trial {outcome.row['trial'][:10]}"


def describe_failure(each: RankedFailure) -> str:
    """Return in a sentence what a method did in one of the worst cases."""
    row, oracle = each.outcome.row, each.outcome.oracle
    gas = "never met gas" if row["first_contact_s"] is None else f"met gas after {row['first_contact_s']:.0f} s"
    text = (
        f"{gas}, came within {row['nearest_m']:.1f} m of the source from {each.outcome.distance_m:.1f} m and ended "
        f"with {str(row['outcome']).replace('_', ' ')}"
    )
    if oracle is not None:
        text += f"; the oracle took {oracle['time_s']:.0f} s"
    if each.n_again:
        text += f"; with other seeds it failed in {each.n_again_failed} of {each.n_again} runs"
    if each.n_beside:
        text += f"; {each.n_beside_failed} of {each.n_beside} cases beside it are failures too"
    return text + "."


def list_clear_contrasts(search: FailureSearch) -> list[Contrast]:
    """Return the contrasts worth a look: the clearest of those with a small p, more failures than elsewhere first."""
    clear = [each for each in search.contrasts if each.p < _CLEAR_P]
    return sorted(clear[: 2 * _SHOWN], key=lambda each: (each.rate.value <= each.other.value, each.p))[:_SHOWN]


def describe_common(search: FailureSearch) -> str:
    """Return in a sentence what failures have in common."""
    clear = [each for each in list_clear_contrasts(search) if each.rate.value > each.other.value]
    if not clear:
        return "No level of a factor has clearly more failures than the others."
    best = clear[0]
    return (
        f"Failures are most frequent where {best.factor} is {best.level}: {_percent(best.rate)} of {best.rate.n} "
        f"random cases, {_percent(best.other)} of the {best.other.n} others (p {best.p:.2g}, one of "
        f"{len(search.contrasts)} contrasts looked at)."
    )


def _percent(estimate: Estimate) -> str:
    if not estimate.n:
        return "-"
    return f"{100 * estimate.value:.0f} % ({100 * estimate.low:.0f} to {100 * estimate.high:.0f})"


def write_failures(search: FailureSearch, folder: Path, films: Mapping[str, Path]) -> Path:
    """Write `failures.md`, `failures.html` and the pictures of a search into its folder; return the page.

    Args:
        folder: The folder with its rows, tracks and maps.
        films: Films of cases, by the name of the case.
    """
    (folder / PICTURES).mkdir(exist_ok=True)
    pictures = draw_failures(folder, [each.outcome for each in search.failures[:_SHOWN]])
    for name, picture in pictures.items():
        (folder / PICTURES / f"{name}.png").write_bytes(picture)
    write_text(folder / "failures.md", build_markdown(search, folder, films))
    page = folder / "failures.html"
    write_text(page, build_page(search, folder, pictures, films))
    return page


def build_markdown(search: FailureSearch, folder: Path, films: Mapping[str, Path]) -> str:
    """Return the report as Markdown, with pictures by relative paths."""
    entry, space = escape_markdown(search.entry), escape_markdown(search.space.name)
    lines = [f"# Failures of {entry} in {space}", "", *map(escape_markdown, _facts(search)), ""]
    if contrasts := list_clear_contrasts(search):
        heads = ("factor", "level", "failures", "elsewhere", "p")
        table = format_markdown_table(heads, map(_contrast_cells, contrasts))
        lines += ["## What failures have in common", "", *table, ""]
    if search.failures:
        lines += ["## The worst cases", ""]
    for i, each in enumerate(search.failures[:_SHOWN], 1):
        name = each.outcome.case.name
        lines += [f"### {i}. {name}, severity {each.severity:.2f}", ""]
        lines += [f"![{name}]({PICTURES}/{name}.png)", "", escape_markdown(f"It {describe_failure(each)}"), ""]
        levels = describe_levels(search, each.outcome).items()
        lines += [f"- {escape_markdown(f'{factor}: {level}')}" for factor, level in levels]
        lines += ["", "```sh", build_fly_command(folder, each.outcome), "```", ""]
        if name in films:
            lines += [f"Film: [{films[name].name}]({films[name].relative_to(folder)})", ""]
    return "\n".join(lines).rstrip() + "\n"


def _facts(search: FailureSearch) -> list[str]:
    n_failed = sum(each.is_failure for each in search.outcomes)
    return [
        f"A failure is a case in which {search.entry} does not find the source and the oracle does.",
        f"Of {len(search.random)} random cases {_percent(search.failure_rate)} are failures; with those beside them "
        f"and with other seeds {n_failed} of {len(search.outcomes)}, in {search.n_runs} runs (seed {search.seed}).",
        describe_common(search),
    ]


def _contrast_cells(each: Contrast) -> list[str]:
    return [each.factor, each.level, _percent(each.rate), _percent(each.other), f"{each.p:.2g}"]


_CSS = """
:root { color-scheme: light dark; font: 16px/1.5 system-ui, sans-serif; }
body { max-width: 72rem; margin: 2rem auto; padding: 0 1rem; }
table { border-collapse: collapse; } th, td { text-align: left; padding: .25rem 1rem .25rem 0; }
.scroll { overflow-x: auto; }
.gallery { display: grid; grid-template-columns: repeat(auto-fill, minmax(20rem, 1fr)); gap: 2rem; }
figure { margin: 0; } img { max-width: 100%; background: #fff; } code { overflow-wrap: anywhere; }
dl { display: grid; grid-template-columns: auto 1fr; gap: 0 1rem; margin: .5rem 0; } dd { margin: 0; }
"""


def build_page(search: FailureSearch, folder: Path, pictures: Mapping[str, bytes], films: Mapping[str, Path]) -> str:
    """Return the report as a page that needs no other file but films."""
    title = html.escape(f"Failures of {search.entry} in {search.space.name}")
    parts = [f"<h1>{title}</h1>", *(f"<p>{html.escape(fact)}</p>" for fact in _facts(search))]
    if contrasts := list_clear_contrasts(search):
        heads = "".join(f"<th scope=col>{head}</th>" for head in ("factor", "level", "failures", "elsewhere", "p"))
        rows = "".join(
            f"<tr>{''.join(f'<td>{html.escape(cell)}</td>' for cell in _contrast_cells(each))}</tr>"
            for each in contrasts
        )
        parts.append(
            "<h2>What failures have in common</h2>"
            f"<div class=scroll tabindex=0><table><tr>{heads}</tr>{rows}</table></div>"
            "<p>Among random cases, with 95 % intervals; p of Fisher's exact test, not corrected for their number.</p>"
        )
    if search.failures:
        parts.append(f"<h2>The worst cases</h2><p>{html.escape(LEGEND)}</p><div class=gallery>")
        parts += [
            _figure(search, folder, i, each, pictures, films) for i, each in enumerate(search.failures[:_SHOWN], 1)
        ]
        parts.append("</div>")
    return (
        f"<!doctype html><html lang=en><head><meta charset=utf-8><meta name=viewport content='width=device-width'>"
        f"<title>{title}</title><style>{_CSS}</style></head><body><main>{''.join(parts)}</main></body></html>\n"
    )


LEGEND = (
    "From above: grey is solid at the search height, brown the mean gas there, blue the method from its start "
    "(square), green the oracle, the red ring the source."
)


def _figure(
    search: FailureSearch,
    folder: Path,
    i: int,
    each: RankedFailure,
    pictures: Mapping[str, bytes],
    films: Mapping[str, Path],
) -> str:
    name = each.outcome.case.name
    data = base64.b64encode(pictures[name]).decode() if name in pictures else ""
    levels = "".join(
        f"<dt>{html.escape(factor)}</dt><dd>{html.escape(level)}</dd>"
        for factor, level in describe_levels(search, each.outcome).items()
    )
    text = f"It {describe_failure(each)}"
    image = (
        f"<img alt='{html.escape(f'{name} from above: {text}')}' src='data:image/png;base64,{data}'>" if data else ""
    )
    film = f"<p><a href='{html.escape(str(films[name].relative_to(folder)))}'>Film</a></p>" if name in films else ""
    command = html.escape(build_fly_command(folder, each.outcome))
    return (
        f"<figure><h3>{i}. {html.escape(name)}, severity {each.severity:.2f}</h3>{image}"
        f"<figcaption><p>{html.escape(text)}</p><dl>{levels}</dl>{film}<code>{command}</code></figcaption></figure>"
    )


def draw_failures(folder: Path, outcomes: Sequence[CaseOutcome]) -> dict[str, bytes]:
    """Return a picture of each case as PNG, by its name; none of a case without a map.

    Args:
        folder: Folder with the maps and tracks of its runs.
    """
    results = ResultsFolder(folder)
    maps = {each["scenario"]: each for each in results.read_json(results.maps).get("maps", [])}
    entries = results.entries()
    pictures: dict[str, bytes] = {}
    for each in outcomes:
        rows = [row for row in (each.oracle, each.row) if row is not None]
        packed = {row["entry"]: entries[row["trial"]].tracks for row in rows if row["trial"] in entries}
        tracks = {entry: unpack_tracks(payload) for entry, payload in packed.items() if payload is not None}
        if each.case.name in maps:
            pictures[each.case.name] = _draw(maps[each.case.name], tracks)
    return pictures


def _draw(room: Mapping[str, Any], tracks: Mapping[str, Tracks]) -> bytes:
    shape = tuple(room["shape"])
    occupied = np.frombuffer(base64.b64decode(room["occupied"]), np.uint8).reshape(shape).astype(bool)
    gas_ppm = np.frombuffer(base64.b64decode(room["mean_gas_ppm"]), "<f4").reshape(shape)
    # A logarithmic scale of three decades below the highest mean.
    top = float(gas_ppm.max()) or 1.0
    share = np.clip(1.0 + np.log10(np.maximum(gas_ppm / top, 1e-12)) / _GAS_DECADES, 0.0, 1.0)[..., None]
    pixels = (1.0 - 0.75 * share) * np.array(_FLOOR) + 0.75 * share * np.array(_GAS)
    pixels[occupied] = _WALL
    scale = max(1, round(_PICTURE_PX / max(shape)))
    image = Image.fromarray(np.flipud(pixels.swapaxes(0, 1)).astype(np.uint8), "RGB")
    image = image.resize((shape[0] * scale, shape[1] * scale), Image.Resampling.NEAREST)
    draw = ImageDraw.Draw(image)
    px_m = scale / room["cell_m"]

    def place(x_m: float, y_m: float) -> tuple[float, float]:
        return (x_m - room["origin_m"][0]) * px_m, image.height - (y_m - room["origin_m"][1]) * px_m

    for entry, agents in tracks.items():
        color = _ORACLE if entry == LOWER_ANCHOR else _METHOD
        for series in agents.values():
            points = [place(float(x), float(y)) for x, y in zip(series["x_m"], series["y_m"], strict=True)]
            points = [point for point in points if all(map(math.isfinite, point))]
            if len(points) > 1:
                draw.line(points, fill=color, width=2, joint="curve")
            if points and color is _METHOD:
                x, y = points[0]
                draw.rectangle((x - 4, y - 4, x + 4, y + 4), fill=color)
    for source_m in room["sources_m"]:
        x, y = place(*source_m[:2])
        draw.ellipse((x - 7, y - 7, x + 7, y + 7), outline=_SOURCE, width=3)
    file = io.BytesIO()
    image.quantize(48, dither=Image.Dither.NONE).save(file, "PNG", optimize=True)
    return file.getvalue()
