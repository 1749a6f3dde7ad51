"""Catalogue of vehicles by name, and their parameters, as they stand in the `parameters.yaml` of each folder."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields
from functools import cache
from itertools import combinations
from pathlib import Path
from types import ModuleType
from typing import Any, Literal, TypeVar, cast, get_args

import numpy as np
import yaml
from numpy.typing import NDArray

from gslcosim.base.errors import VehicleError
from gslcosim.base.files import read_regular_file
from gslcosim.base.plugins import EntryPoints, PluginError
from gslcosim.base.quantities import Vec3
from gslcosim.base.scalar_kernels import distance, norm2
from gslcosim.base.yaml_core import CoreLoader

Kind = Literal["multirotor", "holonomic", "wheels"]
# Four is the least that can push and turn about all axes; the compiled loop has room for sixteen.
MIN_ROTORS, MAX_ROTORS = 4, 16
KINDS: tuple[Kind, ...] = get_args(Kind)
PARAMETERS_FILE = "parameters.yaml"
_TEXT_SECTIONS = ("description", "kind")
# Numbers that may be zero or negative; lists may hold any.
_SIGNED_PARAMETERS = ("axle_height_m", "integral_gain_s3", "integral_limit_m_s2")
Parameters = TypeVar("Parameters")
# Third parties add theirs under this name; each entry point is a folder's path, or a module in the folder.
VEHICLE_ENTRY_POINTS = "gslcosim.vehicles"
_ENTRY_POINTS = EntryPoints(group=VEHICLE_ENTRY_POINTS, what="vehicle")
VEHICLES_DIR = Path(__file__).parent


@dataclass(frozen=True, kw_only=True)
class BodyParameters:
    """Mass of a vehicle, its reach from its centre, and how fast it turns.

    `radius_m` is its reach seen from above, `half_height_m` that of its lowest point below its centre.
    """

    mass_kg: float
    radius_m: float
    half_height_m: float
    max_yaw_rate_rad_s: float


@dataclass(frozen=True, kw_only=True)
class ControlParameters:
    """Gains of a vehicle in the air.

    Gains are per unit of mass and inertia: position [1/s^2], velocity [1/s], integral [1/s^3], attitude [1/s^2] and
    rate [1/s] about the body axes.
    """

    position_gain_s2: float
    velocity_gain_s: float
    integral_gain_s3: float
    integral_limit_m_s2: float
    max_tilt_rad: float
    attitude_gain_s2: Vec3
    rate_gain_s: Vec3


@dataclass(frozen=True, kw_only=True)
class RotorParameters:
    """Rotors and drag of a vehicle.

    `rotor_places_m` are the centres of the n rotors, body frame [m]; each pushes along body z.
    `rotor_directions` has the turn of each seen from above: 1 counter-clockwise, -1 clockwise.
    """

    rotor_places_m: tuple[Vec3, ...]
    rotor_radius_m: float
    rotor_directions: tuple[float, ...]
    thrust_coefficient_n_s2: float
    torque_per_thrust_m: float
    max_rotor_speed_rad_s: float
    time_constant_up_s: float
    time_constant_down_s: float
    rotor_drag_n_s2_m: Vec3
    drag_area_m2: Vec3
    air_density_kg_m3: float

    @property
    def n_rotors(self) -> int:
        """Number of rotors."""
        return len(self.rotor_places_m)

    @property
    def motor_distance_m(self) -> float:
        """The longest distance between two rotors: that along the diagonal, seen from above [m]."""
        return max(distance(a[:2], b[:2]) for a, b in combinations(self.rotor_places_m, 2))

    @property
    def reach_m(self) -> float:
        """Reach of the discs of the rotors from the vehicle's centre, seen from above [m]."""
        return max(norm2(x_m, y_m) for x_m, y_m, _ in self.rotor_places_m) + self.rotor_radius_m

    def wrench_from_thrusts(self) -> NDArray[np.float64]:
        """Return the allocation matrix, (4, n): rows thrust and torque about x, y, z; a column for each rotor.

        A rotor at (x, y) with direction s gives (1, y, -x, -s k) for each newton of thrust.
        [1], [m] = [N], [N m] for each [N]

        Source:
            Mellinger and Kumar 2011, doi:10.1109/ICRA.2011.5980409, equation 2, for rotors anywhere in the plane.
        Held by:
            tests/unit/services/world/test_rotors.py, tests/unit/vehicles/test_parameters.py
        """
        columns = [
            [1.0, y_m, -x_m, -direction * self.torque_per_thrust_m]
            for (x_m, y_m, _), direction in zip(self.rotor_places_m, self.rotor_directions, strict=True)
        ]
        return np.array(columns).T


@dataclass(frozen=True, kw_only=True)
class WheelParameters:
    """Drive of a vehicle on two wheels and a caster behind them; places in the body frame [m]."""

    wheel_radius_m: float
    half_track_m: float
    axle_height_m: float
    caster_place_m: Vec3
    caster_radius_m: float
    max_speed_m_s: float
    max_acceleration_m_s2: float
    max_wheel_torque_n_m: float
    wheel_gain_n_m_s: float
    wheel_integral_gain_n_m: float
    along_gain_s: float
    across_gain_m2: float
    heading_gain_s: float


@dataclass(frozen=True, kw_only=True)
class RotorDrawing:
    """Drawing of a vehicle with rotors in recordings: half sizes of its hull [m], and its enlargement."""

    hull_half_m: Vec3
    scale: float


@dataclass(frozen=True, kw_only=True)
class WheelDrawing:
    """Drawing of a vehicle on wheels: width of the wheels, and centres and half sizes of two boxes, body frame [m]."""

    wheel_width_m: float
    chassis_centre_m: Vec3
    chassis_half_m: Vec3
    plate_centre_m: Vec3
    plate_half_m: Vec3


Drawing = RotorDrawing | WheelDrawing


@dataclass(frozen=True, kw_only=True)
class Vehicle:
    """A vehicle as it stands in its folder; meaning and origin of each number are in the folder's `parameters.yaml`.

    A `multirotor` has `rotors`, and `control` holds it in the air. A `holonomic` one has `control` alone: it
    is moved by any force and does not feel the air. One on `wheels` drives. `drawing` is absent for a ball.
    """

    name: str
    description: str
    kind: Kind
    folder: Path
    body: BodyParameters
    control: ControlParameters | None
    rotors: RotorParameters | None
    wheels: WheelParameters | None
    drawing: Drawing | None

    @property
    def mjcf_path(self) -> Path:
        """The file of its one body in MuJoCo's format."""
        return self.folder / f"{self.name}.xml"

    @property
    def drives(self) -> bool:
        """True where the vehicle stays on the ground."""
        return self.kind == "wheels"

    @property
    def drawn_scale(self) -> float:
        """Enlargement of its drawing in recordings."""
        return self.drawing.scale if isinstance(self.drawing, RotorDrawing) else 1.0


# The sections that a vehicle of a kind has, besides its description and its kind.
_SECTIONS: dict[Kind, dict[str, type[Any]]] = {
    "multirotor": {
        "body": BodyParameters,
        "control": ControlParameters,
        "rotors": RotorParameters,
        "drawing": RotorDrawing,
    },
    "holonomic": {"body": BodyParameters, "control": ControlParameters},
    "wheels": {"body": BodyParameters, "wheels": WheelParameters, "drawing": WheelDrawing},
}


# Read once in a process: a suite flies the same vehicle thousands of times.
@cache
def read_vehicle(name: str, folder: Path) -> Vehicle:
    """Return the vehicle of a folder.

    Args:
        name: Its name, which is that of the MJCF too.
        folder: Holds `parameters.yaml` and `<name>.xml`.

    Raises:
        VehicleError: a file is missing, or a parameter is missing, unknown, without origin or no number that it can
            be; all of it in one text.
    """
    path = folder / PARAMETERS_FILE
    sections = _load_sections(name, path)
    problems: list[str] = []
    if not (folder / f"{name}.xml").is_file():
        problems.append(f"{name}.xml: expected the MJCF of the vehicle beside {PARAMETERS_FILE}, found none.")
    kind, description = sections.get("kind"), sections.get("description")
    if not isinstance(description, str) or not description.strip():
        problems.append("description: expected one sentence, was missing.")
    if kind not in KINDS:
        problems.append(f"kind: expected one of {', '.join(KINDS)}, was {kind!r}.")
        raise _build_error(name, path, problems)
    read = _read_sections(kind, sections, problems)
    if not problems and read.get("rotors") is not None:
        problems += _find_rotor_problems(cast("RotorParameters", read["rotors"]))
    if problems:
        raise _build_error(name, path, problems)
    parts: dict[str, Any] = dict.fromkeys(("control", "rotors", "wheels", "drawing")) | read
    return Vehicle(name=name, description=str(description).strip(), kind=cast("Kind", kind), folder=folder, **parts)


def _load_sections(name: str, path: Path) -> dict[str, Any]:
    try:
        sections = yaml.load(read_regular_file(path).decode(), Loader=CoreLoader)
    except OSError as error:
        raise _build_error(
            name, path, [f"expected a file that can be read, was one that cannot ({error.strerror})."]
        ) from error
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise _build_error(name, path, [f"expected YAML, got: {error}."]) from error
    if not isinstance(sections, dict):
        raise _build_error(name, path, [f"expected a map of sections, was {type(sections).__name__}."])
    return cast("dict[str, Any]", sections)


def _read_sections(kind: Kind, sections: dict[str, Any], problems: list[str]) -> dict[str, Any]:
    wanted = _SECTIONS[kind]
    problems += [
        f"{section}: expected one of the sections {', '.join(wanted)} of kind {kind}."
        for section in sections
        if section not in wanted and section not in _TEXT_SECTIONS
    ]
    return {section: _read_parameters(type_, sections, section, problems) for section, type_ in wanted.items()}


def _read_parameters(
    type_: type[Parameters], sections: dict[str, Any], section: str, problems: list[str]
) -> Parameters | None:
    entries = _as_map(sections.get(section))
    types = {field.name: field.type for field in fields(cast("Any", type_))}
    found = [f"{section}.{key}: expected a parameter, was missing." for key in sorted(types.keys() - entries.keys())]
    found += [f"{section}.{key}: expected one of {sorted(types)}." for key in sorted(entries.keys() - types.keys())]
    values: dict[str, Any] = {}
    for key in sorted(entries.keys() & types.keys()):
        entry = _as_map(entries[key])
        values[key] = _parse_numbers(types[key], entry.get("value"))
        if not entry.get("origin"):
            found.append(f"{section}.{key}: expected an origin, was missing.")
        if values[key] is None or (types[key] is float and key not in _SIGNED_PARAMETERS and values[key] <= 0.0):
            found.append(
                f"{section}.{key}: expected {_describe_expected(types[key], key)}, was {entry.get('value')!r}."
            )
    problems += found
    return None if found else type_(**values)


def _as_map(value: Any) -> dict[str, Any]:
    return cast("dict[str, Any]", value) if isinstance(value, dict) else {}


# A number, or a tuple of numbers or of tuples, as the field's type requires; None if the value is something else.
def _parse_numbers(type_: Any, value: Any) -> Any:
    if type_ is float:
        is_number = isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
        return float(value) if is_number else None
    kinds = get_args(type_)
    if not isinstance(value, list) or (kinds[-1] is not Ellipsis and len(cast("list[Any]", value)) != len(kinds)):
        return None
    items = tuple(_parse_numbers(kinds[0], item) for item in cast("list[Any]", value))
    return None if None in items else items


def _describe_expected(type_: Any, key: str) -> str:
    if type_ is float:
        return "a number" if key in _SIGNED_PARAMETERS else "a number greater than 0"
    first, last = get_args(type_)[0], get_args(type_)[-1]
    if last is not Ellipsis:
        return f"a list of {len(get_args(type_))} numbers"
    return "a list of numbers" if first is float else "a list of places, each a list of 3 numbers"


def _find_rotor_problems(rotors: RotorParameters) -> Iterator[str]:
    n_rotors, n_directions = rotors.n_rotors, len(rotors.rotor_directions)
    if not MIN_ROTORS <= n_rotors <= MAX_ROTORS:
        yield f"rotors.rotor_places_m: expected {MIN_ROTORS} to {MAX_ROTORS} places, was {n_rotors}."
    elif n_rotors != n_directions:
        yield f"rotors.rotor_directions: expected {n_rotors}, one for each place, was {n_directions}."
    elif any(abs(direction) != 1.0 for direction in rotors.rotor_directions):
        yield f"rotors.rotor_directions: expected 1 or -1 for each rotor, was {list(rotors.rotor_directions)}."
    elif np.linalg.matrix_rank(rotors.wrench_from_thrusts()) < MIN_ROTORS:
        yield "rotors: expected places and directions that can turn the vehicle about all axes, was some that cannot."


def _build_error(name: str, path: Path, problems: Sequence[str]) -> VehicleError:
    return VehicleError("\n".join([f"vehicle {name}: {problem}" for problem in problems] + [f"File: {path}"]))


@cache
def list_vehicle_names() -> tuple[str, ...]:
    """Return the names of all vehicles: gslcosim's, which are the folders beside this file, then those of packages."""
    own = _list_own_names()
    return (*own, *sorted({*_ENTRY_POINTS.names()} - set(own)))


def is_vehicle(name: str) -> bool:
    """Return whether there is a vehicle of a name."""
    return name in _list_own_names() or name in list_vehicle_names()


def get_vehicle(name: str) -> Vehicle:
    """Return the facts of a vehicle.

    A package offers a vehicle by an entry point of the group `gslcosim.vehicles`; it is imported here, at the first
    request for the vehicle. gslcosim's own vehicles cannot be replaced.

    Raises:
        VehicleError: there is none, or its folder is not what it should be.
    """
    if name in _list_own_names():
        return read_vehicle(name, VEHICLES_DIR / name)
    return _find_offered(name)


@cache
def _list_own_names() -> tuple[str, ...]:
    return tuple(sorted(path.parent.name for path in VEHICLES_DIR.glob(f"*/{PARAMETERS_FILE}")))


@cache
def _find_offered(name: str) -> Vehicle:
    if name not in _ENTRY_POINTS.names():
        raise VehicleError(f"vehicle: expected one of {', '.join(list_vehicle_names())}, was {name!r}.")
    try:
        folder = _ENTRY_POINTS.loaded(name, _resolve_folder, "a folder's path, or a module in the folder")
    except PluginError as error:
        raise VehicleError(f"vehicle {name}: {error}") from error
    return read_vehicle(name, folder)


def _resolve_folder(offered: object) -> Path | None:
    folder = _resolve_path(offered)
    return folder.resolve() if folder is not None and folder.is_dir() else None


def _resolve_path(offered: Any) -> Path | None:
    if isinstance(offered, ModuleType):
        # A package without __init__.py has no file, but a place.
        file = getattr(offered, "__file__", None)
        places = [str(Path(file).parent)] if file else list(getattr(offered, "__path__", ()))
        return Path(places[0]) if places else None
    return Path(offered) if isinstance(offered, str | Path) else None
