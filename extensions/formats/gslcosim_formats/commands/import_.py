"""`gslcosim environment import`: a room of another program, with its wind, as an environment folder of ours."""

import argparse
import warnings
from pathlib import Path
from typing import TYPE_CHECKING

from gslcosim.base.errors import EnvironmentDataError, UsageError
from gslcosim.cli.arguments import Command, build_number_parser
from gslcosim.cli.terminal import add_json_option, write, write_json, write_note

if TYPE_CHECKING:
    from gslcosim.environment.model import Environment

EXAMPLES = """  gslcosim environment import environments/001 --out gsl_bench_001
  gslcosim environment import scenarios/10x6_empty_room --wind wind_simulations/fast --out room
  gslcosim environment import OccupancyGrid3D.csv --wind case/postProcessing/points_U.csv --out room --json"""

FORMATS = ("gaden", "gsl_bench")


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "source",
        type=Path,
        metavar="FOLDER_OR_FILE",
        help="a GADEN scenario or its OccupancyGrid3D.csv, a GSL-Bench environment or its head file",
    )
    parser.add_argument("--out", type=Path, required=True, metavar="ENV", help="environment folder to write")
    parser.add_argument("--from", dest="origin", choices=FORMATS, help="format (default: detected)")
    parser.add_argument(
        "--wind",
        type=Path,
        metavar="PATH",
        help="a file, folder or series of wind (default: the usual place of the format)",
    )
    parser.add_argument(
        "--period",
        type=build_number_parser("a number of seconds greater than 0", lambda seconds: seconds > 0.0),
        metavar="S",
        help="seconds between wind frames (default: from the format, or 1)",
    )
    parser.add_argument("--no-loop", action="store_true", help="hold the last wind frame instead of restarting")
    add_json_option(parser)


def _run(arguments: argparse.Namespace) -> int:
    from gslcosim_formats.environment_folders import NOTICE
    from gslcosim_formats.environment_views import save_with_views

    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        environment = _imported(arguments)
    notices = [str(warning.message) for warning in caught]
    made_from = {
        "imported_from": str(arguments.source.resolve()),
        "wind": str(arguments.wind.resolve()) if arguments.wind is not None else None,
    }
    save_with_views(environment, arguments.out, made_from=made_from, notices=[NOTICE, *notices])
    _write_summary(arguments, environment, notices)
    return 0


def _imported(arguments: argparse.Namespace) -> "Environment":
    from gslcosim_formats.environment_folders import import_gaden, import_gsl_bench

    origin = arguments.origin or _recognised(arguments.source)
    read = import_gsl_bench if origin == "gsl_bench" else import_gaden
    try:
        return read(arguments.source, wind=arguments.wind, period_s=arguments.period, is_looping=not arguments.no_loop)
    except MemoryError as error:
        raise EnvironmentDataError(f"{arguments.source}: too large for this machine's memory.") from error


def _recognised(source: Path) -> str:
    from gslcosim_formats.environment_folders import is_gaden, is_gsl_bench

    if is_gsl_bench(source):
        return "gsl_bench"
    if is_gaden(source):
        return "gaden"
    found = "a folder or file without any of them" if source.exists() else "missing"
    raise UsageError(
        f"{source}: expected a scenario of GADEN (OccupancyGrid3D.csv) or an environment of GSL-Bench "
        f"(occupancy/*_head.txt), was {found}."
    )


def _write_summary(arguments: argparse.Namespace, environment: "Environment", notices: list[str]) -> None:
    import numpy as np

    from gslcosim.environment.model import Cell

    counts = np.bincount(environment.occupancy.ravel(), minlength=len(Cell)).tolist()
    fields = {
        "out": str(arguments.out),
        "name": environment.name,
        "shape": list(environment.grid.shape),
        "cell_m": environment.grid.cell_m,
        **{f"n_{cell.name.lower()}_cells": counts[cell] for cell in Cell},
        "openings": [opening.name for opening in environment.openings],
        "n_wind_frames": len(environment.wind.velocity_m_s),
        "period_s": environment.wind.period_s,
        "content_hash": environment.content_hash,
        "notices": notices,
    }
    if arguments.json:
        write_json(fields)
        return
    size = " x ".join(str(n) for n in environment.grid.shape)
    write(
        f"{arguments.out}: {environment.name}, {size} cells of {environment.grid.cell_m:g} m "
        f"({counts[Cell.FREE]} free, {counts[Cell.SOLID]} solid, {counts[Cell.OUTLET]} at outlets), "
        f"{len(environment.openings)} openings, frames of wind: {fields['n_wind_frames']}."
    )
    for notice in notices:
        write_note(notice)


COMMAND = Command(
    name="import",
    old_name="import",
    summary="import a room of GADEN or GSL-Bench, with its wind, as an environment folder",
    examples=EXAMPLES,
    add_arguments=_add_arguments,
    run=_run,
)
