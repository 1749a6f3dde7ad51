"""Page of `make reality`: stored results of cases, and the Markdown that shows them."""

import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import NotRequired, TypedDict

from gslcosim.base.errors import build_path_error
from gslcosim.base.untrusted_input import read_json
from gslcosim_data.figures.style import new_figure, styled
from gslcosim_data.text_tables import Markdown, format_markdown_table
from gslcosim_validation.cases import load_case, read_cases
from gslcosim_validation.expected_errors import FILE, ExpectedErrors
from gslcosim_validation.held_out_errors import LEVEL, compute_expected_errors, hold_out
from gslcosim_validation.release_pairs import ReleasePairs
from gslcosim_validation.results import Case, CaseResult, Comparison, Effort

PAGE = "reality.md"
RESULTS = "reality"
_HEADINGS = ("set", "quantity", "anchor", "ours [95 % interval]", "goal", "met")
# Of images on the page; figures for papers have more.
_PAGE_DOTS_PER_INCH = 110
_COUNTING = (
    "What is counted changed in November 2026, when 52 of 95 goals were met, and with it the share:",
    "",
    "- Models without eddies, gas that drives nothing and walls that cut gas off stay by name, for the sake of GADEN, "
    "GSL-Bench and published work, and no setting can save them. Their 23 goals, 21 of them missed, are gone; their "
    "figures stand as anchors.",
    "- Five rows of filaments with turbulence, each at the distance at which it was farthest from what is published, "
    "4 of them missed, are 25, one for each figure and distance: one bad distance no longer hides four good ones, and "
    "each counts.",
    "- Goals that were wrong are gone, each with its reason in its section: durations of blanks where a plume has no "
    "pauses (i below 1), and three of METEC's, all missed, above a background that noise lifts.",
    "- Six goals are new: the variance of eddies in four shears, the fall of the mean on a plume's axis, and the "
    "coverage of intervals on sets that were held out.",
)


class StoredRow(TypedDict):
    """A row of the table, as it is stored; None in place of nan."""

    measured_set: str
    quantity: str
    value: float | None
    low: float | None
    high: float | None
    n: int
    unit: str
    anchor: str
    goal: str
    is_met: bool | None
    if_missed: str


class StoredDrawing(TypedDict):
    """A figure's file beside the results, and its caption."""

    file: str
    caption: str


class StoredResult(TypedDict):
    """A result of a case, as it is stored."""

    case: str
    effort: str
    rows: list[StoredRow]
    drawings: list[StoredDrawing]
    remarks: list[str]
    pairs: NotRequired[list[ReleasePairs]]


def make_storable(case: Case, effort: Effort, result: CaseResult) -> StoredResult:
    """Return a result in the form of files and of `--json`, without its drawings."""
    stored = StoredResult(
        case=case.name,
        effort=effort,
        rows=[_storable_row(row) for row in result.rows],
        drawings=[],
        remarks=list(result.remarks),
    )
    if result.pairs:
        stored["pairs"] = list(result.pairs)
    return stored


def _storable_row(row: Comparison) -> StoredRow:
    ends = (None if math.isnan(x) else float(x) for x in (row.ours.value, row.ours.low, row.ours.high))
    value, low, high = ends
    return StoredRow(
        measured_set=row.measured_set,
        quantity=row.quantity,
        value=value,
        low=low,
        high=high,
        n=row.ours.n,
        unit=row.unit,
        anchor=row.anchor,
        goal=row.goal.text if row.goal else "",
        is_met=row.is_met,
        if_missed=row.if_missed,
    )


def store_result(folder: Path, case: Case, effort: Effort, result: CaseResult) -> StoredResult:
    """Write a result and its figures below a folder, and return it."""
    place = folder / RESULTS
    stored = make_storable(case, effort, result)
    try:
        place.mkdir(parents=True, exist_ok=True)
        for drawing in result.drawings:
            file = f"{case.name}-{drawing.name}.png"
            with styled():
                figure = new_figure(2, drawing.aspect)
                drawing.draw(figure)
                figure.savefig(place / file, dpi=_PAGE_DOTS_PER_INCH, metadata={"Software": None})
            stored["drawings"].append(StoredDrawing(file=file, caption=drawing.caption))
        _write_json(place / f"{case.name}.json", stored)
    except OSError as error:
        raise build_path_error(error, "--out", "a folder that can be written", path=place) from error
    return stored


def _write_json(path: Path, content: object) -> None:
    path.write_text(f"{json.dumps(content, indent=1, ensure_ascii=False)}\n", encoding="utf-8")


def read_stored(folder: Path) -> list[StoredResult]:
    """Return all results that are stored below a folder, in the order of the page."""
    paths = (folder / RESULTS / f"{name}.json" for name in read_cases())
    return [read_json(path, StoredResult) for path in paths if path.is_file()]


def summarise(stored: Sequence[StoredResult], folder: Path | None = None) -> list[StoredResult]:
    """Return the results of cases that are made of those of all others; none from too few sets.

    Args:
        stored: Results of the others.
        folder: Below which they are stored, beside the errors that a run may have as the package has them; None: not.
    """
    pairs = [each for result in stored for each in result.get("pairs", ())]
    if not any(hold_out(pairs)):
        return []
    effort: Effort = "full" if all(result["effort"] == "full" for result in stored) else "quick"
    results = [(case, case.summarise(pairs)) for case in read_cases().values() if case.from_pairs]
    if folder is None:
        return [make_storable(case, effort, result) for case, result in results]
    found = [store_result(folder, case, effort, result) for case, result in results]
    errors = ExpectedErrors(level=LEVEL, kinds_of_air=compute_expected_errors(pairs))
    _write_json(folder / RESULTS / FILE, errors)
    return found


def write_page(folder: Path) -> Path:
    """Write the page of all results that are stored below a folder, and return its path."""
    stored = read_stored(folder)
    path = folder / PAGE
    try:
        path.write_text(render_page(stored), encoding="utf-8")
    except OSError as error:
        raise build_path_error(error, "--out", "a folder that can be written", path=path) from error
    return path


def render_page(stored: Sequence[StoredResult]) -> str:
    """Return the page: one table of all, then a section for each case with its figures and its misses."""
    rows = [row for result in stored for row in result["rows"]]
    lines = [
        "# Beside measurements",
        "",
        "<!-- Written by `make reality`; change the cases in extensions/validation, not this page. -->",
        "",
        "How near our wind, plumes, sensors and estimates come to what was measured, with every miss.",
        "The measured data is not part of gslcosim; [measured-data.md](../measured-data.md) says what it is, how it is "
        "read, and how to run the same on data of your own:",
        "",
        "```bash",
        "gslcosim reality --data FOLDER",
        "```",
        "",
        "Every constant comes from a source that its code names, or was fitted on a part of the data that the section "
        "names; nothing is tuned to one case.",
        "Intervals are 95 % bootstrap intervals over blocks that share their weather; figures of one deterministic run "
        "have none.",
        "",
        f"**{summarise_goals(stored)}**",
        "",
        *_COUNTING,
        "",
        *format_markdown_table(_HEADINGS, [_cells(row) for row in rows]),
    ]
    for result in stored:
        lines += _section(result)
    return "\n".join(lines) + "\n"


def summarise_goals(stored: Sequence[StoredResult]) -> str:
    """Return how many goals are met; those of figures that are undefined are neither met nor missed."""
    judged = [row["is_met"] for result in stored for row in result["rows"] if row["goal"]]
    n_undefined = judged.count(None)
    undefined = f" {n_undefined} {'has' if n_undefined == 1 else 'have'} an undefined figure." if n_undefined else ""
    return f"{judged.count(True)} of {len(judged) - n_undefined} goals are met.{undefined}"


def _section(result: StoredResult) -> list[str]:
    case = load_case(result["case"])
    lines = ["", f"## {case.title}", "", case.what]
    if result["effort"] != "full":
        lines += ["", "Made with `--quick`: coarser than it should be."]
    for remark in result["remarks"]:
        lines += ["", remark]
    for drawing in result["drawings"]:
        lines += ["", f"![{drawing['caption']}]({RESULTS}/{drawing['file']})", "", f"*{drawing['caption']}*"]
    # Goals that are missed for the same reason share a paragraph.
    missed: dict[str, list[str]] = {}
    for row in result["rows"]:
        if row["is_met"] is False:
            goal = f"**{row['measured_set']}, {row['quantity']}** ({format_ours(row)}, goal {row['goal']})"
            missed.setdefault(row["if_missed"] or "No reason is known yet.", []).append(goal)
    for reason, goals in missed.items():
        goals[0] = f"**Missed: {goals[0].removeprefix('**')}"
        lines += ["", f"{'; '.join(goals)}. {reason}"]
    return lines


def _cells(row: StoredRow) -> tuple[str, ...]:
    met = {True: "yes", False: Markdown("**no**"), None: "undefined" if row["goal"] else ""}[row["is_met"]]
    return row["measured_set"], row["quantity"], row["anchor"], format_ours(row), row["goal"], met


def format_ours(row: StoredRow) -> str:
    """Return our figure with interval and unit, for tables."""
    if row["value"] is None:
        return "undefined"
    text = _number(row["value"])
    if row["low"] is not None and row["high"] is not None:
        text += f" [{_number(row['low'])}, {_number(row['high'])}]"
    return f"{text} {row['unit']}".rstrip()


def _number(value: float) -> str:
    if value.is_integer() and abs(value) < 1e6:
        return f"{value:.0f}"
    return f"{value:.3g}"


def terminal_rows(stored: Sequence[StoredResult]) -> tuple[Sequence[str], list[Sequence[str]]]:
    """Return headings and rows of the table for a terminal."""
    rows = [_cells(row) for result in stored for row in result["rows"]]
    return _HEADINGS, [[cell.replace("**", "") for cell in row] for row in rows]
