"""`gslcosim reality`: our physics and methods beside measurements."""

import argparse
from pathlib import Path

from gslcosim.base.errors import ExitCode, UsageError
from gslcosim.cli.arguments import Command
from gslcosim.cli.terminal import add_json_option, table, write, write_json

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
    from gslcosim.cli.progress import ProgressLine
    from gslcosim_validation.cases import load_cases
    from gslcosim_validation.page import make_storable, store_result, summarise_goals, terminal_rows, write_page
    from gslcosim_validation.readers.folder import read_measured

    chosen = load_cases(arguments.only)
    data = read_measured(arguments.data)
    cases = [case for case in chosen if case.can_run_on(data)]
    if not cases:
        found = ", ".join(f"{each.name} ({each.format})" for each in data.sets) or "no set"
        needed = "; ".join(f"{case.name}: {', '.join(case.formats) or 'published.json'}" for case in chosen)
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


COMMAND = Command(
    name="reality",
    summary="compare wind, plumes, sensors and estimates with measurements",
    examples=EXAMPLES,
    add_arguments=_add_arguments,
    run=_run,
    is_computing=True,
)
