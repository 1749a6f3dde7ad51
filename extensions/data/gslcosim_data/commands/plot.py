"""`gslcosim plot`: figures for papers, of runs and of results."""

import argparse
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from gslcosim.base.errors import UsageError, build_machine_error, find_remedy
from gslcosim.base.method_names import join_methods
from gslcosim.cli.arguments import MANIFEST, Command, add_runs_dir_option, find_in_run
from gslcosim.cli.completion_words import find_separated
from gslcosim.cli.terminal import add_json_option, write, write_json, write_note

EXAMPLES = """  gslcosim plot runs/warehouse_empty-seed7-20250101T120000-a1b2c3
  gslcosim plot warehouse_empty-seed7 --figure track,distance --format pdf,svg --columns 2
  gslcosim plot runs/first runs/second runs/third     distances as a bundle, tracks over one plan
  gslcosim plot results/smoke --figure starts --out figures"""

FIGURES = ("track", "distance", "gas", "track_3d", "wind", "gas_section", "belief", "swarm", "starts")


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "runs", nargs="+", metavar="RUN", help="runs: folders, or ids or their beginnings; or a results folder"
    )
    parser.add_argument(
        "--figure",
        metavar="NAMES",
        help=f"which, separated by commas: {', '.join(FIGURES)} (default: all that there are data for)",
    )
    parser.add_argument(
        "--out", type=Path, default=Path("figures"), metavar="DIR", help="output folder (default: figures)"
    )
    parser.add_argument("--format", default="pdf", metavar="KINDS", help="pdf, svg, png, or several (default: pdf)")
    parser.add_argument(
        "--columns", type=int, choices=(1, 2), default=1, help="width in columns of a paper (default: 1)"
    )
    add_runs_dir_option(parser)
    add_json_option(parser)


def _run(arguments: argparse.Namespace) -> int:
    return write_chosen(arguments, partial(_draw_runs, arguments))


def write_chosen(arguments: argparse.Namespace, draw: Callable[..., Sequence[Path]]) -> int:
    """Draw the figures that a command line asks for, and print their files.

    Args:
        arguments: Of `gslcosim plot`.
        draw: Called with the folder, the `names` of figures, their `formats` and their `columns`; returns the files.
    """
    from gslcosim_data.figures.style import FORMATS

    names = _words("--figure", arguments.figure, FIGURES) if arguments.figure else ()
    formats = _words("--format", arguments.format, FORMATS)
    try:
        arguments.out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise build_machine_error(
            error,
            "--out",
            "a folder that can be written",
            path=arguments.out,
            remedy=f"{find_remedy(error)} --out chooses another.",
        ) from error
    written = draw(arguments.out, names=names, formats=formats, columns=arguments.columns)
    if arguments.json:
        write_json([str(path) for path in written])
    else:
        for path in written:
            write(str(path))
    return 0


def _words(option: str, text: str, known: tuple[str, ...]) -> tuple[str, ...]:
    words = tuple(dict.fromkeys(word.strip() for word in text.split(",") if word.strip()))
    wrong = next((word for word in words if word not in known), None)
    if wrong is not None or not words:
        raise UsageError(f"{option}: expected some of {', '.join(known)}, was '{wrong or text}'.")
    return words


def _draw_runs(arguments: argparse.Namespace, folder: Path, **options: Any) -> list[Path]:
    from gslcosim_data.figures.run_figures import write_figures_of_several, write_run_figures
    from gslcosim_data.run import open_run

    if "starts" in options["names"]:
        raise UsageError("--figure starts: expected a folder of results, which has many flights, was a run.")
    runs = [open_run(find_in_run(run, runs_dir=arguments.runs_dir, file_name=MANIFEST)) for run in arguments.runs]
    if len(runs) == 1:
        return write_run_figures(runs[0], folder, **options)
    write_note(f"{len(runs)} runs together; of one run there are more figures.")
    labels = [f"{join_methods(run.methods.values())}, seed {run.scenario.seed}" for run in runs]
    unlike = [label if labels.count(label) == 1 else f"{label} ({i + 1})" for i, label in enumerate(labels)]
    return write_figures_of_several(dict(zip(unlike, runs, strict=True)), folder, **options)


def _list_formats() -> tuple[str, ...]:
    from gslcosim_data.figures.style import FORMATS

    return FORMATS


COMMAND = Command(
    name="plot",
    summary="draw figures for papers: track, distance, gas and sensor, sections, belief, swarm, success by start",
    examples=EXAMPLES,
    add_arguments=_add_arguments,
    completes={"NAMES": [find_separated(lambda: FIGURES)], "KINDS": [find_separated(_list_formats)]},
    run=_run,
)
