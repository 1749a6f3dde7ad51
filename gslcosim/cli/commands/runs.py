"""`gslcosim runs`: the runs of folders as a table; those that meet conditions; removed, or made whole."""

import argparse
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from gslcosim.base.errors import MachineError, UsageError
from gslcosim.cli.arguments import Command, parse_positive_number
from gslcosim.cli.run_paths import RECORDING, RUNS_DIR
from gslcosim.cli.run_table import COLUMNS, NUMBERS, SHORT_NAMES, TEXTS, collect_rows
from gslcosim.cli.terminal import (
    add_json_option,
    clear_status_line,
    draw_status_line,
    table,
    write,
    write_json,
    write_note,
)
from gslcosim.data.row_filters import Condition, sorted_rows

EXAMPLES = """  gslcosim runs
  gslcosim runs runs results/smoke --where outcome=collision --where 'time<60' --sort -time
  gslcosim runs --where 'scenario=gsl_bench_*' --limit 10 --json
  gslcosim runs remove --where outcome!=success --where 'age>24'
  gslcosim runs repair runs/tiny_room-seed7-20250101T120000-a1b2c3"""

_SHOWN = ("run", "scenario", "method", "seed", "outcome", "time_s", "speed", "faults", "size_mb", "age_h")
_HEADINGS = ("run", "scenario", "method", "seed", "outcome", "time", "speed", "faults", "size", "age")
_ACTIONS = ("remove", "repair")
# What has no result and was written to so lately may be run by another user, or on another host.
_QUIET_H = 10 / 60
_UNITS = ((1 / 60, 3600, "s"), (1.0, 60, "min"), (48.0, 1, "h"), (float("inf"), 1 / 24, "d"))


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "words",
        nargs="*",
        metavar="FOLDER",
        help="folders of runs, runs, or results of gslcosim bench (default: runs); before them 'remove' to remove "
        "those that --where chooses, or 'repair' to make the recordings of killed runs whole",
    )
    parser.add_argument(
        "--where",
        action="append",
        default=[],
        metavar="CONDITION",
        help="only those with COLUMN=VALUE (or !=, <, <=, >, >=), as often as needed: all have to hold; texts may have "
        "* and ?; columns: " + ", ".join(COLUMNS),
    )
    parser.add_argument(
        "--sort", default="age", metavar="COLUMN", help="sort by a column, -COLUMN: largest first (default: age)"
    )
    parser.add_argument("--limit", type=parse_positive_number, metavar="N", help="show the first N only")
    parser.add_argument("--yes", action="store_true", help="with remove: remove them, not only say which")
    add_json_option(parser)


def _run(arguments: argparse.Namespace) -> int:
    words = list(arguments.words)
    action = words.pop(0) if words and words[0] in _ACTIONS else "list"
    if arguments.yes and action != "remove":
        raise UsageError("gslcosim runs: expected --yes with remove only. See gslcosim runs --help.")
    conditions = [Condition.of(text, numbers=NUMBERS, texts=TEXTS, short=SHORT_NAMES) for text in arguments.where]
    folders = [Path(word) for word in words or [RUNS_DIR]]
    key = arguments.sort.removeprefix("-")
    key = arguments.sort.replace(key, SHORT_NAMES.get(key, key))
    is_terminal = sys.stderr.isatty()
    tell = (lambda n: draw_status_line(f"{n} runs read")) if is_terminal else None
    rows = sorted_rows(collect_rows(folders, tell), key, COLUMNS)
    if is_terminal:
        clear_status_line()
    chosen = [row for row in rows if all(condition.holds(row) for condition in conditions)][: arguments.limit]
    if action == "remove":
        return _remove(chosen, arguments)
    if action == "repair":
        return _repair(chosen, arguments)
    if arguments.json:
        write_json(chosen)
    elif chosen:
        write(table(_HEADINGS, [_cells(row) for row in chosen]))
        if len(chosen) < len(rows):
            write_note(f"{len(chosen)} of {len(rows)}")
    else:
        write(f"No run of {len(rows)} meets that." if rows else "No runs.")
    return 0


def _cells(row: Mapping[str, Any]) -> tuple[str, ...]:
    return tuple(_cell(name, row) for name in _SHOWN)


def _cell(name: str, row: Mapping[str, Any]) -> str:
    value = row[name]
    if name == "outcome":
        return str(value).replace("_", " ") if row["state"] == "ended" else f"{row['state']}: {value}"
    if value in (None, ""):
        return "-"
    if name == "time_s":
        return f"{value:.1f} s"
    if name == "speed":
        return f"{value:.0f} x"
    if name == "size_mb":
        return f"{value:.1f} MB" if value >= 1 else f"{1000 * value:.0f} kB"
    if name == "age_h":
        return format_age(value)
    return str(value)


def format_age(age_h: float) -> str:
    """Return an age [h] in the unit in which people say it."""
    factor, unit = next((factor, unit) for below_h, factor, unit in _UNITS if age_h < below_h)
    return f"{age_h * factor:.0f} {unit}"


def _remove(rows: Sequence[Mapping[str, Any]], arguments: argparse.Namespace) -> int:
    if not arguments.where:
        raise UsageError(
            "gslcosim runs remove: expected --where, which says what to remove, for example --where outcome!=success."
        )
    removable = [row for row in rows if not _why_kept(row)]
    kept = [{"run": row["run"], "folder": row["folder"], "why": why} for row in rows if (why := _why_kept(row))]
    size_mb = sum(row["size_mb"] or 0.0 for row in removable)
    if arguments.yes:
        for row in removable:
            _remove_folder(Path(row["folder"]))
    if arguments.json:
        write_json({"removed": arguments.yes, "runs": removable, "kept": kept, "size_mb": round(size_mb, 3)})
        return 0
    if removable:
        write(table(_HEADINGS, [_cells(row) for row in removable]))
        write()
    for one in kept:
        write(f"kept       {one['folder']}: {one['why']}")
    runs = "1 run" if len(removable) == 1 else f"{len(removable)} runs"
    verb = "Removed" if arguments.yes else "Would remove"
    write(f"{verb} {runs}, {size_mb:.1f} MB." + ("" if arguments.yes or not removable else " Do it with --yes."))
    return 0


def _why_kept(row: Mapping[str, Any]) -> str:
    if row["state"] == "foreign":
        return "not a run"
    if row["state"] == "running":
        return "it goes on; gslcosim stop ends it"
    if row["size_mb"] is None:
        return f"a trial of results ({row['run']})"
    if row["state"] == "broken" and row["age_h"] < _QUIET_H:
        return "it has no result and was written to in the last 10 minutes: somebody may fly it"
    return ""


# Nothing is followed out of the folder, and a half removed one is no run any more.
def _remove_folder(folder: Path) -> None:
    import shutil

    try:
        shutil.rmtree(folder)
    except OSError as error:
        raise MachineError(f"{folder}: expected a folder that can be removed, was {error.strerror}.") from error


def _repair(rows: Sequence[Mapping[str, Any]], arguments: argparse.Namespace) -> int:
    from gslcosim_services.recorder.repair import repair_recording

    repairs: list[dict[str, Any]] = []
    for row in rows:
        recording = Path(row["folder"]) / RECORDING
        if row["state"] in ("foreign", "running") or row["size_mb"] is None or not recording.is_file():
            continue
        is_repaired = repair_recording(recording)
        repairs.append({"run": row["run"], "folder": row["folder"], "repaired": is_repaired})
        if not arguments.json:
            write(f"{'repaired' if is_repaired else 'was whole':<11}{recording}")
    if arguments.json:
        write_json(repairs)
    elif not repairs:
        write("No recording to make whole.")
    return 0


COMMAND = Command(
    name="runs",
    summary="list the runs of folders: scenario, method, outcome, time, size; filter, sort, remove or repair them",
    examples=EXAMPLES,
    add_arguments=_add_arguments,
    run=_run,
)
