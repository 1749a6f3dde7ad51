"""`gslcosim bench tune`: a search for good parameters of a method, within a budget of runs."""

import argparse
from typing import TYPE_CHECKING

from gslcosim.base.errors import ExitCode
from gslcosim.cli.arguments import Command, parse_positive_number, parse_whole_number
from gslcosim.cli.completion_words import SCENARIOS, SUITES, YAML_FILES
from gslcosim.cli.progress import ProgressLine
from gslcosim.cli.terminal import add_json_option, write, write_json, write_note
from gslcosim_bench.commands.study_output import RESULTS_DIR, add_target_arguments, format_stage, format_tuning
from gslcosim_bench.commands.workers import confirm_put_aside, start_pool

if TYPE_CHECKING:
    from gslcosim_bench.execution.runner import Progress

EXAMPLES = """  gslcosim bench tune tiny_room --entry dung_beetle --range leg_m=0.2:2.0 --budget 60
  gslcosim bench tune smoke --entry dung_beetle --range leg_m=0.2:2.0:log --range zigzag_rad=0.3:1.4 --budget 400
  gslcosim bench tune my_suite.yaml --entry surge_cast --range n_casts=1:8 --budget 1000 --seed 7"""


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    add_target_arguments(parser)
    parser.add_argument(
        "--range",
        action="append",
        default=[],
        metavar="PARAMETER=LEAST:MOST",
        help=(
            "range of a number, for example step_m=0.1:2.0, with :log for a logarithmic scale; "
            "repeatable (default: all numbers of the method's card with min, max and a default)"
        ),
    )
    parser.add_argument(
        "--budget", type=parse_positive_number, required=True, metavar="N", help="number of runs, validation included"
    )
    parser.add_argument(
        "--flights-per-setting",
        type=parse_positive_number,
        metavar="K",
        help="runs per setting in training (default: half the square root of the budget)",
    )
    parser.add_argument(
        "--seed", type=parse_whole_number, default=0, metavar="N", help="seed of the search and its runs (default: 0)"
    )
    add_json_option(parser)


def _run(arguments: argparse.Namespace) -> int:
    from gslcosim_bench.report.writer import write_report
    from gslcosim_bench.studies.output import (
        parameters_to_paste,
        to_inline_yaml,
        tuning_to_csv,
        tuning_to_json,
        write_fields,
        write_text,
    )
    from gslcosim_bench.studies.runner import StudyHost
    from gslcosim_bench.studies.target import card_ranges, find_target, parse_ranges
    from gslcosim_bench.studies.tuning import TRAINING, VALIDATION, Tuner, split_budget

    subject = find_target(arguments.suite, arguments.entry)
    ranges = parse_ranges(arguments.range, subject) if arguments.range else card_ranges(subject)
    suite, entry = subject.loaded.suite, subject.entry.name
    folder = arguments.results or RESULTS_DIR / f"tune_{suite.name}_{entry}"
    with ProgressLine(f"tuning {entry} in {suite.name}", is_quiet=arguments.json) as line:

        def show(progress: "Progress") -> None:
            phase = "flights of a batch" if progress.phase == "trials" else progress.phase
            line.count(progress.done, progress.total, phase=phase)

        tuner = Tuner(
            subject,
            ranges,
            split_budget(arguments.budget, arguments.flights_per_setting),
            seed=arguments.seed,
            folder=folder,
            host=StudyHost(
                start_pool=lambda: start_pool(arguments, suite.limits),
                confirm_put_aside=confirm_put_aside(arguments),
                report=show,
            ),
            tell=lambda stage: line.note(format_stage(stage)),
        )
        try:
            tuning = tuner.tune()
        except KeyboardInterrupt:
            line.end()
            write_note("Interrupted. Repeat the command to resume.")
            return ExitCode.INTERRUPTED
    # Two folders of results: the settings of the search, and the best of them beside the default.
    flown = [TRAINING, VALIDATION] if tuning.validation is not None else [TRAINING]
    pages = [write_report(folder / name).page for name in flown]
    fields = tuning_to_json(tuning)
    write_fields(folder / "tuning.json", fields)
    write_text(folder / "tuning.csv", tuning_to_csv(tuning))
    if arguments.json:
        write_json(fields)
    else:
        write(format_tuning(tuning, folder, pages, to_inline_yaml(parameters_to_paste(tuning))))
    return 0


COMMAND = Command(
    name="tune",
    old_name="tune",
    summary=("search for good parameters of a method within a budget of runs, on seeds that no suite has"),
    examples=EXAMPLES,
    add_arguments=_add_arguments,
    completes={"SUITE": [SUITES, SCENARIOS, YAML_FILES]},
    run=_run,
)
