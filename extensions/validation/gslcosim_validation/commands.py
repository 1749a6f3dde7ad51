"""`gslcosim reality`, our physics and methods beside measurements; and the suite `measured` of `gslcosim bench`."""

import argparse
import os
from pathlib import Path

from gslcosim.base.errors import ExitCode, UsageError
from gslcosim.cli.arguments import Command, CommandGroup
from gslcosim.cli.progress import ProgressLine
from gslcosim.cli.terminal import add_json_option, table, write, write_json
from gslcosim_bench.commands.suites import RESULTS_DIR
from gslcosim_bench.suite_kinds import SuiteKind

# The suite whose gas is a log: nothing of it is flown.
MEASURED = "measured"

EXAMPLES = """  gslcosim reality --data measured
  gslcosim reality --data measured --only laser-forward --quick
  gslcosim reality --data measured --out docs/studies"""


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--data",
        type=Path,
        required=True,
        metavar="FOLDER",
        help=("folder of measured data: one set, or a folder per set (docs/measured-data.md has the formats)"),
    )
    parser.add_argument(
        "--only",
        action="append",
        default=[],
        metavar="CASE",
        help="run only this case; repeatable (default: all cases with data)",
    )
    parser.add_argument("--quick", action="store_true", help="coarse and fast, for a first look")
    parser.add_argument(
        "--out",
        type=Path,
        metavar="DIR",
        help="write DIR/reality.md with figures; existing results of other cases stay",
    )
    add_json_option(parser)


def _run(arguments: argparse.Namespace) -> int:
    from gslcosim_validation.cases import load_cases
    from gslcosim_validation.page import (
        make_storable,
        read_stored,
        store_result,
        summarise,
        summarise_goals,
        terminal_rows,
        write_page,
    )
    from gslcosim_validation.readers.folder import read_measured

    chosen = load_cases(arguments.only)
    data = read_measured(arguments.data)
    cases = [case for case in chosen if case.can_run_on(data)]
    has_results = arguments.out is not None and any(case.from_pairs for case in chosen)
    if not cases and not has_results:
        found = ", ".join(f"{each.name} ({each.format})" for each in data.sets) or "no set"
        else_needed = {True: "--out with results of others", False: "published.json"}
        needed = "; ".join(f"{case.name}: {', '.join(case.formats) or else_needed[case.from_pairs]}" for case in chosen)
        raise UsageError(f"--data: expected what a case needs ({needed}), found {found}.\nFolder: {arguments.data}")
    data.check({name for case in cases for name in case.formats})
    effort = "quick" if arguments.quick else "full"
    stored = []
    with ProgressLine("reality", is_quiet=arguments.json) as progress:
        for i, case in enumerate(cases):

            def show(text: str, fraction: float | None, i: int = i, name: str = case.name) -> None:
                progress.show(text, fraction=None if fraction is None else (i + fraction) / len(cases), phase=name)

            show("running", 0.0)
            result = case.run(data, effort, show)
            if arguments.out is None:
                stored.append(make_storable(case, effort, result))
            else:
                stored.append(store_result(arguments.out, case, effort, result))
    stored += summarise(stored if arguments.out is None else read_stored(arguments.out), arguments.out)
    page = None if arguments.out is None else write_page(arguments.out)
    if arguments.json:
        write_json(stored)
        return ExitCode.SUCCESS
    headings, rows = terminal_rows(stored)
    write(table(headings, rows))
    write(f"\n{summarise_goals(stored)}")
    if page is not None:
        write(str(page))
    return ExitCode.SUCCESS


def _add_measured_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--data",
        type=Path,
        metavar="FOLDER",
        help="for the suite measured: folder of measured data (default: measured in GSLCOSIM_REFERENCE)",
    )
    parser.add_argument(
        "--agents",
        nargs="+",
        metavar="AGENT",
        help="for the suite measured: agents that replay the logs, too: bundled names, Python files, or suites",
    )


def _run_measured(arguments: argparse.Namespace) -> int:
    from gslcosim_bench.cases.models import Selection
    from gslcosim_bench.store import ResultsFolder
    from gslcosim_validation.measured_suite.page import HEADINGS, compute_figures, table_rows, to_json
    from gslcosim_validation.measured_suite.run import run_measured

    for option in ("seed", "filter", "shard", "jobs", "ray", "retry", "bundle"):
        if getattr(arguments, option) not in (None, False):
            raise UsageError(f"--{option}: expected a suite that is flown, was {MEASURED}. Leave the option out.")
    patterns = Selection.of(arguments.only).patterns
    if others := [key for key, _ in patterns if key != "entry"]:
        raise UsageError(f"--only {others[0]}: expected entry=NAME with the suite {MEASURED}.")
    folder = ResultsFolder(arguments.results or RESULTS_DIR / MEASURED)
    with ProgressLine(MEASURED, is_quiet=arguments.json) as line:
        done = run_measured(
            _measured_data(arguments.data),
            folder,
            only=[name for _, names in patterns for name in names],
            agents=arguments.agents or (),
            has_report=not arguments.no_report,
            progress=lambda text, fraction: line.show(text, fraction=fraction),
        )
    faults = [result for result in done.results if result.fault]
    if arguments.json:
        figures = [to_json(compute_figures(result)) for result in done.results]
        write_json({"folder": str(done.folder), "report": done.report and str(done.report), "figures": figures})
    else:
        write(table(HEADINGS, table_rows(done.results)))
        write("".join(f"\n{each.entry} failed on {each.case.name}: {each.fault}" for each in faults))
        write(f"Results: {done.page}" + (f"\nReport: {done.report}" if done.report else ""))
    return ExitCode.AGENT_FAILED if faults else ExitCode.SUCCESS


def _measured_data(given: Path | None) -> Path:
    if given is not None:
        return given
    reference = os.environ.get("GSLCOSIM_REFERENCE")
    if not reference:
        raise UsageError(
            f"--data: expected a folder of measured data for the suite {MEASURED}, found none. Give --data FOLDER, or "
            "set GSLCOSIM_REFERENCE to a folder that has one called measured; docs/measured-data.md has the formats."
        )
    return Path(reference) / "measured"


MEASURED_SUITE = SuiteKind(
    name=MEASURED,
    title="Search on measured air",
    question="Who finds sources, their places and rates in logs of masts, lasers and rooms? (needs --data)",
    options=("data", "agents"),
    add_arguments=_add_measured_options,
    run=_run_measured,
)
COMMAND = Command(
    name="reality",
    summary="compare wind, plumes, sensors and estimates with measurements",
    examples=EXAMPLES,
    add_arguments=_add_arguments,
    run=_run,
    is_computing=True,
)
GROUPS = (CommandGroup(title="compare methods", commands=(COMMAND,)),)
