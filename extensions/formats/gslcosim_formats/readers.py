"""Readers of rooms and winds that scenarios name, found by entry points such as `environment.geometry`."""

import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from gslcosim.base.errors import EnvironmentDataError
from gslcosim.base.problems import Problem
from gslcosim.environment.geometry_source import find_folder
from gslcosim.environment.grid_kernels import find_air_cells
from gslcosim.environment.model import (
    Cell,
    Environment,
    EnvironmentGeometry,
    ImpossibleEnvironmentError,
    Opening,
    WindFrames,
    raise_if_any,
)
from gslcosim.environment.openings import find_face, find_inflow_problems
from gslcosim.environment.readers import RoomReader, WindSetup
from gslcosim.scenario.models.scenario import EnvironmentSpec, SolverSpec
from gslcosim.scenario.models.wind import WindSpec
from gslcosim_formats.environment_folders import (
    import_gaden,
    import_gsl_bench,
    load_gaden_geometry,
    load_gsl_bench_geometry,
)
from gslcosim_formats.geometry.solid_geometry import geometry_from_files
from gslcosim_formats.openfoam import solve_wind_openfoam
from gslcosim_formats.scenario_keys import GEOMETRY as GEOMETRY_KEY
from gslcosim_formats.scenario_keys import GeometrySpec
from gslcosim_formats.wind_files import NoWindWarning, load_wind


@dataclass(frozen=True, kw_only=True)
class _FolderReader:
    """Reader of the folders of one kind of program.

    Attributes:
        maker: Name of the program, for errors.
        load_geometry: Returns the room of a folder without wind.
        load: Returns it with its wind.
    """

    maker: str
    load_geometry: Callable[[Path], EnvironmentGeometry]
    load: Callable[..., Environment]

    def read(self, spec: EnvironmentSpec, wind: SolverSpec, scenario_dir: Path | None) -> EnvironmentGeometry:
        """Return the room with the scenario's wind at its inlets."""
        room = self.load_geometry(find_folder(spec, scenario_dir))
        raise_if_any(_find_inflow_problems(room, wind))
        return add_inflow(room, wind)

    def find_problems(self, spec: EnvironmentSpec, wind: SolverSpec, scenario_dir: Path | None) -> list[Problem]:
        """Return why the folder cannot be read, or the wind does not enter."""
        try:
            room = self.load_geometry(find_folder(spec, scenario_dir))
        except EnvironmentDataError as error:
            key = spec.folder_key or ""
            return [
                Problem(
                    where=f"environment.{key}",
                    expected=f"the folder of a whole environment of {self.maker}",
                    found=str(getattr(spec, key)),
                    remedy=str(error).replace("\n", " "),
                )
            ]
        return _find_inflow_problems(room, wind)

    def read_wind(self, spec: EnvironmentSpec, wind: WindSpec, scenario_dir: Path | None) -> WindFrames | None:
        """Return the wind that the folder brings, if it does; what is wrong with it is a warning."""
        folder = find_folder(spec, scenario_dir)
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            environment = self.load(folder, period_s=wind.period_s, is_looping=wind.loops)
        if any(issubclass(warning.category, NoWindWarning) for warning in caught):
            return None
        for warning in caught:
            warnings.warn_explicit(warning.message, warning.category, warning.filename, warning.lineno)
        return environment.wind


def read_wind_file(wind: WindSpec, setup: WindSetup) -> WindFrames:
    """Return the wind of a scenario's file, folder or series of files, in the cells of the room."""
    assert wind.file is not None, "only solver: {file: PATH} names one"
    setup.progress("Reading the wind", 0.0)
    path, room = (setup.scenario_dir or Path()) / Path(wind.file).expanduser(), setup.room
    return load_wind(path, room.grid, occupancy=room.occupancy, period_s=wind.period_s, is_looping=wind.loops)


def solve_wind_by_openfoam(wind: WindSpec, setup: WindSetup) -> WindFrames:
    """Return the wind of a scenario that OpenFOAM solves."""
    from gslcosim.environment.generation.wind import build_patches

    room = setup.room
    assert wind.end_time_s is not None, "the scenario's model asks for it"
    velocity_m_s = solve_wind_openfoam(
        find_air_cells(room.occupancy),
        room.grid.cell_m,
        build_patches(room, wind),
        end_time_s=wind.end_time_s,
        average_from_s=wind.average_from_s,
        turbulence=wind.turbulence,
        courant=wind.courant,
        progress=lambda fraction: setup.progress("Solving the wind with OpenFOAM", fraction),
    )
    # Air leaves through cells that an opening encloses, but the room has them solid.
    velocity_m_s[room.occupancy == Cell.SOLID] = 0
    return WindFrames(velocity_m_s=velocity_m_s[np.newaxis])


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


def _find_inflow_problems(room: EnvironmentGeometry, wind: SolverSpec) -> list[Problem]:
    if not wind.solves:
        return []
    faces = [find_face(each, room.grid) for each in room.openings if each.kind == "inlet"]
    return [problem for face in faces[:1] if face for problem in find_inflow_problems(wind.inlet_velocity_m_s, face)]


def _read_geometry(spec: EnvironmentSpec, wind: SolverSpec, scenario_dir: Path | None) -> EnvironmentGeometry:
    return geometry_from_files(_geometry_of(spec), wind, base_dir=scenario_dir or Path())


# A room from geometry is known to be one only once it is made.
def _find_geometry_problems(spec: EnvironmentSpec, wind: SolverSpec, scenario_dir: Path | None) -> list[Problem]:
    try:
        _read_geometry(spec, wind, scenario_dir)
    except ImpossibleEnvironmentError as error:
        return list(error.problems)
    except EnvironmentDataError as error:
        return [
            Problem(
                where="environment.geometry.files",
                expected="files of geometry that can be read",
                found=", ".join(_geometry_of(spec).files),
                remedy=str(error).replace("\n", " "),
            )
        ]
    return []


def _geometry_of(spec: EnvironmentSpec) -> GeometrySpec:
    geometry = GEOMETRY_KEY.get(spec)
    assert geometry is not None, "the reader of environment.geometry reads no other"
    return geometry


_GADEN_FOLDERS = _FolderReader(maker="GADEN", load_geometry=load_gaden_geometry, load=import_gaden)
_GSL_BENCH_FOLDERS = _FolderReader(
    maker="GSL-Bench or AutoGDM+", load_geometry=load_gsl_bench_geometry, load=import_gsl_bench
)
GEOMETRY = RoomReader(
    read=_read_geometry,
    find_problems=_find_geometry_problems,
    scale=(
        "environment.geometry.scale",
        "For files in centimetres give scale: 0.01, in millimetres scale: 0.001.",
    ),
)
GADEN, GSL_BENCH = (
    RoomReader(read=folders.read, find_problems=folders.find_problems, read_wind=folders.read_wind)
    for folders in (_GADEN_FOLDERS, _GSL_BENCH_FOLDERS)
)
