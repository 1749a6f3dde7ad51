"""`gslcosim bench dataset`: results as a dataset to publish."""

import argparse
from datetime import date
from pathlib import Path

from gslcosim.cli.arguments import Command
from gslcosim.cli.terminal import add_json_option, write, write_json
from gslcosim_archive.dataset import DEFAULT_LICENSE


def _parse_date(text: str) -> date:
    try:
        return date.fromisoformat(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"expected a date such as 2026-11-28, was {text!r}") from error


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    add_json_option(parser)
    parser.add_argument(
        "results",
        nargs="+",
        type=Path,
        metavar="RESULTS",
        help="finished results of one suite, of one or several seeds",
    )
    parser.add_argument("--out", type=Path, required=True, metavar="FOLDER", help="new folder of the dataset")
    parser.add_argument(
        "--license",
        default=DEFAULT_LICENSE,
        metavar="LICENSE",
        help="SPDX identifier or URL of the license (default: %(default)s)",
    )
    parser.add_argument(
        "--author",
        action="append",
        default=[],
        metavar="NAME",
        help="who publishes it; repeatable (default: anonymous)",
    )
    parser.add_argument("--url", metavar="URL", help="where it is published")
    parser.add_argument(
        "--date",
        type=_parse_date,
        metavar="DATE",
        help="day of publication (default: that on which the last results were begun)",
    )
    parser.add_argument(
        "--incomplete", action="store_true", help="accept results of a part of the suite; the datasheet says so"
    )
    parser.add_argument("--no-tracks", action="store_true", help="leave out the tracks, which are most of the bytes")


def _write_dataset(arguments: argparse.Namespace) -> int:
    from dataclasses import asdict

    from gslcosim_archive.dataset.writer import write_dataset

    written = write_dataset(
        arguments.results,
        arguments.out,
        license=arguments.license,
        authors=arguments.author,
        url=arguments.url,
        published=arguments.date,
        may_be_incomplete=arguments.incomplete,
        has_tracks=not arguments.no_tracks,
    )
    if arguments.json:
        write_json(asdict(written) | {"folder": str(written.folder)})
    else:
        write(
            f"{written.n_flights} flights, {written.n_samples} samples, {written.n_files} files, "
            f"{written.n_bytes / 1e6:.1f} MB.\nDataset: {written.folder}"
        )
    return 0


COMMAND = Command(
    name="dataset",
    summary="write results as a dataset to publish: Parquet, a datasheet and Croissant",
    examples="  gslcosim bench dataset results/smoke --out dataset\n"
    "  gslcosim bench dataset results/seed_1 results/seed_2 --out dataset --author 'A. Author' --license CC0-1.0",
    add_arguments=_add_arguments,
    run=_write_dataset,
)
