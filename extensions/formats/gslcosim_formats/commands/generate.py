"""`gslcosim environment generate`: environments from a layout, one or many."""

import argparse
import contextlib
import math
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gslcosim.base.errors import ExitCode
from gslcosim.cli.arguments import Command, parse_positive_number, parse_whole_number
from gslcosim.cli.progress import ProgressLine, RemainingTime
from gslcosim.cli.terminal import add_json_option, table, write, write_json, write_note

if TYPE_CHECKING:
    from gslcosim.environment.generation.builder import GenerationResult
    from gslcosim.scenario.loader import Recipe

EXAMPLES = """  gslcosim environment generate warehouse_complex
  gslcosim environment generate my_layout.yaml --out halls --count 20 --jobs 2
  gslcosim environment generate gsl_bench_3 --out hall --set wind.cell_m=0.25 --json
  gslcosim environment generate gsl_bench_3 --out both --compare-solvers
  gslcosim environment generate gsl_bench_3 --out study --mesh-study 0.4,0.3,0.2,0.15 --probe 5,3,2"""


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "source",
        metavar="SCENARIO_OR_LAYOUT",
        help="a scenario, a YAML file with the keys layout and wind, or a kind of layout (gslcosim list layouts)",
    )
    parser.add_argument(
        "--out",
        type=Path,
        metavar="DIR",
        help="folder of the environment, or of all of them (default: environments/NAME)",
    )
    parser.add_argument(
        "--count",
        type=parse_positive_number,
        default=1,
        metavar="N",
        help="number of environments, each with the next seed",
    )
    parser.add_argument("--jobs", type=parse_positive_number, default=1, metavar="N", help="number of parallel jobs")
    parser.add_argument(
        "--seed", type=parse_whole_number, metavar="N", help="replace the seed of the layout, for the first environment"
    )
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help="replace one value, for example wind.cell_m=0.1; repeatable",
    )
    parser.add_argument(
        "--mesh-study",
        type=_cells,
        metavar="M,M,M",
        help=("solve the wind on several meshes, and write a table and a plot of winds at the probes to DIR"),
    )
    parser.add_argument(
        "--compare-solvers",
        action="store_true",
        help=("solve the wind with the built-in solver and with OpenFOAM, compare both, and save both in DIR"),
    )
    parser.add_argument(
        "--probe",
        type=_point,
        action="append",
        default=[],
        metavar="X,Y,Z",
        help="a probe of the mesh study; repeatable (default: five across the room)",
    )
    add_json_option(parser)


def _cells(text: str) -> tuple[float, ...]:
    cells_m = _numbers(text)
    if len(cells_m) < 3 or min(cells_m) <= 0:
        raise argparse.ArgumentTypeError(f"expected three or more lengths above 0 like 0.4,0.3,0.2, was '{text}'")
    return cells_m


def _point(text: str) -> tuple[float, float, float]:
    if len(numbers := _numbers(text)) != 3:
        raise argparse.ArgumentTypeError(f"expected three numbers like 5,3,2, was '{text}'")
    return numbers[0], numbers[1], numbers[2]


def _numbers(text: str) -> tuple[float, ...]:
    try:
        numbers = tuple(float(part) for part in text.split(","))
    except ValueError:
        return ()
    return numbers if all(math.isfinite(number) for number in numbers) else ()


def _run(arguments: argparse.Namespace) -> int:
    from gslcosim.environment.generation.builder import build_jobs, generate_many
    from gslcosim.environment.positions import draw_positions
    from gslcosim.scenario.checks.registry import list_scenario_checks
    from gslcosim.scenario.loader import load_recipe

    checks = list_scenario_checks("room", without=("stored gas",))
    recipe = load_recipe(arguments.source, overrides=arguments.set, checks=checks, placer=draw_positions)
    arguments.out = arguments.out or Path("environments") / recipe.name
    if arguments.mesh_study:
        return _study_meshes(recipe, arguments)
    if arguments.compare_solvers:
        return _compare_solvers(recipe, arguments)
    orders = build_jobs(recipe, arguments.out, n=arguments.count, first_seed=arguments.seed)
    with _progress_bar(is_quiet=arguments.json) as report:
        outcomes = generate_many(orders, jobs=arguments.jobs, report=report)
    if arguments.json:
        write_json([_as_fields(outcome) for outcome in outcomes])
    else:
        _write_table([outcome for outcome in outcomes if outcome.error is None])
    for outcome in outcomes:
        if not arguments.json:
            for notice in outcome.notices:
                write_note(f"{outcome.order.folder}: {notice}")
        if outcome.error is not None:
            write_note(f"{outcome.order.folder}: {outcome.error}")
    n_failed = sum(outcome.error is not None for outcome in outcomes)
    if any(outcome.is_refused_by_machine for outcome in outcomes):
        return ExitCode.FAULT
    return 0 if not n_failed else ExitCode.USAGE if n_failed == len(outcomes) else ExitCode.FAULT


def _study_meshes(recipe: "Recipe", arguments: argparse.Namespace) -> int:
    from gslcosim_formats.mesh_study import build_rows, study_meshes, write_study

    with _progress_bar(is_quiet=arguments.json) as report:
        study = study_meshes(recipe, arguments.mesh_study, probes_m=arguments.probe, progress=report)
    files = write_study(study, arguments.out)
    if arguments.json:
        write_json(study.as_fields())
        return 0
    head, *rows = build_rows(study)
    write(table(head, rows))
    write_note(f"Written: {', '.join(str(path) for path in files)}.")
    return 0


def _compare_solvers(recipe: "Recipe", arguments: argparse.Namespace) -> int:
    from gslcosim_formats.mesh_study import compare_solvers_in, comparison_to_json

    with _progress_bar(is_quiet=arguments.json) as report:
        compared = compare_solvers_in(recipe, arguments.out, progress=report)
    if arguments.json:
        write_json(comparison_to_json(compared))
    else:
        write(compared.text)
        write_note(f"Both winds, with pictures from above, are in {arguments.out}.")
    return 0


def _write_table(outcomes: "list[GenerationResult]") -> None:
    if outcomes:
        rows = [
            [
                str(o.order.seed),
                str(o.n_air_cells),
                str(o.n_solid_cells),
                f"{o.duration_s:.1f}",
                str(o.order.folder),
            ]
            for o in outcomes
        ]
        write(table(["seed", "air cells", "solid cells", "seconds", "folder"], rows))


def _as_fields(outcome: "GenerationResult") -> dict[str, Any]:
    return {
        "folder": str(outcome.order.folder),
        "kind": outcome.order.kind,
        "seed": outcome.order.seed,
        "duration_s": round(outcome.duration_s, 3),
        "n_air_cells": outcome.n_air_cells,
        "n_solid_cells": outcome.n_solid_cells,
        "content_hash": outcome.content_hash,
        "random_source_m": outcome.random_source_m,
        "notices": list(outcome.notices),
        "error": outcome.error,
    }


# A pipe gets a line now and then, with the time that is left.
@contextlib.contextmanager
def _progress_bar(*, is_quiet: bool) -> Iterator[Callable[[str, float], None]]:
    remaining = RemainingTime()
    with ProgressLine(is_quiet=is_quiet) as line:

        def show(text: str, fraction: float) -> None:
            left = remaining.describe(text, fraction)
            line.show(text, fraction=fraction, plain=", ".join(filter(None, (text, left))))

        yield show


COMMAND = Command(
    name="generate",
    old_name="generate",
    is_computing=True,
    summary=("generate environments from a layout: geometry, occupancy, wind, scene and a picture from above"),
    examples=EXAMPLES,
    add_arguments=_add_arguments,
    run=_run,
)
