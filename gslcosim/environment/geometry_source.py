"""Geometry of a scenario's environment: a layout built, or a folder or files read; and the same in still air."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from gslcosim.base.errors import EnvironmentDataError
from gslcosim.base.problems import Problem
from gslcosim.environment.layouts.layouts import build_layout, find_room_problems
from gslcosim.environment.model import (
    Environment,
    EnvironmentGeometry,
    ImpossibleEnvironmentError,
    Opening,
    WindFrames,
    raise_if_any,
    with_wind,
)
from gslcosim.environment.openings import find_face, find_inflow_problems
from gslcosim.environment.variants import (
    DOORS_PATH,
    add_closed_doors,
    find_cut_off_openings,
    find_door_problems,
    find_variants,
    scenario_in_variant,
)
from gslcosim.scenario.models.scenario import EnvironmentSpec, GeometrySpec, Scenario, SolverSpec, WindSpec
from gslcosim_formats.environment_folders import (
    import_gaden,
    import_gsl_bench,
    load_gaden_geometry,
    load_gsl_bench_geometry,
)
from gslcosim_formats.geometry.solid_geometry import geometry_from_files


def find_folder(spec: EnvironmentSpec, scenario_dir: Path | None) -> Path:
    """Return the folder that a scenario's environment is read from.

    Args:
        spec: An environment whose `folder_key` names one.
        scenario_dir: What a relative path is relative to; the working directory if absent.
    """
    assert spec.folder_key is not None, "a layout has no folder"
    folder = Path(getattr(spec, spec.folder_key)).expanduser()
    return folder if folder.is_absolute() or scenario_dir is None else scenario_dir / folder


def wind_file(wind: SolverSpec, scenario_dir: Path | None) -> Path:
    """Return the file or folder that a scenario's wind is read from."""
    assert wind.file is not None, "only solver: {file: …} names one"
    return (scenario_dir or Path()) / Path(wind.file).expanduser()


def build_geometry(spec: EnvironmentSpec, wind: SolverSpec, *, scenario_dir: Path | None = None) -> EnvironmentGeometry:
    """Return the room of an environment that has no wind yet; that is any but one with a `path`.

    Args:
        spec: What the scenario says of its environment.
        wind: Gives a generated room its cells, and the inlets their velocity.
        scenario_dir: What relative paths are relative to.

    Raises:
        ScenarioError: the layout is impossible; the text lists all reasons.
        EnvironmentDataError: a folder is not what it should be.
    """
    room = _room_without_doors(spec, wind, scenario_dir)
    if spec.doors:
        raise_if_any(_problems_with_doors(room, spec))
    return add_closed_doors(room, spec.doors)


def _problems_with_doors(room: EnvironmentGeometry, spec: EnvironmentSpec) -> list[Problem]:
    return find_door_problems(room, spec.doors) or find_cut_off_openings(add_closed_doors(room, spec.doors), DOORS_PATH)


def _room_without_doors(spec: EnvironmentSpec, wind: SolverSpec, scenario_dir: Path | None) -> EnvironmentGeometry:
    if spec.geometry is not None:
        return geometry_from_files(spec.geometry, wind, base_dir=scenario_dir or Path())
    raise_if_any(_problems_without_doors(spec, wind, scenario_dir))
    if spec.layout is not None:
        return build_layout(spec.layout, wind)
    return add_inflow(_read_room(spec, scenario_dir), wind)


def find_source_problems(spec: EnvironmentSpec, wind: SolverSpec, *, scenario_dir: Path | None = None) -> list[Problem]:
    """Return all that keeps a room from being made or read, with the places in the scenario."""
    problems = _problems_without_doors(spec, wind, scenario_dir)
    if problems or not spec.doors:
        return problems
    room = _room_without_doors(spec, wind, scenario_dir)
    return _problems_with_doors(room, spec)


def _problems_without_doors(spec: EnvironmentSpec, wind: SolverSpec, scenario_dir: Path | None) -> list[Problem]:
    if spec.layout is not None:
        return find_room_problems(spec.layout, wind)
    if spec.geometry is not None:
        return _problems_of_geometry(spec.geometry, wind, scenario_dir or Path())
    try:
        room = _read_room(spec, scenario_dir)
    except EnvironmentDataError as error:
        key = spec.folder_key or ""
        return [
            Problem(
                where=f"environment.{key}",
                expected=f"the folder of a whole environment of {_MAKERS[key]}",
                found=str(getattr(spec, key)),
                remedy=str(error).replace("\n", " "),
            )
        ]
    if not wind.solves:
        return []
    faces = [find_face(each, room.grid) for each in room.openings if each.kind == "inlet"]
    return [problem for face in faces[:1] if face for problem in find_inflow_problems(wind.inlet_velocity_m_s, face)]


# A room from geometry is known to be one only once it is made.
def _problems_of_geometry(spec: GeometrySpec, wind: SolverSpec, scenario_dir: Path) -> list[Problem]:
    try:
        geometry_from_files(spec, wind, base_dir=scenario_dir)
    except ImpossibleEnvironmentError as error:
        return list(error.problems)
    except EnvironmentDataError as error:
        remedy = str(error).replace("\n", " ")
        return [
            Problem(
                where="environment.geometry.files",
                expected="files of geometry that can be read",
                found=", ".join(spec.files),
                remedy=remedy,
            )
        ]
    return []


def load_imported_environment(
    spec: EnvironmentSpec, wind: WindSpec, *, scenario_dir: Path | None = None
) -> Environment:
    """Return the environment of an imported folder with the wind it brings, which is still where it brings none.

    Raises:
        EnvironmentDataError: a file is damaged, or the wind does not fit the room.

    Warns:
        NoWindWarning: there is no wind.
        WindGapsWarning: there is, with gaps.
    """
    assert spec.folder_key in _IMPORTERS, "layouts bring no wind"
    folder = find_folder(spec, scenario_dir)
    return _IMPORTERS[spec.folder_key](folder, period_s=wind.period_s, is_looping=wind.loops)


def add_inflow(room: EnvironmentGeometry, wind: SolverSpec) -> EnvironmentGeometry:
    """Return an imported room whose inlets have the scenario's wind, where they have none of their own.

    A room that marks no inlet, as GADEN's do not, gets one in each opening that the wind blows into.
    """
    has_inlet = any(each.kind == "inlet" for each in room.openings)
    openings = tuple(
        replace(each, kind="inlet", velocity_m_s=wind.inlet_velocity_m_s)
        if (each.kind == "inlet" and not any(each.velocity_m_s)) or (not has_inlet and _is_blown_into(each, room, wind))
        else each
        for each in room.openings
    )
    taken = [each.name for each in openings if each.kind == "inlet"] if not has_inlet else []
    notices = (f"Taken as inlets, as the wind blows into them: {', '.join(taken)}.",) if taken else ()
    return replace(room, openings=openings, notices=(*room.notices, *notices))


def _is_blown_into(opening: Opening, room: EnvironmentGeometry, wind: SolverSpec) -> bool:
    face = find_face(opening, room.grid)
    return face is not None and wind.inlet_velocity_m_s[face.axis] * face.inward > 0


_MAKERS = {"gsl_bench": "GSL-Bench or AutoGDM+", "gaden": "GADEN"}
_READERS = {"gsl_bench": load_gsl_bench_geometry, "gaden": load_gaden_geometry}
_IMPORTERS = {"gsl_bench": import_gsl_bench, "gaden": import_gaden}


def _read_room(spec: EnvironmentSpec, scenario_dir: Path | None) -> EnvironmentGeometry:
    assert spec.folder_key in _READERS, "an environment with a path has its wind already"
    return _READERS[spec.folder_key](find_folder(spec, scenario_dir))


def build_still_environment(scenario: Scenario, *, scenario_dir: Path) -> Environment:
    """Return the environment of a scenario with what events make of it, all of it without wind.

    Args:
        scenario: Its environment is any but one with a `path`.
        scenario_dir: Where its relative paths start.

    Raises:
        ScenarioError: the layout is impossible.
        EnvironmentDataError: a folder is not what it should be.
    """
    first, *later = find_variants(scenario)
    later_rooms = {variant: _build_room(scenario_in_variant(scenario, variant), scenario_dir) for variant in later}
    return replace(_build_room(scenario_in_variant(scenario, first), scenario_dir), later_rooms=later_rooms)


def _build_room(scenario: Scenario, scenario_dir: Path) -> Environment:
    room = build_geometry(scenario.environment, scenario.wind, scenario_dir=scenario_dir)
    return with_wind(room, WindFrames(velocity_m_s=np.zeros((1, *room.grid.shape, 3), np.float32)))
