"""Checks of a scenario's room: places in it, and the stored wind that blows through it."""

import math
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from gslcosim.base.errors import EnvironmentDataError
from gslcosim.base.problems import Problem
from gslcosim.base.scalar_kernels import norm3
from gslcosim.environment.generation.cache import find_environment
from gslcosim.environment.generation.provenance import WindMaker, find_mixed_air, read_wind_provenance
from gslcosim.environment.model import Grid
from gslcosim.environment.positions import find_position_problems, find_position_problems_in
from gslcosim.environment.readers import find_room_reader
from gslcosim.environment.variants import variant_scenarios
from gslcosim.scenario import Scenario
from gslcosim.scenario.models.scenario import EnvironmentSpec
from gslcosim.scenario.models.wind import WindSpec

if TYPE_CHECKING:
    from gslcosim.environment.generation.wind import SolvedWind

_BUILDER = "gslcosim.environment.geometry_source"

# Speed of the built-in solver on two cores, as an order of magnitude; `make bench-wind` measures it.
_CELL_STEPS_PER_S = 3e6
# Highest speed of the air over that at the inlets.
_PEAK_RATIO = 1.5
# Settling time of a wind without `end_time_s` in most rooms.
_USUAL_END_S = 60.0
_LONG_SOLVE_S = 1800.0
_LARGE_SOLVE_GB = 8.0
# Longer rooms are rarer than files in centimetres or millimetres.
_LONG_ROOM_M = 500.0


def find_place_problems(scenario: Scenario, directory: Path) -> Iterable[Problem]:
    """Return the problems of a scenario's room and of the places in it.

    Args:
        scenario: The scenario.
        directory: Its folder, base of relative paths.
    """
    # The first room that a process builds takes a third of a second, for the compiler of its kernels; loading a room
    # from the cache takes some milliseconds; building further ones takes less.
    if _BUILDER not in sys.modules:
        made = [find_environment(each, scenario_dir=directory) for each in variant_scenarios(scenario)]
        if made[0] is not None and all(made):
            return find_position_problems_in(scenario, made[0])
    return find_position_problems(scenario, scenario_dir=directory)


def find_stored_wind_problems(scenario: Scenario, directory: Path) -> Iterable[Problem]:
    """Return the problems of a wind that a scenario reads from files or from its environment's folder.

    The files are read in full, as in the preparation of a run.

    Args:
        scenario: Its wind is stored, or may be.
        directory: The scenario's folder, base of relative paths.
    """
    from gslcosim.environment.geometry_source import find_source_problems

    spec, wind = scenario.environment, scenario.wind
    if not isinstance(wind, WindSpec) or find_source_problems(spec, wind, scenario_dir=directory):
        return ()  # `find_place_problems` reports the problems of the room, and no wind fits it
    try:
        stored = _read_stored_wind(spec, wind, directory)
    except EnvironmentDataError as error:
        remedy = " ".join(str(error).split())
    else:
        if stored is not None or wind.solver != "stored":
            return ()
        remedy = "Take built_in to solve it, or solver: {file: PATH}."
    path, found = ("wind.solver", wind.kind_name) if wind.file is None else ("wind.solver.file", wind.file)
    return [Problem(where=path, expected="wind that fits the room", found=f"'{found}'", remedy=remedy)]


def find_mixed_air_problems(scenario: Scenario, directory: Path) -> Iterable[Problem]:
    """Return a warning where stored gas is played back beside a wind that did not carry it.

    Args:
        scenario: Its gas is stored.
        directory: The scenario's folder, base of relative paths.
    """
    mixed = find_mixed_air(scenario, _find_wind_maker(scenario, directory))
    return [] if mixed is None else [mixed]


def find_costly_wind_problems(scenario: Scenario, directory: Path) -> Iterable[Problem]:
    """Return warnings of a wind that is costly to solve, and of a room with lengths in a doubtful unit.

    Memory and time are orders of magnitude: steps follow from the Courant number at the inlets' velocity.

    Args:
        scenario: Its wind is to be solved.
        directory: The scenario's folder, base of relative paths.
    """
    spec, wind = scenario.environment, scenario.wind
    if not isinstance(wind, WindSpec) or find_environment(scenario, scenario_dir=directory) is not None:
        return ()
    from gslcosim.environment.geometry_source import build_geometry

    grid = build_geometry(spec, wind, scenario_dir=directory).grid
    return [*_find_unit_problems(spec, grid), *_find_cost_problems(wind, grid)]


def _find_unit_problems(spec: EnvironmentSpec, grid: Grid) -> Iterable[Problem]:
    length_m = max(grid.shape) * grid.cell_m
    if length_m <= _LONG_ROOM_M:
        return
    where, remedy = "environment.layout.size_m", "Lengths are in metres."
    if spec.layout is None and (scale := find_room_reader(spec).scale) is not None:
        where, remedy = scale
    expected = f"a room of at most {_LONG_ROOM_M:.0f} m"
    yield Problem(where=where, expected=expected, found=f"one of {length_m:,.0f} m", remedy=remedy)


def _find_cost_problems(wind: WindSpec, grid: Grid) -> Iterable[Problem]:
    from gslcosim.flow.domain import BYTES_PER_CELL

    n_cells = math.prod(grid.shape)
    step_s = wind.courant * grid.cell_m / max(_PEAK_RATIO * norm3(*wind.inlet_velocity_m_s), 1e-3)
    n_steps = (wind.end_time_s or _USUAL_END_S) / min(step_s, wind.max_step_s or math.inf)
    memory_gb, time_s = n_cells * BYTES_PER_CELL / 1e9, n_cells * n_steps / _CELL_STEPS_PER_S
    if time_s <= _LONG_SOLVE_S and memory_gb <= _LARGE_SOLVE_GB:
        return
    time = f"{time_s / 60:.0f} min" if time_s < 5400 else f"{time_s / 3600:,.0f} h"
    cost = f"about {time} on two cores and {max(memory_gb, 0.1):.1f} GB of memory"
    yield Problem(
        where="wind.cell_m",
        expected="cells whose wind is solved within half an hour and 8 GB",
        found=f"{grid.cell_m:g} m, {n_cells / 1e6:,.1f} million cells: {cost}",
        remedy="Cells of twice the size take a sixteenth of the time and an eighth of the memory.",
    )


# Before there is an environment; afterwards `read_wind_provenance` returns the same.
def _find_wind_maker(scenario: Scenario, directory: Path) -> WindMaker:
    from gslcosim.environment.geometry_source import find_folder

    spec, wind = scenario.environment, scenario.wind
    if spec.path is not None:
        return read_wind_provenance(scenario, find_folder(spec, directory)).maker
    if not isinstance(wind, WindSpec):
        return "package"
    if wind.file is not None:
        return "file"
    if wind.solver in ("openfoam", "uniform"):
        return wind.solver
    if spec.folder_key is not None and wind.solver in ("auto", "stored"):
        stored = _read_stored_wind(spec, wind, directory)
        return "built_in" if stored is None else "imported"
    return "built_in"


def _read_stored_wind(spec: EnvironmentSpec, wind: WindSpec, directory: Path) -> "SolvedWind | None":
    from gslcosim.environment.generation.wind import WindSetup, no_progress, read_stored_wind
    from gslcosim.environment.geometry_source import build_geometry

    room = build_geometry(spec, wind, scenario_dir=directory)
    setup = WindSetup(room=room, environment=spec, scenario_dir=directory, progress=no_progress)
    return read_stored_wind(wind, setup)
