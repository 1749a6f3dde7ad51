"""`gslcosim runs active`, `top` and `stop`: active runs."""

import argparse
import contextlib
import sys
import time
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any

from gslcosim.cli.arguments import Command, build_number_parser
from gslcosim.cli.progress import draw_pages
from gslcosim.cli.terminal import add_json_option, drawn_table, plain_text, table, write, write_json, write_note

if TYPE_CHECKING:
    from gslcosim.runtime.status import ActiveRun

ACTIVE_EXAMPLES = """  gslcosim runs active
  gslcosim runs active --json | jq -r '.[].run_id'"""
TOP_EXAMPLES = """  gslcosim runs top             the only active run
  gslcosim runs top warehouse_empty-seed7
  gslcosim runs top --once --json"""
STOP_EXAMPLES = """  gslcosim runs stop            the only active run
  gslcosim runs stop warehouse_empty-seed7
  gslcosim runs stop --all"""
_RUN_HELP = "the id of a run or the beginning of it, or its folder (default: the only active run)"
_NONE = "No run is active."
_HEADINGS = ("participant", "state", "tick", "ticks/s", "busy", "queued", "memory", "resends", "pid", "waits for")


def _add_top_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("run", nargs="?", metavar="RUN", help=_RUN_HELP)
    parser.add_argument("--once", action="store_true", help="observe one interval and end")
    parser.add_argument(
        "--every",
        type=build_number_parser("seconds from 0.1 to 3600", lambda interval_s: 0.1 <= interval_s <= 3600),
        default=1.0,
        metavar="S",
        help="update every S seconds (default: 1)",
    )
    add_json_option(parser)


def _add_stop_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("run", nargs="?", metavar="RUN", help=_RUN_HELP)
    parser.add_argument("--all", action="store_true", help="all active runs of this user")


def _list(arguments: argparse.Namespace) -> int:
    from gslcosim.runtime.status import list_active_runs

    flights = list_active_runs()
    if arguments.json:
        write_json([{**flight.facts, "pid": flight.pid} for flight in flights])
    elif flights:
        headings = ("run", "state", "simulated", "speed", "processes", "pid", "folder")
        write(table(headings, [_build_run_row(flight) for flight in flights]))
    else:
        write(_NONE)
    for flight in flights:
        if flight.facts["state"] == "refused":
            write_note(flight.facts["text"])
    return 0


def _build_run_row(flight: "ActiveRun") -> tuple[str, ...]:
    facts = flight.facts
    processes = facts["processes"] if isinstance(facts["processes"], str) else "in groups"
    return (
        flight.run_id,
        facts["state"],
        f"{facts['sim_time_s']:.1f} of {facts['time_limit_s']:g} s",
        f"{facts['real_time_factor']:.0f} x",
        processes,
        str(flight.pid),
        facts["run_dir"],
    )


def _top(arguments: argparse.Namespace) -> int:
    from gslcosim.runtime.status import find_active_run, query_status

    before = find_active_run(arguments.run)
    is_drawn_again = sys.stdout.isatty() and not arguments.once and not arguments.json
    with _draw_pages() if is_drawn_again else contextlib.nullcontext(_write_page) as show:
        while True:
            time.sleep(arguments.every)
            now = query_status(before.window)
            if now is None:
                break
            rows = participant_rows(before, now)
            if arguments.json:
                write_json({**now.facts, "participants": rows})
            else:
                show(now, rows)
            if arguments.once:
                return 0
            before = now
    write(f"{before.run_id} has ended.\nrun        {before.facts['run_dir']}")
    return 0


# Draws each page in place of the last one, which stays at the end.
@contextlib.contextmanager
def _draw_pages() -> "Iterator[Callable[[ActiveRun, list[dict[str, Any]]], None]]":
    with draw_pages() as draw:

        def draw_page(flight: "ActiveRun", rows: list[dict[str, Any]]) -> None:
            stall = [plain_text(_stall(flight), style="bold red")] if _stall(flight) else []
            draw(plain_text(_head(flight)), *stall, "", drawn_table(_HEADINGS, [_participant_row(row) for row in rows]))

        yield draw_page


def participant_rows(before: "ActiveRun", now: "ActiveRun") -> list[dict[str, Any]]:
    """Return the participants of a run with figures from two observations.

    Beside the fields of an observation, `tick_rate_hz` is the number of ticks finished per second of wall time between
    them, and `busy` the CPU time of the process as a fraction of the time between them; None if unknown.
    """
    then = {participant["name"]: participant for participant in before.facts["participants"]}
    passed_s = max(now.looked_at_s - before.looked_at_s, 1e-9)
    rows: list[dict[str, Any]] = []
    for participant in now.facts["participants"]:
        past = then.get(participant["name"], participant)
        has_cpu = participant["cpu_s"] is not None and past["cpu_s"] is not None
        busy = (participant["cpu_s"] - past["cpu_s"]) / passed_s if has_cpu else None
        rows.append({**participant, "tick_rate_hz": (participant["tick"] - past["tick"]) / passed_s, "busy": busy})
    return rows


def _write_page(flight: "ActiveRun", rows: list[dict[str, Any]]) -> None:
    stall = f"\n\n{_stall(flight)}" if _stall(flight) else ""
    write(f"{_head(flight)}{stall}\n\n{table(_HEADINGS, [_participant_row(row) for row in rows])}")


# A run of an older version has no such field.
def _stall(flight: "ActiveRun") -> str:
    return f"STALLED: {flight.facts['stall']}" if flight.facts.get("stall") else ""


def _head(flight: "ActiveRun") -> str:
    facts = flight.facts
    return (
        f"{flight.run_id}: {facts['state']}{', ' if facts['text'] else ''}{facts['text']}, "
        f"{facts['sim_time_s']:.1f} of {facts['time_limit_s']:g} s simulated, "
        f"{facts['real_time_factor']:.0f} x real time, {facts['wall_s']:.0f} s since its start"
    )


def _participant_row(row: dict[str, Any]) -> tuple[str, ...]:
    busy, memory, pid = row["busy"], row["memory_bytes"], row["pid"]
    return (
        row["name"],
        row["state"],
        str(row["tick"]) if row["tick"] >= 0 else "-",
        f"{row['tick_rate_hz']:.0f}",
        "-" if busy is None else f"{100 * busy:.0f} %",
        str(row["queued_ticks"]),
        "-" if memory is None else f"{memory / 1e6:.0f} MB",
        str(row["n_resends"]),
        "-" if pid is None else str(pid),
        ", ".join(row["waits_for"]),
    )


def _stop(arguments: argparse.Namespace) -> int:
    from gslcosim.base.errors import UsageError
    from gslcosim.runtime.status import find_active_run, list_active_runs, stop_run

    if arguments.all and arguments.run is not None:
        raise UsageError("gslcosim runs stop: expected RUN or --all, was both.")
    flights = list_active_runs() if arguments.all else [find_active_run(arguments.run)]
    for flight in flights:
        stop_run(flight)
        write(f"stopped    {flight.facts['run_dir']}")
    if not flights:
        write(_NONE)
    return 0


ACTIVE = Command(
    name="active",
    old_name="ps",
    summary="list active runs",
    examples=ACTIVE_EXAMPLES,
    add_arguments=add_json_option,
    run=_list,
)
TOP = Command(
    name="top",
    old_name="top",
    summary="show the participants of an active run: tick, rate, load, memory, and who waits for whom",
    examples=TOP_EXAMPLES,
    add_arguments=_add_top_arguments,
    run=_top,
)
STOP = Command(
    name="stop",
    old_name="stop",
    summary="end an active run in order, like Ctrl-C",
    examples=STOP_EXAMPLES,
    add_arguments=_add_stop_arguments,
    run=_stop,
)
