"""`gslcosim bench place`: the place of one method in the table of a suite, from some of its flights."""

import argparse
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gslcosim.base.errors import ExitCode
from gslcosim.cli.arguments import Command, build_number_parser, parse_positive_number, parse_whole_number
from gslcosim.cli.progress import ProgressLine
from gslcosim.cli.terminal import add_json_option, table, write, write_json, write_note
from gslcosim_bench.commands.study_output import RESULTS_DIR
from gslcosim_bench.commands.suite_output import format_progress
from gslcosim_bench.commands.workers import (
    add_worker_arguments,
    add_yes_option,
    check_sandbox_here,
    choose_loader,
    confirm_put_aside,
    start_pool,
)

if TYPE_CHECKING:
    from gslcosim_bench.execution.runner import Progress
    from gslcosim_bench.statistics.racing import PlaceEstimate
    from gslcosim_bench.studies.placement import Placement

_REASONS = {
    "places": "few enough places are left",
    "budget": "the budget is spent",
    "minutes": "the time is over",
    "suite": "the whole suite is flown",
}


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("suite", metavar="SUITE", help="a suite file with the entry, or the name of a bundled suite")
    parser.add_argument("--entry", required=True, metavar="NAME", help="the entry of SUITE whose place is asked for")
    parser.add_argument(
        "--against",
        required=True,
        type=Path,
        metavar="RESULTS",
        help="results folder with the other entries' rows of the same cases",
    )
    parser.add_argument(
        "--places",
        type=parse_positive_number,
        default=3,
        metavar="N",
        help="stop when at most N places are possible (default: 3)",
    )
    parser.add_argument(
        "--budget",
        type=parse_positive_number,
        metavar="N",
        help="fly at most N runs (default: 15 %% of those of the suite)",
    )
    parser.add_argument(
        "--minutes",
        type=build_number_parser("minutes above 0", lambda value: value > 0),
        metavar="M",
        help="begin no batch after M minutes (default: no limit)",
    )
    parser.add_argument(
        "--batch",
        type=parse_positive_number,
        metavar="N",
        help="runs that are drawn at a time (default: 4)",
    )
    parser.add_argument("--seed", type=parse_whole_number, metavar="N", help="replace the seed of the suite")
    parser.set_defaults(load_suite=None)
    add_worker_arguments(parser)
    parser.add_argument(
        "--results", type=Path, metavar="DIR", help="results folder (default: results/NAME of the suite)"
    )
    add_yes_option(parser)
    add_json_option(parser)


def _run(arguments: argparse.Namespace) -> int:
    from gslcosim_bench.results import Results
    from gslcosim_bench.statistics.racing import BATCH
    from gslcosim_bench.store import ResultsFolder
    from gslcosim_bench.studies.placement import StopRule, find_opponents, fly_placement, plan_placement
    from gslcosim_bench.studies.runner import StudyHost

    began_s = time.monotonic()
    loaded = choose_loader(arguments)(arguments.suite, seed=arguments.seed, is_flown=True)
    with ProgressLine("planning", is_quiet=arguments.json) as line:
        plan, flights = plan_placement(loaded, arguments.entry, lambda n: line.count(n, 0))
    opponents = find_opponents(plan, flights, Results.load(arguments.against))
    check_sandbox_here(arguments, plan)
    if opponents.is_other_software:
        write_note(f"{arguments.against}: flown by another version of gslcosim; its rows may differ from today's.")
    limit_s = None if arguments.minutes is None else 60.0 * arguments.minutes
    folder = arguments.results or RESULTS_DIR / loaded.suite.name
    with ProgressLine(f"place of {arguments.entry}", is_quiet=arguments.json) as line:

        def show(progress: "Progress") -> None:
            fraction = progress.done / progress.total if progress.total else None
            line.show(f"this batch: {format_progress(progress)}", fraction=fraction)

        try:
            placement = fly_placement(
                plan,
                flights,
                opponents,
                ResultsFolder(folder),
                StudyHost(
                    start_pool=lambda: start_pool(arguments, loaded.suite.limits),
                    confirm_put_aside=confirm_put_aside(arguments),
                    report=show,
                ),
                StopRule(
                    places=arguments.places,
                    budget=arguments.budget,
                    is_over=lambda: limit_s is not None and time.monotonic() - began_s >= limit_s,
                ),
                batch=arguments.batch or BATCH,
                tell=lambda estimate: line.note(_format_estimate(estimate, len(opponents.names) + 1)),
            )
        except KeyboardInterrupt:
            line.end()
            write_note("Interrupted. Repeat the command to resume.")
            return ExitCode.INTERRUPTED
    if arguments.json:
        write_json(_to_json(placement))
    else:
        write(_format(placement))
    return ExitCode.AGENT_FAILED if placement.n_without_result else 0


def _to_json(placement: "Placement") -> dict[str, Any]:
    from dataclasses import asdict

    return {
        "entry": placement.entry,
        **asdict(placement.estimates[-1]),
        "entries": len(placement.table) + 1,
        "flights_of_suite": placement.n_flights,
        "flown_now": placement.n_flown_now,
        "without_result": placement.n_without_result,
        "stopped_by": placement.stopped_by,
        "table": placement.table,
        "left_out": placement.opponents.left_out,
        "is_other_software": placement.opponents.is_other_software,
        "estimates": [asdict(estimate) for estimate in placement.estimates],
        "folder": str(placement.folder),
    }


def _format_estimate(estimate: "PlaceEstimate", n_entries: int) -> str:
    return (
        f"{_count(estimate.n_flown)}: place {estimate.place} ({estimate.first} to {estimate.last}) of {n_entries}, "
        f"score {estimate.score:.2f} ({estimate.low:.2f} to {estimate.high:.2f})"
    )


def _count(n: int) -> str:
    return "1 run" if n == 1 else f"{n} runs"


# The table of all, with the new entry where its expected score puts it.
def _format(placement: "Placement") -> str:
    last = placement.estimates[-1]
    scores = sorted(((score, name) for name, score in placement.table.items()), key=lambda each: (-each[0], each[1]))
    rows = [(str(1 + sum(s > score for s, _ in scores)), name, f"{score:.3f}") for score, name in scores]
    rows.insert(
        last.place - 1,
        (f"{last.first}-{last.last}", placement.entry, f"{last.score:.3f} ({last.low:.3f} to {last.high:.3f})"),
    )
    lines = [
        table(("PLACE", "ENTRY", "SCORE OF THE WHOLE SUITE"), rows),
        f"After {last.n_flown} of {placement.n_flights} runs the place of {placement.entry} is {last.place}; between "
        f"{last.first} and {last.last} at 95 %, however often it was looked at. Stopped because "
        f"{_REASONS[placement.stopped_by]}.",
    ]
    if placement.opponents.left_out:
        listed = ", ".join(f"{name} ({n})" for name, n in placement.opponents.left_out.items())
        lines.append(f"Left out, because they have not flown all {placement.n_flights} runs: {listed}.")
    if placement.n_without_result:
        lines.append(f"{placement.n_without_result} runs without result count as failures.")
    lines.append(
        f"Results: {placement.folder}, {_count(placement.n_flown_now)} of this call. The cases were drawn unevenly, so "
        "a report of these rows alone is no place; bench run with the same folder flies the rest."
    )
    return "\n".join(lines)


COMMAND = Command(
    name="place",
    summary="place one method in the table of a suite from some of its runs; repeat to resume",
    examples="  gslcosim bench place my_suite.yaml --entry mine --against results/open_2026\n"
    "  gslcosim bench place my_suite.yaml --entry mine --against results/open_2026 --places 1 --budget 60\n"
    "  gslcosim bench place open_2026 --entry casting --against results/open_2026 --minutes 20 --json",
    add_arguments=_add_arguments,
    run=_run,
)
