"""`gslcosim environment export`: an environment in the format of another program."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from gslcosim.base.errors import UsageError, build_path_error
from gslcosim.base.exporters import list_exporters
from gslcosim.cli.arguments import Command, add_override_options
from gslcosim.cli.completion_words import SCENARIOS, find_folders
from gslcosim.cli.terminal import add_json_option, write, write_json, write_note

if TYPE_CHECKING:
    from gslcosim.environment.export_folder import ExportResult
    from gslcosim.environment.model import Environment
    from gslcosim.scenario import Scenario

EXAMPLES = """  gslcosim environment export hall --to gaden --out hall_gaden
  gslcosim environment export warehouse_empty --to vtk --out warehouse_vtk
  gslcosim environment export hall --to gaden --gaden-wind points --out hall_points
  gslcosim environment export tiny_room --set gas.turbulence.kind=none --to fmu --fmu-points 4 --out tiny_room_fmu"""

GADEN_WINDS = ("components", "components_text", "points", "iterations")


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
    add_override_options(parser)
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
    environment, scenario = _load(arguments)
    write_environment = list_exporters("environment")[arguments.to].load()
    return write_environment(environment, arguments.out, scenario, arguments)


# A folder is a room without gas.
def _load(arguments: argparse.Namespace) -> "tuple[Environment, Scenario | None]":
    from gslcosim.environment.generation.cache import prepare_environment
    from gslcosim.environment.positions import draw_positions
    from gslcosim.environment.store import load_environment
    from gslcosim.scenario import load_scenario

    source = arguments.source
    if Path(source).is_dir():
        if arguments.set or arguments.seed is not None:
            raise UsageError(
                f"--set, --seed: expected a scenario beside them, was the folder {source}. Leave them out."
            )
        return load_environment(Path(source), with_meshes=True), None
    loaded = load_scenario(source, overrides=arguments.set, seed=arguments.seed, placer=draw_positions)
    environment = load_environment(prepare_environment(loaded.scenario, scenario_dir=loaded.directory))
    return environment, loaded.scenario


COMMAND = Command(
    name="export",
    old_name="export",
    summary=("export an environment as GADEN, GSL-Bench, VTK, NetCDF, Zarr, STL, OpenFOAM points, MJCF or FMI unit"),
    examples=EXAMPLES,
    add_arguments=_add_arguments,
    completes={"ENV": [SCENARIOS, find_folders]},
    run=_run,
)
