"""`gslcosim environment sample`: gas or wind at any points, into a file."""

import argparse
from collections.abc import Generator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from gslcosim.base.errors import EnvironmentDataError, UsageError, build_path_error
from gslcosim.cli.arguments import Command, add_runs_dir_option, build_number_parser, parse_whole_number
from gslcosim.cli.terminal import add_json_option, write, write_json

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from gslcosim.environment.model import Environment, Grid
    from gslcosim.scenario import Scenario
    from gslcosim_formats.field_samplers import FieldSampler, Instant, ViewOptions
    from gslcosim_services.fields.gas_field import PointGrid

EXAMPLES = """  gslcosim environment sample environments/001 --frame 400 --points points.csv --out ppm.csv
  gslcosim environment sample runs/my_run --time 60 --grid 0.25 --out ppm.npz
  gslcosim environment sample my_environment --quantity wind --time 0 --points points.csv --out wind.csv
  gslcosim environment sample my_environment --scenario warehouse_empty --time 60 --points points.csv --out ppm.csv"""

GAS_COLUMNS = ("mixing_ratio_ppm",)
WIND_COLUMNS = ("wind_x_m_s", "wind_y_m_s", "wind_z_m_s", "wind_speed_m_s")

_parse_positive = build_number_parser("a number greater than 0", lambda number: number >= 1e-9)


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "source",
        metavar="ENV_OR_RUN",
        help=("an environment folder, a GSL-Bench environment, a GADEN result folder, a run, or a scenario"),
    )
    when = parser.add_mutually_exclusive_group(required=True)
    when.add_argument(
        "--time",
        type=build_number_parser("a number of seconds, at least 0", lambda seconds: seconds >= 0.0),
        metavar="T",
        help="time in seconds; in a run, since its start",
    )
    when.add_argument(
        "--frame", type=parse_whole_number, metavar="N", help="number of a stored frame; in a run, of a tick"
    )
    where = parser.add_mutually_exclusive_group(required=True)
    where.add_argument("--points", type=Path, metavar="CSV", help="a csv file with the header x_m,y_m,z_m")
    where.add_argument(
        "--grid",
        type=_parse_positive,
        metavar="M",
        help="all points (i + 0.5) * M in the room, for example 0.25",
    )
    parser.add_argument("--out", type=Path, required=True, metavar="FILE", help="a csv file; with --grid csv or npz")
    parser.add_argument("--quantity", choices=("gas", "wind"), default="gas", help="quantity (default: gas)")
    parser.add_argument("--gas", metavar="NAME", help="gas of a run (default: the gas to find)")
    parser.add_argument(
        "--cutoff-sigma",
        type=_parse_positive,
        metavar="S",
        help="range of a filament in sigma (default: that of the model, 5)",
    )
    parser.add_argument("--no-line-of-sight", action="store_true", help="include gas behind walls")
    parser.add_argument(
        "--period",
        type=_parse_positive,
        metavar="S",
        help="seconds between stored frames (default: GSL-Bench 1, GADEN 0.5)",
    )
    parser.add_argument("--scenario", metavar="SCENARIO", help="scenario whose gas to release in an environment folder")
    add_runs_dir_option(parser)
    add_json_option(parser)


def _run(arguments: argparse.Namespace) -> int:
    from gslcosim_formats.field_samplers import Instant, ViewOptions, build_lattice

    _check_file_name(arguments)
    fields = _fields_of(arguments)
    instant = Instant(time_s=arguments.time, frame=arguments.frame)
    view = ViewOptions(has_line_of_sight=not arguments.no_line_of_sight, cutoff_sigma=arguments.cutoff_sigma)
    if arguments.points is not None:
        values = _sample_points(arguments, fields, instant, view)
    else:
        room = fields.grid(instant)
        values = _sample_grid(
            arguments, fields, instant, view, build_lattice(room.origin_m, room.max_m, arguments.grid)
        )
    _write_summary(arguments, values[..., -1])
    return 0


def _sample_points(
    arguments: argparse.Namespace, fields: "FieldSampler", instant: "Instant", view: "ViewOptions"
) -> "NDArray[np.float64]":
    from gslcosim_formats.commands.point_files import read_points, write_values

    points_m = read_points(arguments.points)
    _check_inside(points_m, fields.grid(instant))
    names, values = _values_at(arguments.quantity, points_m, fields, instant, view)
    with _written(arguments.out):
        write_values(arguments.out, points_m, names, values)
    return values


def _sample_grid(
    arguments: argparse.Namespace, fields: "FieldSampler", instant: "Instant", view: "ViewOptions", grid: "PointGrid"
) -> "NDArray[np.float64]":
    import numpy as np

    from gslcosim_formats.commands.point_files import COORDINATES, write_values

    points_m = grid.points_m()
    if arguments.quantity == "gas":
        names, values = GAS_COLUMNS, fields.gas_ppm_on(grid, instant, view).reshape(-1, 1)
    else:
        names, values = _values_at("wind", points_m, fields, instant, view)
    with _written(arguments.out):
        if arguments.out.suffix == ".csv":
            write_values(arguments.out, points_m, names, values)
        else:
            arrays = {name: values[:, i].reshape(grid.shape) for i, name in enumerate(names)}
            axes = dict(zip(COORDINATES, grid.axes_m(), strict=True))
            np.savez_compressed(arguments.out, **arrays, **axes)
    return values


def _values_at(
    quantity: str, points_m: "NDArray[np.float64]", fields: "FieldSampler", instant: "Instant", view: "ViewOptions"
) -> "tuple[Sequence[str], NDArray[np.float64]]":
    import numpy as np

    if quantity == "gas":
        return GAS_COLUMNS, fields.gas_ppm(points_m, instant, view)[:, None]
    wind_m_s = fields.wind_m_s(points_m, instant)
    return WIND_COLUMNS, np.hstack([wind_m_s, np.linalg.norm(wind_m_s, axis=1, keepdims=True)])


# Nobody knows the gas there, and interpolation would go on with the border's wind for ever.
def _check_inside(points_m: "NDArray[np.float64]", grid: "Grid") -> None:
    i = grid.find_point_outside(points_m)
    if i is not None:
        raise UsageError(
            f"--points: expected points in the room, from {grid.origin_m} to {grid.max_m} m, "
            f"was {tuple(points_m[i].tolist())} m as point {i + 1}."
        )


def _fields_of(arguments: argparse.Namespace) -> "FieldSampler":
    from gslcosim.environment.store import HEADER_FILE, load_environment
    from gslcosim_formats.field_samplers import ScenarioFieldSampler
    from gslcosim_formats.stored_gas.samplers import find_stored_field_sampler

    folder = Path(arguments.source)
    if (folder / HEADER_FILE).is_file():
        environment = load_environment(folder)
        scenario = _scenario(arguments.scenario)[0] if arguments.scenario else None
        return ScenarioFieldSampler(environment, scenario, gas=arguments.gas)
    if arguments.scenario:
        raise UsageError(f"--scenario: expected an environment folder of ours with it, was {arguments.source}.")
    if (folder / "scenario.yaml").is_file():
        return _run_fields(folder, arguments.gas)
    if folder.is_dir():
        stored = find_stored_field_sampler(folder, period_s=arguments.period)
        if stored is None:
            raise UsageError(
                f"{folder}: expected an environment folder ({HEADER_FILE}), a run (scenario.yaml), an environment of "
                "GSL-Bench (gas_data) or a result folder of GADEN (iteration_0, …), was a folder without any of them."
            )
        if arguments.gas is not None:
            raise UsageError("--gas: expected a run or a scenario with it; stored frames hold one gas.")
        return stored
    return _named_fields(arguments)


# The id of a run, or a scenario, whose environment is then made.
def _named_fields(arguments: argparse.Namespace) -> "FieldSampler":
    from gslcosim.environment.generation.cache import prepare_environment
    from gslcosim.environment.store import load_environment
    from gslcosim_formats.field_samplers import ScenarioFieldSampler

    runs_dir: Path = arguments.runs_dir
    found = sorted(runs_dir.glob("*/scenario.yaml")) if runs_dir.is_dir() else []
    runs = [path for path in found if path.parent.name.startswith(arguments.source)]
    exact = [path for path in runs if path.parent.name == arguments.source]
    is_scenario = Path(arguments.source).is_file() or _is_bundled(arguments.source)
    if exact or (len(runs) == 1 and not is_scenario):
        return _run_fields((exact or runs)[0].parent, arguments.gas)
    if not is_scenario:
        raise UsageError(
            f"{arguments.source}: expected a folder, a scenario, or the id of one run in {runs_dir}, "
            f"was {len(runs)} runs and no folder or scenario."
        )
    scenario, directory = _scenario(arguments.source)
    environment = load_environment(prepare_environment(scenario, scenario_dir=directory))
    return ScenarioFieldSampler(environment, scenario, gas=arguments.gas)


def _is_bundled(name: str) -> bool:
    from gslcosim.base.bundled import bundled_scenarios

    return name in bundled_scenarios()


def _scenario(source: str) -> "tuple[Scenario, Path]":
    from gslcosim.environment.positions import draw_positions
    from gslcosim.scenario import load_scenario

    loaded = load_scenario(source, placer=draw_positions)
    return loaded.scenario, loaded.directory


def _run_fields(folder: Path, gas: str | None) -> "FieldSampler":
    from gslcosim.runtime.run_dir import RunDir
    from gslcosim_formats.field_samplers import ScenarioFieldSampler

    scenario = RunDir(folder).load_scenario()
    return ScenarioFieldSampler(_environment_of_run(folder, scenario), scenario, gas=gas)


# The one that the run had; when the cache was cleared since, the same one made again.
def _environment_of_run(folder: Path, scenario: "Scenario") -> "Environment":
    from gslcosim.base.untrusted_input import MalformedFileError
    from gslcosim.environment.generation.cache import prepare_environment
    from gslcosim.environment.store import load_environment
    from gslcosim.runtime.run_dir import RunDir

    try:
        return load_environment(Path(RunDir(folder).load_setup()["environment"]))
    except (MalformedFileError, EnvironmentDataError):
        return load_environment(prepare_environment(scenario, scenario_dir=folder))


# Turns a file that cannot be written into an error that says which.
@contextmanager
def _written(path: Path) -> Generator[None]:
    try:
        yield
    except OSError as error:
        raise build_path_error(error, "--out", "a file that can be written", path=path) from error


def _check_file_name(arguments: argparse.Namespace) -> None:
    suffixes = (".csv",) if arguments.points is not None else (".csv", ".npz")
    if arguments.points is not None and arguments.out.suffix == ".npz":
        raise UsageError(f"--out: expected a csv file with --points, was {arguments.out}.")
    if arguments.grid is not None and arguments.out.suffix not in suffixes:
        raise UsageError(f"--out: expected a file that ends with .csv or .npz with --grid, was {arguments.out}.")
    if not arguments.out.parent.is_dir():
        raise UsageError(f"--out: expected a folder that is there, was {arguments.out.parent}.")


def _write_summary(arguments: argparse.Namespace, values: "NDArray[np.float64]") -> None:
    name = (GAS_COLUMNS if arguments.quantity == "gas" else WIND_COLUMNS)[-1]
    low, high = float(values.min()), float(values.max())
    if arguments.json:
        write_json({"out": str(arguments.out), "points": int(values.size), "value": name, "min": low, "max": high})
    else:
        write(f"{arguments.out}: {values.size} points, {name} from {low:.6g} to {high:.6g}.")


COMMAND = Command(
    name="sample",
    old_name="sample",
    is_computing=True,
    summary="sample gas or wind at points or on a grid, at a time, into a file",
    examples=EXAMPLES,
    add_arguments=_add_arguments,
    run=_run,
)
