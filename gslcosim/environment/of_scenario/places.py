"""Places in a scenario against the room: sources in air, vehicles where they can stand and rise."""

from collections.abc import Iterator, Sequence
from itertools import combinations
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gslcosim.environment.grid import point_text
from gslcosim.environment.model import Cell, Environment
from gslcosim.environment.of_scenario.moving_doors import boxes_in_the_way, problems_of_moving_doors
from gslcosim.environment.room import Room
from gslcosim.environment.situations import scenarios_of_rooms
from gslcosim.environment.store import load_environment
from gslcosim.errors import EnvironmentDataError
from gslcosim.quantities import Vec3
from gslcosim.scenario.models.event_kinds import SourceMovesSpec
from gslcosim.scenario.models.scenario import AgentSpec, Scenario, VehicleSpec
from gslcosim.scenario.problems import Problem


def problems_of_places(scenario: Scenario, *, scenario_dir: Path | None = None) -> list[Problem]:
    """Return what is wrong with the room of a scenario and with the places in it, without solving any wind.

    Args:
        scenario: Its environment, sources and vehicles; its wind gives the room's cells.
        scenario_dir: What a relative `environment.path` is relative to; the working directory if absent.

    Returns:
        All problems of the room; if it has none, all problems of the places; empty when all is well.
    """
    from gslcosim.environment.of_scenario.room_origin import folder_of, problems_of_source, room_of

    spec = scenario.environment
    if spec.path is None:
        rooms = [each.environment for each in scenarios_of_rooms(scenario)]
        found = [each for room in rooms for each in problems_of_source(room, scenario.wind, scenario_dir=scenario_dir)]
        problems = list(dict.fromkeys(found))
        return problems or problems_of_places_in(scenario, room_of(spec, scenario.wind, scenario_dir=scenario_dir))
    try:
        environment = load_environment(folder_of(spec, scenario_dir))
    except EnvironmentDataError as error:
        return [
            Problem(
                path="environment.path",
                expected="the folder of a whole environment",
                found=f"{spec.path}",
                remedy=str(error).replace("\n", " "),
            )
        ]
    return problems_of_places_in(scenario, environment)


def problems_of_places_in(scenario: Scenario, room: Room | Environment) -> list[Problem]:
    """Return what is wrong with the places that a scenario names in a room; empty when all is well.

    Sources must be in air, wherever they move; vehicles must start in air, touch nothing but the floor, have room to
    rise to their search height, and not overlap.
    """
    problems = [
        problem
        for i, source in enumerate(scenario.gas.sources)
        if (problem := _problem_of_point(source.position_m, room, f"gas.sources[{i}].position_m"))
    ]
    problems += problems_of_points(
        [
            (f"events[{i}].to_m", event.to_m)
            for i, event in enumerate(scenario.events)
            if isinstance(event, SourceMovesSpec)
        ],
        room,
    )
    problems += problems_of_moving_doors(scenario, room)
    for i, agent in enumerate(scenario.agents):
        problems += _problems_of_vehicle(agent.vehicle, room, f"agents[{i}].vehicle")
    return problems + _problems_of_neighbours(scenario.agents)


def problems_of_points(points_m: Sequence[tuple[str, Vec3]], room: Room | Environment) -> list[Problem]:
    """Return a problem for each point, given with the place where it was written, that is not in a room's air."""
    problems = (_problem_of_point(point_m, room, path) for path, point_m in points_m)
    return [problem for problem in problems if problem]


def random_free_point_m(
    room: Room | Environment, rng: np.random.Generator, *, heights_m: tuple[float, float] = (0.5, 3.0)
) -> Vec3:
    """Return a point of the air, drawn evenly between two heights above the floor [m], for example for a source.

    All air of a room can be reached from its openings. Points keep a cell away from solids, where there are such.

    Raises:
        EnvironmentDataError: there is no air.
    """
    grid = room.grid
    is_air = room.occupancy != Cell.SOLID
    height_m = grid.axis_centres_m(2) - grid.origin_m[2]
    for is_wanted in (_is_clear(is_air) & _is_between(height_m, heights_m), _is_clear(is_air), is_air):
        cells = np.argwhere(is_wanted)
        if len(cells):
            point_m = (cells[int(rng.integers(len(cells)))] + 0.5) * grid.cell_m
            return _as_vec3(np.asarray(grid.origin_m, dtype=np.float64) + point_m)
    raise EnvironmentDataError(f"{room.name}: expected air to put a source in, was none.")


def _is_between(values: NDArray[np.float64], limits: tuple[float, float]) -> NDArray[np.bool_]:
    return (values >= limits[0]) & (values <= limits[1])


def can_start_at(start_m: Vec3, vehicle: VehicleSpec, room: Room | Environment) -> bool:
    """Return whether a vehicle can stand at a point of the world frame [m] and rise there to its search height."""
    is_free = _what_is_at(start_m, room) is None
    return is_free and not boxes_in_the_way(np.asarray([start_m]), vehicle, room)[0]


# Air whose six neighbours are air too; the walls around the grid are solid.
def _is_clear(is_air: NDArray[np.bool_]) -> NDArray[np.bool_]:
    padded = np.pad(is_air, 1)
    inner = slice(1, -1)
    is_clear = is_air.copy()
    for axis in range(3):
        for side in (slice(None, -2), slice(2, None)):
            window = [inner, inner, inner]
            window[axis] = side
            is_clear &= padded[tuple(window)]
    return is_clear


def nearest_free_point_m(position_m: Vec3, room: Room | Environment) -> Vec3 | None:
    """Return the centre of the air cell nearest to a point, world frame [m]; nothing when there is no air."""
    for centres_m, reach_m in _growing_surroundings(position_m, room):
        distances_m = np.linalg.norm(centres_m - np.asarray(position_m), axis=1)
        # Only cells within the reach are surely nearer than those outside the surroundings.
        if len(distances_m) and distances_m.min() <= reach_m:
            return _as_vec3(centres_m[int(np.argmin(distances_m))])
    return None


def _problem_of_point(position_m: Vec3, room: Room | Environment, path: str) -> Problem | None:
    found = _what_is_at(position_m, room)
    if found is None:
        return None
    free_m = nearest_free_point_m(position_m, room)
    return Problem(
        path=path,
        expected="a point in the room's air",
        found=f"{point_text(position_m)}, {found}",
        remedy=f"Nearest free point: {point_text(free_m)}." if free_m else "",
    )


# Says what is at a point when it is not air; nothing when it is.
def _what_is_at(position_m: Vec3, room: Room | Environment) -> str | None:
    grid = room.grid
    cell = grid.cell_of(np.asarray(position_m))
    if not bool(grid.contains_cell(cell)):
        return f"outside the room, which reaches from {point_text(grid.origin_m)} to {point_text(grid.max_m)} m"
    # A box is solid although its cell is not, where it does not hold the cell's centre.
    for box in room.boxes:
        if all(low <= p < high for low, p, high in zip(box.min_m, position_m, box.max_m, strict=True)):
            return f"inside {box.name}"
    if room.occupancy[tuple(cell)] == Cell.SOLID:
        return "inside a solid cell"
    return None


def _problems_of_vehicle(vehicle: VehicleSpec, room: Room | Environment, path: str) -> list[Problem]:
    problems = (
        _problem_of_height(vehicle, room, f"{path}.search_height_m"),
        _problem_of_start(vehicle, room, f"{path}.start_m"),
    )
    return [problem for problem in problems if problem]


def _problem_of_height(vehicle: VehicleSpec, room: Room | Environment, path: str) -> Problem | None:
    if vehicle.drives:
        return None
    radius_m = vehicle.facts.body.radius_m
    low_m, high_m = room.grid.origin_m[2] + radius_m, room.grid.max_m[2] - radius_m
    if low_m <= vehicle.search_height_m <= high_m:
        return None
    where = f"the ceiling is at {room.grid.max_m[2]:g} m and the {vehicle.model} keeps {radius_m:g} m from it"
    return Problem(
        path=path,
        expected=f"a height between {low_m:g} and {high_m:g} m ({where} and from the floor)",
        found=f"{vehicle.search_height_m:g} m",
        remedy=f"For example {min(2.0, (low_m + high_m) / 2):.3g} m." if low_m < high_m else "The room is too low.",
    )


def _problem_of_start(vehicle: VehicleSpec, room: Room | Environment, path: str) -> Problem | None:
    expected, found = "a point in the room's air", _what_is_at(vehicle.start_m, room)
    if found is None:
        hits = boxes_in_the_way(np.asarray([vehicle.start_m]), vehicle, room)[0]
        if not hits:
            return None
        expected = (
            f"{vehicle.facts.body.radius_m:g} m of free space around the {vehicle.model}, "
            f"from the start up to its search height of {vehicle.search_height_m:g} m"
        )
        found = f"{', '.join(hits)} in it"
    free_m = nearest_start_m(vehicle, room)
    return Problem(
        path=path,
        expected=expected,
        found=f"{point_text(vehicle.start_m)}, {found}",
        remedy=f"Nearest free start: {point_text(free_m)}." if free_m else "",
    )


def nearest_start_m(vehicle: VehicleSpec, room: Room | Environment) -> Vec3 | None:
    """Return the place nearest to a vehicle's start, at the same height, where it could start; nothing without one."""
    start_m = np.asarray(vehicle.start_m)
    for candidates_m, reach_m in _growing_surroundings(vehicle.start_m, room, is_level=True):
        # At the height that was asked for, where it is a height in the room.
        if room.grid.origin_m[2] <= start_m[2] < room.grid.max_m[2]:
            candidates_m[:, 2] = start_m[2]
        distances_m = np.linalg.norm(candidates_m - start_m, axis=1)
        hits = boxes_in_the_way(candidates_m, vehicle, room)
        free = [i for i in np.argsort(distances_m, kind="stable") if not hits[i] and distances_m[i] <= reach_m]
        if free:
            return _as_vec3(candidates_m[free[0]])
    return None


# Yields the centres of the air cells around a point, (n, 3) [m], and the distance [m] within which none is missing;
# the surroundings grow until they are the whole room. `is_level` keeps them to the layer of cells at the point.
def _growing_surroundings(
    position_m: Vec3, room: Room | Environment, *, is_level: bool = False
) -> Iterator[tuple[NDArray[np.float64], float]]:
    grid, point = room.grid, np.asarray(position_m)
    cell = np.clip(grid.cell_of(point), 0, np.asarray(grid.shape) - 1)
    outside_m = np.linalg.norm(point - np.clip(point, grid.origin_m, grid.max_m))
    reach, is_all = 4, False
    while not is_all:
        reaches = np.array([reach, reach, 0 if is_level else reach])
        low, high = np.maximum(cell - reaches, 0), np.minimum(cell + reaches + 1, grid.shape)
        is_all = (grid.shape[0], grid.shape[1]) == (high[0] - low[0], high[1] - low[1]) and (
            is_level or high[2] - low[2] == grid.shape[2]
        )
        reach_m = np.inf if is_all else float(np.hypot(outside_m, reach * grid.cell_m))
        yield _air_centres_m(room, low, high), reach_m
        reach *= 4


def _air_centres_m(room: Room | Environment, low: NDArray[np.int64], high: NDArray[np.int64]) -> NDArray[np.float64]:
    window = tuple(slice(int(a), int(b)) for a, b in zip(low, high, strict=True))
    indices = np.argwhere(room.occupancy[window] != Cell.SOLID) + low
    return np.asarray(room.grid.origin_m, dtype=np.float64) + (indices + 0.5) * room.grid.cell_m


def _problems_of_neighbours(agents: Sequence[AgentSpec]) -> list[Problem]:
    problems: list[Problem] = []
    for (_, first), (j, second) in combinations(enumerate(agents), 2):
        a, b = first.vehicle, second.vehicle
        apart_m = float(np.hypot(a.start_m[0] - b.start_m[0], a.start_m[1] - b.start_m[1]))
        least_m = a.facts.body.radius_m + b.facts.body.radius_m
        if apart_m >= least_m:
            continue
        problems.append(
            Problem(
                path=f"agents[{j}].vehicle.start_m",
                expected=f"at least {least_m:g} m, seen from above, from the start of {first.name}",
                found=f"{point_text(b.start_m)}, which is {apart_m:.3g} m from it",
                remedy=f"Move it {least_m - apart_m:.2f} m further away.",
            )
        )
    return problems


def _as_vec3(point_m: NDArray[np.float64]) -> Vec3:
    x_m, y_m, z_m = (round(float(coordinate_m), 6) for coordinate_m in point_m)
    return x_m, y_m, z_m
