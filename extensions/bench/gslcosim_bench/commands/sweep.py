"""`gslcosim bench sweep`: a method with several values of its parameters, and its response curve."""

import argparse

from gslcosim.base.errors import ExitCode
from gslcosim.cli.arguments import Command, parse_positive_number, parse_whole_number
from gslcosim.cli.completion_words import SCENARIOS, SUITES, YAML_FILES
from gslcosim.cli.progress import ProgressLine
from gslcosim.cli.terminal import add_json_option, write, write_json, write_note
from gslcosim_bench.commands.study_output import RESULTS_DIR, add_target_arguments, format_sweep
from gslcosim_bench.commands.workers import check_sandbox_here, confirm_put_aside, start_pool

EXAMPLES = """  gslcosim bench sweep tiny_room --entry dung_beetle --vary leg_m=0.4,0.8,1.6
  gslcosim bench sweep smoke --entry dung_beetle --vary leg_m=0.4,0.8 --vary zigzag_rad=0.5,1.0 --repetitions 5
  gslcosim bench sweep my_suite.yaml --entry surge_cast --vary growth=growing,fixed,doubling --results results/growth"""


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    add_target_arguments(parser)
    parser.add_argument(
        "--vary",
        action="append",
        required=True,
        metavar="PARAMETER=VALUES",
        help=("values of a parameter, for example step_m=0.2,0.5,1.0; repeatable: runs all combinations"),
    )
    parser.add_argument(
        "--repetitions",
        type=parse_positive_number,
        metavar="N",
        help="runs per case and setting (default: from the suite; 10 for a scenario)",
    )
    parser.add_argument("--seed", type=parse_whole_number, metavar="N", help="replace the seed of the suite")
    add_json_option(parser)


def _run(arguments: argparse.Namespace) -> int:
    from gslcosim_bench.cases import build_plan
    from gslcosim_bench.cases.models import MAX_COMPARED_SETTINGS, Selection
    from gslcosim_bench.commands.suite_output import show_suite_progress
    from gslcosim_bench.execution.runner import SuiteRun
    from gslcosim_bench.report.writer import write_report
    from gslcosim_bench.store import ResultsFolder
    from gslcosim_bench.studies.output import sweep_to_csv, sweep_to_json, write_fields, write_text
    from gslcosim_bench.studies.sweep import SweepPlan
    from gslcosim_bench.studies.target import find_target, parse_varied

    subject = find_target(arguments.suite, arguments.entry, repetitions=arguments.repetitions, seed=arguments.seed)
    sweeper = SweepPlan(subject, parse_varied(arguments.vary, subject))
    with ProgressLine("planning", is_quiet=arguments.json) as line:
        plan = build_plan(sweeper.suite(), progress=lambda n: line.count(n, 0))
    check_sandbox_here(arguments, plan)
    folder = ResultsFolder(arguments.results or RESULTS_DIR / "_".join([sweeper.name, *sweeper.varied]))
    with show_suite_progress(sweeper.name, is_quiet=arguments.json) as report:
        summary = SuiteRun(
            plan,
            folder,
            lambda: start_pool(arguments, subject.loaded.suite.limits),
            selection=Selection(),
            confirm_put_aside=confirm_put_aside(arguments),
            report=report,
        ).fly()
    if summary.is_interrupted:
        write_note(f"Interrupted after {summary.n_flown} runs. Repeat the command to resume.")
        return ExitCode.INTERRUPTED
    ids = {trial.id for trial in plan.trials}
    sweep = sweeper.sweep([row for row in folder.rows() if row["trial"] in ids])
    fields = sweep_to_json(sweep)
    write_fields(folder.path / "sweep.json", fields)
    write_text(folder.path / "sweep.csv", sweep_to_csv(sweep))
    page = write_report(folder.path).page if len(sweep.points) <= MAX_COMPARED_SETTINGS else None
    if arguments.json:
        write_json(fields)
    else:
        write(format_sweep(sweep, folder.path, page))
    return ExitCode.AGENT_FAILED if any(point.figures.n_without_result for point in sweep.points) else 0


COMMAND = Command(
    name="sweep",
    old_name="sweep",
    summary="run a method with several values of its parameters and draw the response curve",
    examples=EXAMPLES,
    add_arguments=_add_arguments,
    completes={"SUITE": [SUITES, SCENARIOS, YAML_FILES]},
    run=_run,
)
