"""`gslcosim extract`: a run as tables, gridded data or another format that an extension registers."""

import argparse
from pathlib import Path

from gslcosim.base.errors import build_path_error
from gslcosim.base.exporters import list_exporters
from gslcosim.base.extensions import find_remedy
from gslcosim.cli.arguments import RECORDING, Command, add_runs_dir_option, find_in_run
from gslcosim.cli.progress import ProgressLine
from gslcosim.cli.terminal import add_json_option, write, write_json

EXAMPLES = """  gslcosim extract --to parquet
  gslcosim extract runs/night_42 --to csv --out night_42_tables
  gslcosim extract --to netcdf
  gslcosim extract warehouse_empty-seed7-2025 --to rosbag2 --out bags/night_42"""


def _add_format_option(parser: argparse.ArgumentParser) -> None:
    """Add `--to`, with the formats in which installed extensions write runs."""
    exporters = list_exporters("run")

    def parse_format(text: str) -> str:
        if text not in exporters and (remedy := find_remedy("formats", text)):
            raise argparse.ArgumentTypeError(f"expected a format that is installed, was '{text}'. {remedy}")
        return text

    parser.add_argument(
        "--to",
        type=parse_format,
        choices=tuple(exporters),
        required=True,
        help="; ".join(f"{each.name}: {each.summary}" for each in exporters.values()),
    )


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "run",
        nargs="?",
        metavar="RUN",
        help="a run: folder, recording, or id or its beginning (default: the newest)",
    )
    _add_format_option(parser)
    parser.add_argument(
        "--out",
        type=Path,
        metavar="DIR",
        help="a new or empty folder for the files (default: named after run and format)",
    )
    add_runs_dir_option(parser)
    add_json_option(parser)


def _run(arguments: argparse.Namespace) -> int:
    from gslcosim_data.export.formats import extract_run
    from gslcosim_data.run import open_run

    run = open_run(find_in_run(arguments.run, runs_dir=arguments.runs_dir, file_name=RECORDING))
    out = arguments.out or Path(f"{run.run_id}_{arguments.to}")
    try:
        with ProgressLine(is_quiet=arguments.json) as line:
            files = extract_run(run, out, arguments.to, line.show)
    except OSError as error:
        raise build_path_error(error, "--out", "a folder that can be written", path=out) from error
    if arguments.json:
        write_json({"to": arguments.to, "out": str(out), "files": [str(path) for path in files]})
        return 0
    for path in files:
        write(str(path))
    return 0


COMMAND = Command(
    name="extract",
    summary="export a run as tables, grids or messages",
    examples=EXAMPLES,
    add_arguments=_add_arguments,
    run=_run,
)
