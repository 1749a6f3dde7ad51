"""`gslcosim environment export`: an environment in the format of another program, or as an FMI unit."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from gslcosim.base.errors import build_path_error
from gslcosim.base.exporters import list_exporters
from gslcosim.cli.arguments import Command, build_number_parser, parse_whole_number
from gslcosim.cli.completion_words import SCENARIOS, find_folders, find_separated
from gslcosim.cli.terminal import add_json_option, write, write_json, write_note

if TYPE_CHECKING:
    from gslcosim.environment.export_folder import ExportResult
    from gslcosim.environment.model import Environment
    from gslcosim.scenario import Scenario

EXAMPLES = """  gslcosim environment export hall --to gaden --out hall_gaden
  gslcosim environment export warehouse_empty --to vtk --out warehouse_vtk
  gslcosim environment export hall --to gaden --gaden-wind points --out hall_points
  gslcosim environment export tiny_room --to fmu --fmu-points 4 --out tiny_room_fmu"""

GADEN_WINDS = ("components", "components_text", "points", "iterations")


# A day of gas takes gigabytes.
def _is_recordable(seconds: float) -> bool:
    return 0.0 < seconds <= 86400.0


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("source", metavar="ENV", help="an environment folder, or a scenario")
    parser.add_argument("--to", choices=tuple(list_exporters("environment")), required=True, help="the format")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="a new or empty folder for the files")
    parser.add_argument(
        "--gaden-wind",
        choices=GADEN_WINDS,
        default="components",
        help=(
            "form of GADEN's wind: files of its simulator, binary (default) or text, points for "
            "its preprocessing, or iterations as in its results"
        ),
    )
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
    add_json_option(parser)


def _run(arguments: argparse.Namespace) -> int:
    try:
        export = _export(arguments)
    except OSError as error:
        raise build_path_error(error, "--out", "a folder that can be written", path=arguments.out) from error
    if arguments.json:
        files = [str(path) for path in export.files]
        write_json({"to": arguments.to, "out": str(arguments.out), "files": files, "notices": list(export.notices)})
        return 0
    for path in export.files:
        write(str(path))
    for notice in export.notices:
        write_note(notice)
    return 0


def _export(arguments: argparse.Namespace) -> "ExportResult":
    environment, scenario = _load(arguments.source)
    write_environment = list_exporters("environment")[arguments.to].load()
    return write_environment(environment, arguments.out, scenario, arguments)


# A folder is a room without gas.
def _load(source: str) -> "tuple[Environment, Scenario | None]":
    from gslcosim.environment.generation import prepare_environment
    from gslcosim.environment.positions import draw_positions
    from gslcosim.environment.store import load_environment
    from gslcosim.scenario import load_scenario

    if Path(source).is_dir():
        return load_environment(Path(source), with_meshes=True), None
    loaded = load_scenario(source, placer=draw_positions)
    environment = load_environment(prepare_environment(loaded.scenario, scenario_dir=loaded.directory))
    return environment, loaded.scenario


def _list_fmu_sensors() -> tuple[str, ...]:
    from gslcosim_fmi.room_fmu import list_fmu_sensors

    return list_fmu_sensors()


COMMAND = Command(
    name="export",
    old_name="export",
    summary=("export an environment as GADEN, GSL-Bench, VTK, NetCDF, Zarr, STL, OpenFOAM points, MJCF or FMI unit"),
    examples=EXAMPLES,
    add_arguments=_add_arguments,
    completes={"ENV": [SCENARIOS, find_folders], "MODELS": [find_separated(_list_fmu_sensors)]},
    run=_run,
)
