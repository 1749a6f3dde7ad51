"""Reading the folder of a vehicle: every problem of its `parameters.yaml` in one error."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import fields
from functools import cache
from pathlib import Path
from typing import Any, TypeVar, cast, get_args

import numpy as np
import yaml

from gslcosim.errors import VehicleError
from gslcosim.safe_files import read_regular_file
from gslcosim.vehicles.facts import (
    KINDS,
    LEAST_ROTORS,
    MOST_ROTORS,
    BodyParameters,
    ControlParameters,
    Drawing,
    Kind,
    RotorDrawing,
    RotorParameters,
    Vehicle,
    WheelDrawing,
    WheelParameters,
)
from gslcosim.yaml_core import CoreLoader

PARAMETERS_FILE = "parameters.yaml"
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
_TEXTS = ("description", "kind")
# Numbers that may be zero or negative; lists may hold any.
_ANY_SIGN = ("axle_height_m", "integral_gain_s3", "integral_limit_m_s2")

Parameters = TypeVar("Parameters")


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
    sections = _sections_of(name, path)
    problems: list[str] = []
    if not (folder / f"{name}.xml").is_file():
        problems.append(f"{name}.xml: expected the MJCF of the vehicle beside {PARAMETERS_FILE}, found none.")
    kind, description = sections.get("kind"), sections.get("description")
    if not isinstance(description, str) or not description.strip():
        problems.append("description: expected one sentence, was missing.")
    if kind not in KINDS:
        problems.append(f"kind: expected one of {', '.join(KINDS)}, was {kind!r}.")
        raise _error(name, path, problems)
    read = _read_sections(kind, sections, problems)
    if not problems and read.get("rotors") is not None:
        problems += _problems_of_rotors(cast("RotorParameters", read["rotors"]))
    if problems:
        raise _error(name, path, problems)
    return Vehicle(
        name=name,
        description=str(description).strip(),
        kind=cast("Kind", kind),
        folder=folder,
        body=cast("BodyParameters", read["body"]),
        control=cast("ControlParameters | None", read.get("control")),
        rotors=cast("RotorParameters | None", read.get("rotors")),
        wheels=cast("WheelParameters | None", read.get("wheels")),
        drawing=cast("Drawing | None", read.get("drawing")),
    )


def _sections_of(name: str, path: Path) -> dict[str, Any]:
    try:
        sections = yaml.load(read_regular_file(path).decode(), Loader=CoreLoader)
    except OSError as error:
        raise _error(
            name, path, [f"expected a file that can be read, was one that cannot ({error.strerror})."]
        ) from error
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise _error(name, path, [f"expected YAML, got: {error}."]) from error
    if not isinstance(sections, dict):
        raise _error(name, path, [f"expected a map of sections, was {type(sections).__name__}."])
    return cast("dict[str, Any]", sections)


def _read_sections(kind: Kind, sections: dict[str, Any], problems: list[str]) -> dict[str, Any]:
    wanted = _SECTIONS[kind]
    problems += [
        f"{section}: expected one of the sections {', '.join(wanted)} of kind {kind}."
        for section in sections
        if section not in wanted and section not in _TEXTS
    ]
    return {section: _parameters(type_, sections, section, problems) for section, type_ in wanted.items()}


def _parameters(
    type_: type[Parameters], sections: dict[str, Any], section: str, problems: list[str]
) -> Parameters | None:
    entries = _as_map(sections.get(section))
    types = {field.name: field.type for field in fields(cast("Any", type_))}
    found = [f"{section}.{key}: expected a parameter, was missing." for key in sorted(types.keys() - entries.keys())]
    found += [f"{section}.{key}: expected one of {sorted(types)}." for key in sorted(entries.keys() - types.keys())]
    values: dict[str, Any] = {}
    for key in sorted(entries.keys() & types.keys()):
        entry = _as_map(entries[key])
        values[key] = _numbers(types[key], entry.get("value"))
        if not entry.get("origin"):
            found.append(f"{section}.{key}: expected an origin, was missing.")
        if values[key] is None or (types[key] is float and key not in _ANY_SIGN and values[key] <= 0.0):
            found.append(f"{section}.{key}: expected {_words_of(types[key], key)}, was {entry.get('value')!r}.")
    problems += found
    return None if found else type_(**values)


def _as_map(value: Any) -> dict[str, Any]:
    return cast("dict[str, Any]", value) if isinstance(value, dict) else {}


# A number, or a tuple of numbers or of tuples, as the field's type says; nothing where the value is something else.
def _numbers(type_: Any, value: Any) -> Any:
    if type_ is float:
        is_number = isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
        return float(value) if is_number else None
    kinds = get_args(type_)
    if not isinstance(value, list) or (kinds[-1] is not Ellipsis and len(cast("list[Any]", value)) != len(kinds)):
        return None
    items = tuple(_numbers(kinds[0], item) for item in cast("list[Any]", value))
    return None if None in items else items


def _words_of(type_: Any, key: str) -> str:
    if type_ is float:
        return "a number" if key in _ANY_SIGN else "a number greater than 0"
    first, last = get_args(type_)[0], get_args(type_)[-1]
    if last is not Ellipsis:
        return f"a list of {len(get_args(type_))} numbers"
    return "a list of numbers" if first is float else "a list of places, each a list of 3 numbers"


def _problems_of_rotors(rotors: RotorParameters) -> Iterator[str]:
    n_rotors, n_directions = rotors.n_rotors, len(rotors.rotor_directions)
    if not LEAST_ROTORS <= n_rotors <= MOST_ROTORS:
        yield f"rotors.rotor_places_m: expected {LEAST_ROTORS} to {MOST_ROTORS} places, was {n_rotors}."
    elif n_rotors != n_directions:
        yield f"rotors.rotor_directions: expected {n_rotors}, one for each place, was {n_directions}."
    elif any(abs(direction) != 1.0 for direction in rotors.rotor_directions):
        yield f"rotors.rotor_directions: expected 1 or -1 for each rotor, was {list(rotors.rotor_directions)}."
    elif np.linalg.matrix_rank(rotors.wrench_from_thrusts()) < LEAST_ROTORS:
        yield "rotors: expected places and directions that can turn the vehicle about all axes, was some that cannot."


def _error(name: str, path: Path, problems: Sequence[str]) -> VehicleError:
    return VehicleError("\n".join([f"vehicle {name}: {problem}" for problem in problems] + [f"File: {path}"]))
