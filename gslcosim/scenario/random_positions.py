"""Random positions: `random` found in a scenario's values, drawn elsewhere, put in."""

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

from pydantic import TypeAdapter, ValidationError

from gslcosim.base.quantities import Vec3
from gslcosim.scenario.models.scenario import EnvironmentSpec, SolverSpec, VehicleSpec
from gslcosim.scenario.models.wind import Wind
from gslcosim.scenario.problems import Problem, ProblemLike

RANDOM = "random"
_WIND = TypeAdapter[SolverSpec](Wind)
# What a place that cannot be drawn yet is refused with; told only where nothing else is wrong.
_AFTER_THE_OTHERS = "a random place once the other problems are solved"


@dataclass(frozen=True, kw_only=True)
class RandomPosition:
    """A place to draw: its path in the scenario, and the vehicle that is to stand there, if it is for one."""

    path: str
    vehicle: VehicleSpec | None = None


# From the environment, its wind, the scenario's folder and seed to a place for each that is wanted.
Placer = Callable[[EnvironmentSpec, SolverSpec, Path, int, Sequence[RandomPosition]], Mapping[str, Vec3]]


def replace_random_positions(values: dict[str, Any], directory: Path, placer: Placer | None) -> list[Problem]:
    """Replace `random` positions in a scenario's plain values, in place.

    Where nothing can be drawn because the environment or a vehicle has problems of its own, a stand-in takes their
    place, so that those problems are found.

    Args:
        values: The scenario as dicts, lists and scalars; modified.
        directory: The scenario's folder.
        placer: Draws the places; absent: `random` is refused.

    Returns:
        A problem for each place that cannot be drawn.
    """
    spots = list(_spots(values))
    if not spots:
        return []
    if placer is None:
        return [_refusal(path, "three numbers: the room is not known here") for path, _, _ in spots]
    try:
        environment = EnvironmentSpec.model_validate_json(json.dumps(values.get("environment")), strict=True)
        wind = _WIND.validate_json(json.dumps(values.get("wind", {})), strict=True)
        wanted = [RandomPosition(path=path, vehicle=_vehicle_in(block, key)) for path, block, key in spots]
    except ValidationError:
        for _, block, key in spots:
            block[key] = [0.0, 0.0, 0.0]
        return [_refusal(path, _AFTER_THE_OTHERS) for path, _, _ in spots]
    seed = values.get("seed", 0)
    places = placer(environment, wind, directory, seed if isinstance(seed, int) else 0, wanted)
    for path, block, key in spots:
        if path in places:
            block[key] = list(places[path])
    return [
        _refusal(path, "a room with free air, and space for the vehicle") for path, _, _ in spots if path not in places
    ]


def drop_consequent_problems(problems: Sequence[ProblemLike]) -> list[ProblemLike]:
    """Return problems without those of places that only wait for the others to be solved, if there are others."""
    causes = [p for p in problems if not (isinstance(p, Problem) and p.expected == _AFTER_THE_OTHERS)]
    return causes or list(problems)


def _refusal(path: str, expected: str) -> Problem:
    return Problem(path=path, expected=expected, found=RANDOM)


def _spots(values: dict[str, Any]) -> Iterator[tuple[str, dict[str, Any], str]]:
    for i, source in enumerate(_blocks(_block(values, "gas").get("sources"))):
        if source.get("position_m") == RANDOM:
            yield f"gas.sources[{i}].position_m", source, "position_m"
    for i, agent in enumerate(_blocks(values.get("agents"))):
        vehicle = _block(agent, "vehicle")
        if vehicle.get("start_m") == RANDOM:
            yield f"agents[{i}].vehicle.start_m", vehicle, "start_m"


def _vehicle_in(block: dict[str, Any], key: str) -> VehicleSpec | None:
    if key != "start_m":
        return None
    return VehicleSpec.model_validate_json(json.dumps({**block, key: [0, 0, 0]}), strict=True)


def _block(values: dict[str, Any], key: str) -> dict[str, Any]:
    inner = values.get(key)
    return cast("dict[str, Any]", inner) if isinstance(inner, dict) else {}


# Everything that is no block is an empty one, so that numbers count as in the file.
def _blocks(items: Any) -> list[dict[str, Any]]:
    listed = cast("list[Any]", items) if isinstance(items, list) else []
    return [cast("dict[str, Any]", item) if isinstance(item, dict) else {} for item in listed]
