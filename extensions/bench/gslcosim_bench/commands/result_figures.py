"""Folders of results in `gslcosim plot`."""

import argparse
from collections.abc import Sequence
from functools import partial
from pathlib import Path

from gslcosim.base.errors import UsageError
from gslcosim.cli.arguments import CommandOptions, Run
from gslcosim_bench.commands.run_rows import is_results_folder
from gslcosim_data.commands.plot import write_chosen


def _plot(arguments: argparse.Namespace, run: Run) -> int:
    paths = [Path(name) for name in arguments.runs]
    found = [path for path in paths if is_results_folder(path)]
    if not found:
        return run(arguments)
    if len(paths) > 1:
        raise UsageError(f"plot: expected runs, or one folder of results alone, was {found[0]} beside others.")
    return write_chosen(arguments, partial(_draw_results, found[0]))


def _draw_results(
    results: Path, folder: Path, *, names: Sequence[str], formats: Sequence[str], columns: int
) -> list[Path]:
    from gslcosim_bench.report.figures import write_result_figures

    return write_result_figures(results, folder, names=names, formats=formats, columns=columns)


PLOT = CommandOptions(add_arguments=lambda _: None, run=_plot)
