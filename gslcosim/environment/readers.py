"""Readers that extensions register: rooms from files and folders of other programs, and wind from elsewhere.

The entry points of `gslcosim.geometry` have the keys of scenario files as their names: `environment.KEY` is a
`RoomReader`, `wind.solver.KIND` a `WindSource`.
"""

import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from gslcosim.base.errors import EnvironmentDataError
from gslcosim.base.extensions import GEOMETRY_GROUP, find_remedy, list_registered
from gslcosim.base.plugins import EntryPoints
from gslcosim.base.problems import Problem
from gslcosim.environment.model import EnvironmentGeometry, WindFrames
from gslcosim.scenario.models.scenario import EnvironmentSpec, SolverSpec
from gslcosim.scenario.models.wind import WindSpec

if TYPE_CHECKING:
    from gslcosim.flow.buoyancy import BuoyantScalar

Registered = TypeVar("Registered")
# Kinds of wind that extensions bring.
FOREIGN_WINDS = ("file", "openfoam")
Progress = Callable[[str, float], None]
_HEAT = "environment.heat"
_READERS = EntryPoints(group=GEOMETRY_GROUP, what="reader")


@dataclass(frozen=True, kw_only=True)
class RoomReader:
    """Reader of the rooms that a key of `environment` names.

    Attributes:
        read: Returns the room of an environment block, a wind block (for the inlets) and the scenario's folder. Raises
            `ScenarioError` for an impossible room, `EnvironmentDataError` for faulty files.
        find_problems: Returns all problems of reading the room, with the places in the scenario.
        read_wind: Returns the wind that the environment brings, None where it brings none; absent for formats without
            wind. Warnings are for the user.
        scale: Key that converts its lengths to metres, and the sentence of the remedy; absent: they are in metres.
    """

    read: Callable[[EnvironmentSpec, SolverSpec, Path | None], EnvironmentGeometry]
    find_problems: Callable[[EnvironmentSpec, SolverSpec, Path | None], list[Problem]]
    read_wind: Callable[[EnvironmentSpec, WindSpec, Path | None], WindFrames | None] | None = None
    scale: tuple[str, str] | None = None


@dataclass(frozen=True, kw_only=True)
class WindSetup:
    """Inputs of a wind builder besides its block.

    Attributes:
        room: Geometry, occupancy and openings.
        environment: Origin of the room; it may bring its wind.
        scenario_dir: Base folder of relative paths.
        progress: Receives the current step and its fraction done, from 0 to 1.
    """

    room: EnvironmentGeometry
    environment: EnvironmentSpec
    scenario_dir: Path | None
    progress: Progress


# Returns the wind in the cells of a room; raises `EnvironmentDataError` or `FlowError` where none fits.
WindSource = Callable[[WindSpec, WindSetup], WindFrames]


def find_room_reader(spec: EnvironmentSpec) -> RoomReader:
    """Return the reader of an environment that is neither a layout nor a path.

    Raises:
        EnvironmentDataError: no installed extension has it.
    """
    return _load(name_room_key(spec), lambda offered: offered if isinstance(offered, RoomReader) else None)


def find_wind_source(kind: str) -> WindSource:
    """Return the source of the winds of a kind, `file` or `openfoam`, from an extension.

    Raises:
        EnvironmentDataError: no installed extension has it.
    """
    return _load(f"wind.solver.{kind}", as_callable)


def find_heat_builder(
    spec: EnvironmentSpec,
) -> "Callable[[EnvironmentSpec, EnvironmentGeometry], BuoyantScalar] | None":
    """Return what builds the heat that drives the wind of a room, from an extension; None where it has no heat."""
    return None if getattr(spec, "heat", None) is None else _load(_HEAT, as_callable)


def as_callable(offered: object) -> Callable[..., Any] | None:
    """Return a function of an extension; None where it is something else."""
    return offered if callable(offered) else None


def name_room_key(spec: EnvironmentSpec) -> str:
    """Return the key of a scenario with the origin of its environment, such as `environment.gaden`."""
    return f"environment.{next(key for key in type(spec).model_fields if getattr(spec, key) is not None)}"


def list_reader_keys(spec: EnvironmentSpec, wind: SolverSpec) -> list[str]:
    """Return the keys of all readers that an environment with its wind needs."""
    keys = [] if spec.layout is not None or spec.path is not None else [name_room_key(spec)]
    keys += [] if getattr(spec, "heat", None) is None else [_HEAT]
    if spec.path is None and isinstance(wind, WindSpec) and wind.kind_name in FOREIGN_WINDS:
        keys.append(f"wind.solver.{wind.kind_name}")
    return keys


def list_reader_packages(spec: EnvironmentSpec, wind: SolverSpec) -> list[str]:
    """Return the import names of the packages with the readers that an environment with its wind needs."""
    keys = list_reader_keys(spec, wind)
    points = list_registered(GEOMETRY_GROUP) if keys else []
    return sorted({re.split(r"[.:]", point.value)[0] for point in points if point.name in keys})


def find_missing_readers(spec: EnvironmentSpec, wind: SolverSpec) -> list[Problem]:
    """Return a problem for each reader that an environment with its wind needs and no installed extension has."""
    keys = list_reader_keys(spec, wind)
    offered = _READERS.names() if keys else ()
    return [_missing(key) for key in keys if key not in offered]


def _load(key: str, accept: Callable[[object], Registered | None]) -> Registered:
    if key not in _READERS.names():
        raise EnvironmentDataError(str(_missing(key)))
    return _READERS.loaded(key, accept, f"a reader for {key}")


def _missing(key: str) -> Problem:
    remedy = find_remedy("keys", key) or "Install the package that has it."
    return Problem(where=key, expected="an installed extension that has it", found="none", remedy=remedy)
