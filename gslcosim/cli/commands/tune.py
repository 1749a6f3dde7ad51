"""`gslcosim tune`: a search for good parameters of a method, within a budget of flights."""

import argparse

from gslcosim.cli.parsing import Command, at_least_one, whole_number
from gslcosim.cli.terminal import add_json_option, write, write_json, write_note
from gslcosim.cli.tuning_text import RESULTS_DIR, add_what, start_pool, tuning_text, watched_tuning
from gslcosim.errors import ExitCode

EXAMPLES = """  gslcosim tune tiny_room --entry dung_beetle --range leg_m=0.2:2.0 --budget 60
  gslcosim tune smoke --entry dung_beetle --range leg_m=0.2:2.0:log --range zigzag_rad=0.3:1.4 --budget 400 --jobs 2
  gslcosim tune my_suite.yaml --entry surge_cast --range n_casts=1:8 --budget 1000 --flights-per-setting 20 --seed 7"""


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    add_what(parser)
    parser.add_argument(
        "--range",
        action="append",
        default=[],
        metavar="PARAMETER=LEAST:MOST",
        help="where a number is searched, for example step_m=0.1:2.0, or with :log behind it in equal factors; as "
        "often as needed (default: all numbers of the method's card with min, max and a default)",
    )
    parser.add_argument(
        "--budget", type=at_least_one, required=True, metavar="N", help="how many flights, validation included"
    )
    parser.add_argument(
        "--flights-per-setting",
        type=at_least_one,
        metavar="K",
        help="flights of each setting in training (default: half the square root of the budget)",
    )
    parser.add_argument(
        "--seed", type=whole_number, default=0, metavar="N", help="of the search and of its flights (default: 0)"
    )
    add_json_option(parser)


def _run(arguments: argparse.Namespace) -> int:
    from gslcosim.benchmark.tuning.budget import budget_of
    from gslcosim.benchmark.tuning.optimising import Tuner
    from gslcosim.benchmark.tuning.subject import find_subject
    from gslcosim.benchmark.tuning.values import parse_ranges, ranges_of_card
    from gslcosim.benchmark.tuning.writing import (
        parameters_to_paste,
        tuning_csv,
        tuning_fields,
        write_fields,
        write_text,
        yaml_of,
    )

    subject = find_subject(arguments.suite, arguments.entry)
    ranges = parse_ranges(arguments.range, subject) if arguments.range else ranges_of_card(subject)
    suite, entry = subject.loaded.suite, subject.entry.name
    folder = arguments.results or RESULTS_DIR / f"tune_{suite.name}_{entry}"
    with watched_tuning(f"tuning {entry} in {suite.name}", is_quiet=arguments.json) as watch:
        tuner = Tuner(
            subject,
            ranges,
            budget_of(arguments.budget, arguments.flights_per_setting),
            seed=arguments.seed,
            folder=folder,
            start_pool=lambda: start_pool(arguments.jobs, suite.limits),
            report=watch.progress,
            tell=watch.stage,
        )
        try:
            tuning = tuner.tune()
        except KeyboardInterrupt:
            watch.end()
            write_note("Interrupted. The same command goes on.")
            return ExitCode.INTERRUPTED
    fields = tuning_fields(tuning)
    write_fields(folder / "tuning.json", fields)
    write_text(folder / "tuning.csv", tuning_csv(tuning))
    if arguments.json:
        write_json(fields)
    else:
        write(tuning_text(tuning, folder, yaml_of(parameters_to_paste(tuning))))
    return 0


COMMAND = Command(
    name="tune",
    summary="search good parameters of a method within a budget of flights, on seeds that no suite has",
    examples=EXAMPLES,
    add_arguments=_add_arguments,
    run=_run,
)
