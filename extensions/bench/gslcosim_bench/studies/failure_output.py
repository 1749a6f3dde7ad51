"""Failures of a method as JSON, Markdown and a page, each with a picture of its room, gas and tracks."""

import base64
import io
import math
import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from PIL import Image, ImageDraw

from gslcosim_bench.cases.models import LOWER_ANCHOR
from gslcosim_bench.report.plans import shade
from gslcosim_bench.report.report_data import parse_map
from gslcosim_bench.report.templates import build_environment
from gslcosim_bench.statistics.estimates import Estimate
from gslcosim_bench.store import ResultsFolder, Tracks, unpack_tracks
from gslcosim_bench.studies.failures import CaseOutcome, Contrast, FailureSearch, RankedFailure
from gslcosim_bench.studies.output import write_text
from gslcosim_data.text_tables import format_markdown_table

FAILURES_SCHEMA = "gslcosim/failures/1"
PICTURES, MARKDOWN, PAGE = "pictures", "failures.md", "failures.html"
_SHOWN = 8
"""Failures in the gallery, and contrasts in the table."""
_CLEAR_P = 0.1
_PICTURE_PX = 360
_FLOOR = (244, 244, 241)
_METHOD, _ORACLE, _SOURCE = (24, 84, 190), (30, 130, 70), (190, 20, 40)
_HEADS = ("factor", "level", "failures", "elsewhere", "p")


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
        "failure_rate": search.failure_rate.to_fields(),
        "factors": [{"name": factor.name, "paths": list(factor.paths)} for factor in search.space.factors],
        "contrasts": [
            {
                "factor": each.factor,
                "level": each.level,
                "failures": each.rate.to_fields(),
                "elsewhere": each.other.to_fields(),
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
    for name in (MARKDOWN, PAGE):
        write_text(folder / name, render_failures(name, search, folder, pictures, films))
    return folder / PAGE


def render_failures(
    name: str, search: FailureSearch, folder: Path, pictures: Mapping[str, bytes], films: Mapping[str, Path]
) -> str:
    """Return the report as `MARKDOWN`, with pictures by relative paths, or as `PAGE`, which needs no file but films.

    Args:
        name: Which of the two.
        pictures: PNG of cases, by the name of the case.
    """
    environment = build_environment([Path(__file__).parent / "page"], is_html=name == PAGE)
    contrasts = [_contrast_cells(each) for each in list_clear_contrasts(search)]
    text = environment.get_template(f"{name}.jinja").render(
        title=f"Failures of {search.entry} in {search.space.name}",
        facts=_facts(search),
        heads=_HEADS,
        contrasts=contrasts,
        table="\n".join(format_markdown_table(_HEADS, contrasts)),
        failures=[_describe_for_page(search, folder, each, pictures, films) for each in search.failures[:_SHOWN]],
        pictures=PICTURES,
    )
    return text.rstrip() + "\n"


def _describe_for_page(
    search: FailureSearch,
    folder: Path,
    each: RankedFailure,
    pictures: Mapping[str, bytes],
    films: Mapping[str, Path],
) -> dict[str, Any]:
    name = each.outcome.case.name
    film = films.get(name)
    return {
        "name": name,
        "severity": f"{each.severity:.2f}",
        "picture": base64.b64encode(pictures.get(name, b"")).decode(),
        "text": f"It {describe_failure(each)}",
        "levels": describe_levels(search, each.outcome),
        "command": build_fly_command(folder, each.outcome),
        "film": film and film.relative_to(folder),
        "film_name": film and film.name,
    }


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


def _draw(listed: Mapping[str, Any], tracks: Mapping[str, Tracks]) -> bytes:
    room = parse_map(listed)
    plan = shade(room).draw().convert("RGBA")
    scale = max(1, round(_PICTURE_PX / max(plan.size)))
    plan = plan.resize((plan.width * scale, plan.height * scale), Image.Resampling.NEAREST)
    image = Image.new("RGB", plan.size, _FLOOR)
    image.paste(plan, mask=plan)
    draw = ImageDraw.Draw(image)
    px_m = image.width / (room.occupied.shape[0] * room.cell_m)

    def place(x_m: float, y_m: float) -> tuple[float, float]:
        return (x_m - room.origin_m[0]) * px_m, image.height - (y_m - room.origin_m[1]) * px_m

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
    for source_m in room.sources_m:
        x, y = place(*source_m[:2])
        draw.ellipse((x - 7, y - 7, x + 7, y + 7), outline=_SOURCE, width=3)
    file = io.BytesIO()
    image.quantize(48, dither=Image.Dither.NONE).save(file, "PNG", optimize=True)
    return file.getvalue()
