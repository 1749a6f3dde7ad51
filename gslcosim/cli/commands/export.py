"""`gslcosim environment export`: an environment in the format of another program."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from gslcosim.base.errors import build_path_error
from gslcosim.cli.arguments import Command
from gslcosim.cli.terminal import add_json_option, write, write_json, write_note

if TYPE_CHECKING:
    from gslcosim.environment.model import Environment

EXAMPLES = """  gslcosim environment export hall --to gaden --out hall_gaden
  gslcosim environment export warehouse_empty --to vtk --out warehouse_vtk
  gslcosim environment export hall --to gaden --gaden-wind points --out hall_points"""

FORMATS = ("gaden", "gsl_bench", "vtk", "netcdf", "zarr", "stl", "openfoam_points", "mjcf")
GADEN_WINDS = ("components", "components_text", "points", "iterations")


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("source", metavar="ENV", help="an environment folder, or a scenario")
    parser.add_argument("--to", choices=FORMATS, required=True, help="the format")
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
    add_json_option(parser)


def _run(arguments: argparse.Namespace) -> int:
    from gslcosim.environment.formats.export import export_environment

    environment = _environment_of(arguments.source)
    try:
        export = export_environment(environment, arguments.out, arguments.to, gaden_wind=arguments.gaden_wind)
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


def _environment_of(source: str) -> "Environment":
    from gslcosim.environment.generation import prepare_environment
    from gslcosim.environment.store import load_environment
    from gslcosim.scenario import load_scenario

    if Path(source).is_dir():
        return load_environment(Path(source), with_meshes=True)
    loaded = load_scenario(source)
    return load_environment(prepare_environment(loaded.scenario, scenario_dir=loaded.directory))


COMMAND = Command(
    name="export",
    old_name="export",
    summary=("export an environment as GADEN, GSL-Bench, VTK, NetCDF, Zarr, STL, OpenFOAM points or MJCF"),
    examples=EXAMPLES,
    add_arguments=_add_arguments,
    run=_run,
)
