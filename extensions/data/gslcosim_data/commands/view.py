"""Options of `gslcosim view`: several runs in one view, a run from a time on, and an environment without a run."""

import argparse
from pathlib import Path

from gslcosim.base.errors import UsageError
from gslcosim.cli.arguments import RECORDING, CommandOptions, Run, build_number_parser, find_in_run
from gslcosim.cli.commands.view import is_environment


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--at",
        type=build_number_parser("a simulated time in seconds", lambda time_s: 0 <= time_s < 1e9),
        metavar="S",
        help="open one run at a simulated time and play from there; an image shows that time",
    )
    parser.add_argument(
        "--align",
        choices=("sim_time", "first_contact"),
        help=("common time axis of several runs: simulated time (default), or time since the first contact with gas"),
    )


# A recording made here exists only while it is shown.
def _run(arguments: argparse.Namespace, run: Run) -> int:
    has_several = len(arguments.runs) > 1
    has_environment = is_environment(arguments.runs)
    if arguments.align is not None and not has_several:
        raise UsageError("gslcosim view: expected --align with several runs.")
    if arguments.at is not None and (has_several or has_environment):
        raise UsageError("gslcosim view: expected --at with one run.")
    if not has_several and not has_environment and arguments.at is None:
        return run(arguments)
    from gslcosim.base.files import ScratchFolder

    with ScratchFolder() as scratch:
        path = scratch.path / RECORDING
        if has_environment:
            from gslcosim.environment.store import load_environment
            from gslcosim_data.environment_view import record_environment

            record_environment(load_environment(Path(arguments.runs[0]), with_meshes=True), path)
        else:
            from gslcosim_data.run_views import record_run_at, record_runs

            recordings = [
                find_in_run(each, runs_dir=arguments.runs_dir, file_name=RECORDING) for each in arguments.runs or [None]
            ]
            if arguments.at is None:
                record_runs(recordings, path, is_by_contact=arguments.align == "first_contact")
            else:
                record_run_at(recordings[0], path, arguments.at, is_still=arguments.screenshot is not None)
        arguments.runs = [str(path)]
        return run(arguments)


OPTIONS = CommandOptions(add_arguments=_add_arguments, run=_run)
