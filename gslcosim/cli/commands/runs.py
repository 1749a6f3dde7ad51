"""`gslcosim runs`: the runs in folders as a table, filtered by conditions; removal of runs, repair of recordings."""

import argparse
import dataclasses
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from gslcosim.base.checksums import CHECKSUMS_FILE, write_checksums
from gslcosim.base.errors import MachineError, UsageError, describe_os_error
from gslcosim.base.extensions import RUN_ROWS_GROUP, instance_of, load_registered
from gslcosim.base.files import remove_tree
from gslcosim.cli.arguments import RECORDING, RUNS_DIR, Command, parse_positive_number
from gslcosim.cli.completion_words import find_named
from gslcosim.cli.progress import ProgressLine
from gslcosim.cli.terminal import (
    add_json_option,
    table,
    write,
    write_json,
    write_note,
)
from gslcosim.recordings.run_summary import Condition, RunSummary, is_run_folder, read_run_summary, sorted_rows

COLUMNS = tuple(field.name for field in dataclasses.fields(RunSummary))
TEXTS = ("run", "folder", "state", "outcome", "scenario", "method", "version")
NUMBERS = tuple(name for name in COLUMNS if name not in TEXTS)
# As in the headings of the table.
SHORT_NAMES = {"time": "time_s", "size": "size_mb", "age": "age_h"}
EXAMPLES = """  gslcosim runs
  gslcosim runs runs results/smoke --where outcome=collision --where 'time<60' --sort -time
  gslcosim runs --where 'scenario=gsl_bench_*' --limit 10 --json
  gslcosim runs remove --where outcome!=success --where 'age>24'
  gslcosim runs repair runs/tiny_room-seed7-20250101T120000-a1b2c3"""
_SHOWN = ("run", "scenario", "method", "seed", "outcome", "time_s", "speed", "faults", "size_mb", "age_h")
_HEADINGS = ("run", "scenario", "method", "seed", "outcome", "time", "speed", "faults", "size", "age")
_ACTIONS = ("remove", "repair")
# A run without a result and with a write this recent may belong to another user, or to another host.
_QUIET_H = 10 / 60
_UNITS = ((1 / 60, 3600, "s"), (1.0, 60, "min"), (48.0, 1, "h"), (float("inf"), 1 / 24, "d"))


@dataclasses.dataclass(frozen=True, kw_only=True)
class RowReader:
    """Reader of folders that are no runs and have rows like runs; `is_own` returns whether it can read a folder."""

    is_own: Callable[[Path], bool]
    read: Callable[[Path], Sequence[RunSummary]]


def collect_rows(folders: Sequence[Path], progress: Callable[[int], None] | None = None) -> list[dict[str, Any]]:
    """Return the runs in folders, with the rows of folders that extensions read."""
    facts: list[RunSummary] = []
    readers = tuple(load_registered(RUN_ROWS_GROUP, instance_of(RowReader), "a RowReader"))
    for folder in folders:
        if not folder.is_dir():
            raise UsageError(f"{folder}: expected a folder of runs, found none. Fly one: gslcosim up warehouse_empty")
        if reader := next((reader for reader in readers if reader.is_own(folder)), None):
            facts += reader.read(folder)
            continue
        for path in _folders_in(folder):
            facts.append(_read_row(path))
            if progress is not None and len(facts) % 500 == 0:
                progress(len(facts))
    # Faster than `dataclasses.asdict`, which copies each value.
    rows = [{name: getattr(one, name) for name in COLUMNS} for one in facts]
    if any(row["state"] == "broken" for row in rows):
        _mark_running(rows)
    return rows


def _folders_in(folder: Path) -> list[Path]:
    if is_run_folder(folder):
        return [folder]
    try:
        return sorted(path for path in folder.iterdir() if path.is_dir())
    except OSError as error:
        raise UsageError(
            f"{folder}: expected a folder of runs that can be read, was {describe_os_error(error)}."
        ) from error


# A folder that cannot be read, or has vanished, does not hide the others.
def _read_row(path: Path) -> RunSummary:
    try:
        return read_run_summary(path)
    except OSError as error:
        return RunSummary(run=path.name, folder=str(path), state="foreign", outcome=describe_os_error(error))


# A run without a result may be active.
def _mark_running(rows: Sequence[dict[str, Any]]) -> None:
    from gslcosim.runtime.status import list_active_runs

    flights = {flight.facts["run_dir"]: flight.facts for flight in list_active_runs()}
    for row in rows:
        if row["state"] != "broken":
            continue
        flight = flights.get(str(Path(row["folder"]).resolve()))
        if flight is not None:
            row |= {
                "state": "running",
                "outcome": flight["state"],
                "time_s": flight["sim_time_s"],
                "speed": flight["real_time_factor"],
            }


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "words",
        nargs="*",
        metavar="FOLDER",
        help=(
            "folders of runs, runs, or results of gslcosim bench (default: runs); start with "
            "'remove' to remove those of --where, or with 'repair' to complete the recordings of "
            "killed runs"
        ),
    )
    parser.add_argument(
        "--where",
        action="append",
        default=[],
        metavar="CONDITION",
        help="only runs with COLUMN=VALUE (or !=, <, <=, >, >=); repeatable: all must hold; texts may have "
        "* and ?; columns: " + ", ".join(COLUMNS),
    )
    parser.add_argument(
        "--sort", default="age", metavar="COLUMN", help="sort by a column; -COLUMN for descending order (default: age)"
    )
    parser.add_argument("--limit", type=parse_positive_number, metavar="N", help="show only the first N")
    parser.add_argument("--yes", action="store_true", help="with remove: remove them instead of only listing them")
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
    with ProgressLine(is_quiet=not sys.stderr.isatty()) as line:
        rows = sorted_rows(collect_rows(folders, lambda n: line.show(f"{n} runs read")), key, COLUMNS)
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
    """Return an age [h] in a unit of suitable size."""
    factor, unit = next((factor, unit) for below_h, factor, unit in _UNITS if age_h < below_h)
    return f"{age_h * factor:.0f} {unit}"


def _remove(rows: Sequence[Mapping[str, Any]], arguments: argparse.Namespace) -> int:
    if not arguments.where:
        raise UsageError(
            "gslcosim runs remove: expected --where, which says what to remove, for example --where outcome!=success."
        )
    removable = [row for row in rows if not _find_reason_to_keep(row)]
    kept = [
        {"run": row["run"], "folder": row["folder"], "why": why} for row in rows if (why := _find_reason_to_keep(row))
    ]
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


def _find_reason_to_keep(row: Mapping[str, Any]) -> str:
    if row["state"] == "foreign":
        return "not a run"
    if row["state"] == "running":
        return "it goes on; gslcosim runs stop ends it"
    if row["size_mb"] is None:
        return f"a trial of results ({row['run']})"
    if row["state"] == "broken" and row["age_h"] < _QUIET_H:
        return "it has no result and was written to in the last 10 minutes: somebody may fly it"
    return ""


# Symbolic links out of the folder are not followed, and a half removed run is no longer listed as a run.
def _remove_folder(folder: Path) -> None:
    try:
        remove_tree(folder)
    except OSError as error:
        raise MachineError(f"{folder}: expected a folder that can be removed, was {error.strerror}.") from error


def _repair(rows: Sequence[Mapping[str, Any]], arguments: argparse.Namespace) -> int:
    from gslcosim_services.recorder.rerun_cli import repair_recording

    repairs: list[dict[str, Any]] = []
    for row in rows:
        recording = Path(row["folder"]) / RECORDING
        if row["state"] in ("foreign", "running") or row["size_mb"] is None or not recording.is_file():
            continue
        is_repaired = repair_recording(recording)
        if is_repaired and (recording.parent / CHECKSUMS_FILE).is_file():
            write_checksums(recording.parent, recording.name)
        repairs.append({"run": row["run"], "folder": row["folder"], "repaired": is_repaired})
        if not arguments.json:
            write(f"{'repaired' if is_repaired else 'was whole':<11}{recording}")
    if arguments.json:
        write_json(repairs)
    elif not repairs:
        write("No recording to make whole.")
    return 0


COMMAND = Command(
    name="list",
    summary=("list runs with scenario, method, outcome, time and size; filter, sort, remove or repair them"),
    examples=EXAMPLES,
    add_arguments=_add_arguments,
    completes={"COLUMN": [find_named(lambda: COLUMNS)]},
    run=_run,
)
