"""`gslcosim sweep`: a method with several values of its parameters, and its response curve."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from gslcosim.cli.parsing import Command, at_least_one, whole_number
from gslcosim.cli.terminal import add_json_option, write, write_json, write_note
from gslcosim.cli.tuning_text import RESULTS_DIR, add_what, start_pool, sweep_text
from gslcosim.errors import ExitCode

if TYPE_CHECKING:
    from gslcosim.benchmark.tuning.sweeping import Sweep

EXAMPLES = """  gslcosim sweep tiny_room --entry dung_beetle --vary leg_m=0.4,0.8,1.6
  gslcosim sweep smoke --entry dung_beetle --vary leg_m=0.4,0.8 --vary zigzag_rad=0.5,1.0 --repetitions 5
  gslcosim sweep my_suite.yaml --entry surge_cast --vary growth=growing,fixed,doubling --results results/growth"""


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    add_what(parser)
    parser.add_argument(
        "--vary",
        action="append",
        required=True,
        metavar="PARAMETER=VALUES",
        help="values of a parameter, for example step_m=0.2,0.5,1.0; as often as needed: all combinations are flown",
    )
    parser.add_argument(
        "--repetitions",
        type=at_least_one,
        metavar="N",
        help="flights of each case and setting (default: the suite's; 10 for a scenario)",
    )
    parser.add_argument("--seed", type=whole_number, metavar="N", help="replace the suite's seed")
    add_json_option(parser)


def _run(arguments: argparse.Namespace) -> int:
    from gslcosim.benchmark.execution.running import Run
    from gslcosim.benchmark.execution.selection import Selection
    from gslcosim.benchmark.store.folder import ResultsFolder
    from gslcosim.benchmark.suite import plan_of
    from gslcosim.benchmark.tuning.subject import find_subject
    from gslcosim.benchmark.tuning.sweeping import Sweeper
    from gslcosim.benchmark.tuning.values import parse_varied
    from gslcosim.cli.bench_text import watched_count, watched_run

    subject = find_subject(arguments.suite, arguments.entry, repetitions=arguments.repetitions, seed=arguments.seed)
    sweeper = Sweeper(subject, parse_varied(arguments.vary, subject))
    with watched_count("planning", is_quiet=arguments.json) as planned:
        plan = plan_of(sweeper.suite(), progress=lambda n: planned(n, 0))
    folder = ResultsFolder(arguments.results or RESULTS_DIR / "_".join([sweeper.name, *sweeper.varied]))
    with watched_run(sweeper.name, is_quiet=arguments.json) as report:
        summary = Run(
            plan,
            folder,
            lambda: start_pool(arguments.jobs, subject.loaded.suite.limits),
            selection=Selection(),
            report=report,
        ).fly()
    if summary.is_interrupted:
        write_note(f"Interrupted after {summary.n_flown} flights. The same command goes on.")
        return ExitCode.INTERRUPTED
    ids = {trial.id for trial in plan.trials}
    sweep = sweeper.sweep([row for row in folder.rows() if row["trial"] in ids])
    _write(sweep, folder.path, is_json=arguments.json)
    return ExitCode.AGENT_FAILED if any(point.figures.n_without_result for point in sweep.points) else 0


def _write(sweep: "Sweep", folder: Path, *, is_json: bool) -> None:
    from gslcosim.benchmark.tuning.drawing import response_svg
    from gslcosim.benchmark.tuning.writing import sweep_csv, sweep_fields, write_fields, write_text

    fields = sweep_fields(sweep)
    write_fields(folder / "sweep.json", fields)
    write_text(folder / "sweep.csv", sweep_csv(sweep))
    write_text(folder / "sweep.svg", response_svg(sweep))
    if is_json:
        write_json(fields)
    else:
        write(sweep_text(sweep, folder))


COMMAND = Command(
    name="sweep",
    summary="fly a method with several values of its parameters, and draw the response curve",
    examples=EXAMPLES,
    add_arguments=_add_arguments,
    run=_run,
)
