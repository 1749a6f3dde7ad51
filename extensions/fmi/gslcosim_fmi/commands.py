"""Options of `gslcosim environment export` for a unit of FMI."""

import argparse

from gslcosim.cli.arguments import CommandOptions, Run, build_number_parser, parse_whole_number
from gslcosim.cli.completion_words import find_separated


# A day of gas takes gigabytes.
def _is_recordable(seconds: float) -> bool:
    return 0.0 < seconds <= 86400.0


def _add_export_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--fmu-points",
        type=parse_whole_number,
        default=1,
        metavar="N",
        help="number of moving points of an FMI unit (default: 1)",
    )
    parser.add_argument(
        "--fmu-until",
        type=build_number_parser("a number of seconds greater than 0, at most 86400", _is_recordable),
        metavar="S",
        help="end of the gas that an FMI unit plays, in seconds (default: the scenario's time limit)",
    )
    parser.add_argument(
        "--fmu-sensors",
        default="",
        metavar="MODELS",
        help="gas sensors at each point of an FMI unit, for example tgs2600_ideal,pid_ideal (default: none)",
    )


def _run_export(arguments: argparse.Namespace, run: Run) -> int:
    return run(arguments)


def _list_fmu_sensors() -> tuple[str, ...]:
    from gslcosim_fmi.room_fmu import list_fmu_sensors

    return list_fmu_sensors()


EXPORT = CommandOptions(
    add_arguments=_add_export_options, run=_run_export, completes={"MODELS": [find_separated(_list_fmu_sensors)]}
)
