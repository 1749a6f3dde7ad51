"""Positions of sources and vehicles in an environment: checks, and random draws for scenarios that want them."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import combinations
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gslcosim.base.errors import EnvironmentDataError
from gslcosim.base.problems import Problem
from gslcosim.base.quantities import Vec3
from gslcosim.base.rng import stream
from gslcosim.base.scalar_kernels import distance, norm2, norm3
from gslcosim.environment.model import Box, Cell, EnvironmentGeometry, point_text, span_text
from gslcosim.environment.openings import voxelize
from gslcosim.environment.store import load_environment
from gslcosim.environment.variants import door_box, find_variants, variant_scenarios
from gslcosim.environment.vertical_clearance import clear_height_m, is_climb_sufficient
from gslcosim.scenario.loader import RandomPosition
from gslcosim.scenario.models.events import DoorClosesSpec, SourceMovesSpec
from gslcosim.scenario.models.scenario import AgentSpec, EnvironmentSpec, Scenario, SolverSpec, VehicleSpec

MAX_VARIANTS = 16
# Height above the floor of the bundled scenarios' starts [m].
START_HEIGHT_M = 0.2
# Heights of random sources above the floor, where there is air between them [m].
SOURCE_HEIGHTS_M = (0.5, 3.0)
N_TRIES = 10_000
_IN_AIR = "a point in the room's air"


def find_position_problems(scenario: Scenario, *, scenario_dir: Path | None = None) -> list[Problem]:
    """Return the problems of a scenario's room and of the places in it, without solving any wind.

    Args:
        scenario: Its environment, sources and vehicles; its wind gives the room's cells.
        scenario_dir: Base folder of a relative `environment.path`; the working directory if absent.

    Returns:
        All problems of the room; if it has none, all problems of the places.
    """
    # The builder of geometry loads a compiler, which a run in a cached room does not need.
    from gslcosim.environment.geometry_source import build_geometry, find_folder, find_source_problems

    spec = scenario.environment
    if spec.path is None:
        rooms = [each.environment for each in variant_scenarios(scenario)]
        found = [
            each for room in rooms for each in find_source_problems(room, scenario.wind, scenario_dir=scenario_dir)
        ]
        problems = list(dict.fromkeys(found))
        return problems or find_position_problems_in(
            scenario, build_geometry(spec, scenario.wind, scenario_dir=scenario_dir)
        )
    try:
        environment = load_environment(find_folder(spec, scenario_dir))
    except EnvironmentDataError as error:
        return [
            Problem(
                where="environment.path",
                expected="the folder of a whole environment",
                found=f"{spec.path}",
                remedy=str(error).replace("\n", " "),
            )
        ]
    return find_position_problems_in(scenario, environment)


def find_position_problems_in(scenario: Scenario, room: EnvironmentGeometry) -> list[Problem]:
    """Return the problems of a scenario's places in a room.

    Sources must be in air, also after a move, and so must probes; vehicles must start in air, touch nothing but the
    floor, have room to rise to their search height, and not overlap.
    """
    problems = find_point_problems(_list_points(scenario), room)
    problems += find_moving_door_problems(scenario, room)
    for i, agent in enumerate(scenario.agents):
        path = f"agents[{i}].vehicle"
        height_problem = _problem_of_height(agent.vehicle, room, f"{path}.search_height_m")
        start_problem = _problem_of_start(agent.vehicle, room, f"{path}.start_m")
        problems += [problem for problem in (height_problem, start_problem) if problem]
    return problems + _problems_of_neighbours(scenario.agents)


def find_point_problems(points_m: Sequence[tuple[str, Vec3]], room: EnvironmentGeometry) -> list[Problem]:
    """Return a problem for each point outside a room's air; points come with their places in the scenario."""
    problems = (_problem_of_point(point_m, room, path) for path, point_m in points_m)
    return [problem for problem in problems if problem]


def find_moving_door_problems(scenario: Scenario, room: EnvironmentGeometry) -> Iterator[Problem]:
    """Yield the problems of the door events of a scenario in its room.

    A door may not close on a vehicle's start, a source or a probe, and events may not need more than `MAX_VARIANTS`
    rooms.
    """
    n_variants = len(find_variants(scenario))
    if n_variants > MAX_VARIANTS:
        yield Problem(
            where="events",
            expected=f"at most {MAX_VARIANTS} combinations of closed doors and inlets, each of which is a room",
            found=f"{n_variants}",
            remedy="Give the events of doors and wind times (at_s): then only those that follow each other count.",
        )
    doors = {door.name: door_box(door) for door in scenario.environment.doors}
    for i, event in enumerate(scenario.events):
        if not isinstance(event, DoorClosesSpec) or event.door not in doors:
            continue
        hits = _hits(scenario, room, doors[event.door])
        if hits:
            yield Problem(
                where=f"events[{i}].door",
                expected="a door that closes on no vehicle's start, no source and no probe",
                found=f"{event.door}, which closes on {' and '.join(hits)}",
                remedy=f"Move the door, or {hits[0]}.",
            )


def find_blocking_boxes(
    starts_m: NDArray[np.float64], vehicle: VehicleSpec, room: EnvironmentGeometry
) -> list[list[str]]:
    """Return the names of the boxes, except the floor, in the column from each start up to the search height.

    Args:
        starts_m: (n, 3) places, world frame [m].
        vehicle: The vehicle to start there.
        room: The room.
    """
    body = vehicle.facts.body
    radius_m, half_height_m = body.radius_m, body.half_height_m
    # A search height above the ceiling is another problem.
    search_height_m = min(vehicle.search_height_m, room.grid.max_m[2] - radius_m)
    bottom_m = starts_m[:, 2]
    top_m = np.maximum(bottom_m, search_height_m) + half_height_m
    hits: list[list[str]] = [[] for _ in starts_m]
    for box in (box for box in room.boxes if box.kind != "floor"):
        low, high = np.asarray(box.min_m), np.asarray(box.max_m)
        beside_m = np.maximum(np.maximum(low[:2] - starts_m[:, :2], starts_m[:, :2] - high[:2]), 0.0)
        is_near = np.linalg.norm(beside_m, axis=1) < radius_m - 1e-9
        # A box that ends below the start carries the vehicle; only one that rises above it is in the way.
        for i in np.flatnonzero(is_near & (high[2] > bottom_m + 1e-9) & (low[2] < top_m)):
            hits[i].append(box.name)
    return hits


def can_start_at(start_m: Vec3, vehicle: VehicleSpec, room: EnvironmentGeometry) -> bool:
    """Return whether a vehicle can start at a point of the world frame [m] and rise there to its search height."""
    is_free = _what_is_at(start_m, room) is None
    return is_free and not find_blocking_boxes(np.asarray([start_m]), vehicle, room)[0]


def nearest_start_m(vehicle: VehicleSpec, room: EnvironmentGeometry) -> Vec3 | None:
    """Return the possible start nearest to a vehicle's start, at the same height; None without one."""
    start_m = np.asarray(vehicle.start_m)
    for candidates_m, reach_m in _growing_surroundings(vehicle.start_m, room, is_level=True):
        # At the scenario's height, where it is inside the room.
        if room.grid.origin_m[2] <= start_m[2] < room.grid.max_m[2]:
            candidates_m[:, 2] = start_m[2]
        distances_m = np.linalg.norm(candidates_m - start_m, axis=1)
        hits = find_blocking_boxes(candidates_m, vehicle, room)
        free = [i for i in np.argsort(distances_m, kind="stable") if not hits[i] and distances_m[i] <= reach_m]
        if free:
            return _rounded(candidates_m[free[0]])
    return None


def nearest_free_point_m(position_m: Vec3, room: EnvironmentGeometry) -> Vec3 | None:
    """Return the centre of the air cell nearest to a point, world frame [m]; None without air."""
    for centres_m, reach_m in _growing_surroundings(position_m, room):
        distances_m = np.linalg.norm(centres_m - np.asarray(position_m), axis=1)
        # Only cells within the reach are certainly nearer than those outside the surroundings.
        if len(distances_m) and distances_m.min() <= reach_m:
            return _rounded(centres_m[int(np.argmin(distances_m))])
    return None


def random_free_point_m(room: EnvironmentGeometry, rng: np.random.Generator) -> Vec3:
    """Return a point for a source, drawn evenly from the air between `SOURCE_HEIGHTS_M` and a cell away from solids.

    Where there is none, any height will do, and at last any air.
    """
    grid = room.grid
    is_air = room.occupancy != Cell.SOLID
    height_m = grid.axis_centres_m(2) - grid.origin_m[2]
    is_between = (height_m >= SOURCE_HEIGHTS_M[0]) & (height_m <= SOURCE_HEIGHTS_M[1])
    is_clear = _is_clear(is_air)
    for is_wanted in (is_clear & is_between, is_clear, is_air):
        cells = np.argwhere(is_wanted)
        if len(cells):
            return _rounded(grid.centres_of(cells[int(rng.integers(len(cells)))]))
    raise EnvironmentDataError(f"{room.name}: expected air to put a source in, was none.")


def draw_positions(
    spec: EnvironmentSpec, wind: SolverSpec, scenario_dir: Path, seed: int, wanted: Sequence[RandomPosition]
) -> Mapping[str, Vec3]:
    """Return places for random positions, each from a random stream of its own; those without a place are missing.

    Sources are at points of `random_free_point_m`; vehicles stand on the floor with free space up to their search
    height, at least a metre from other places. The start of a vehicle with `avoidance` has a path to the largest
    connected space.

    Args:
        spec: The scenario's environment block.
        wind: Gives a generated room its cells.
        scenario_dir: Base folder of relative paths.
        seed: Seed of the scenario.
        wanted: The positions to draw.
    """
    room = read_room(spec, wind, scenario_dir)
    places: dict[str, Vec3] = {}
    if room is None:
        return places
    for each in wanted:
        rng = stream(seed, f"scenario.{each.path}")
        if each.vehicle is None:
            places[each.path] = _rounded(random_free_point_m(room, rng))
        elif (start_m := _random_start_m(room, each.vehicle, rng, list(places.values()))) is not None:
            places[each.path] = start_m
    return places


def read_room(spec: EnvironmentSpec, wind: SolverSpec, scenario_dir: Path) -> EnvironmentGeometry | None:
    """Return the room of a scenario without solving its wind; None where it has problems."""
    from gslcosim.environment.geometry_source import build_geometry, find_folder, find_source_problems

    if spec.path is None:
        has_problems = bool(find_source_problems(spec, wind, scenario_dir=scenario_dir))
        return None if has_problems else build_geometry(spec, wind, scenario_dir=scenario_dir)
    try:
        return load_environment(find_folder(spec, scenario_dir))
    except EnvironmentDataError:
        return None


# Sources, targets of their moves, and probes, each with its place in the scenario.
def _list_points(scenario: Scenario) -> list[tuple[str, Vec3]]:
    points = [(f"gas.sources[{i}].position_m", source.position_m) for i, source in enumerate(scenario.gas.sources)]
    points += [
        (f"events[{i}].to_m", event.to_m)
        for i, event in enumerate(scenario.events)
        if isinstance(event, SourceMovesSpec)
    ]
    return points + [(f"probes[{i}].position_m", probe.position_m) for i, probe in enumerate(scenario.probes or ())]


def _hits(scenario: Scenario, room: EnvironmentGeometry, door: Box) -> list[str]:
    is_door = voxelize([door], room.grid)
    cells = [(path, room.grid.cell_of(np.asarray(place_m))) for path, place_m in _list_points(scenario)]
    hits = [path for path, cell in cells if room.grid.contains_cell(cell) and is_door[tuple(cell)]]
    alone = replace(room, boxes=(door,))
    starts = [(f"agents[{i}].vehicle.start_m", agent.vehicle) for i, agent in enumerate(scenario.agents)]
    return hits + [path for path, each in starts if find_blocking_boxes(np.asarray([each.start_m]), each, alone)[0]]


def _problem_of_point(position_m: Vec3, room: EnvironmentGeometry, path: str) -> Problem | None:
    found = _what_is_at(position_m, room)
    if found is None:
        return None
    free_m = nearest_free_point_m(position_m, room)
    remedy = f"Nearest free point: {point_text(free_m)}." if free_m else ""
    return Problem(where=path, expected=_IN_AIR, found=f"{point_text(position_m)}, {found}", remedy=remedy)


# Description of a point that is not air; None for air.
def _what_is_at(position_m: Vec3, room: EnvironmentGeometry) -> str | None:
    grid = room.grid
    cell = grid.cell_of(np.asarray(position_m))
    if not bool(grid.contains_cell(cell)):
        return f"outside the room, which reaches from {span_text(grid.origin_m, grid.max_m)}"
    # A box that does not hold its cell's centre is solid, but the cell is not.
    for box in room.boxes:
        if all(low <= p < high for low, p, high in zip(box.min_m, position_m, box.max_m, strict=True)):
            return f"inside {box.name}"
    if room.occupancy[tuple(cell)] == Cell.SOLID:
        return "inside a solid cell"
    return None


def _problem_of_height(vehicle: VehicleSpec, room: EnvironmentGeometry, path: str) -> Problem | None:
    if vehicle.drives:
        return None
    radius_m = vehicle.facts.body.radius_m
    low_m, high_m = room.grid.origin_m[2] + radius_m, room.grid.max_m[2] - radius_m
    if low_m <= vehicle.search_height_m <= high_m:
        return None
    where = f"the ceiling is at {room.grid.max_m[2]:g} m and the {vehicle.model} keeps {radius_m:g} m from it"
    return Problem(
        where=path,
        expected=f"a height between {low_m:g} and {high_m:g} m ({where} and from the floor)",
        found=f"{vehicle.search_height_m:g} m",
        remedy=f"For example {min(2.0, (low_m + high_m) / 2):.3g} m." if low_m < high_m else "The room is too low.",
    )


def _problem_of_start(vehicle: VehicleSpec, room: EnvironmentGeometry, path: str) -> Problem | None:
    expected, found = _IN_AIR, _what_is_at(vehicle.start_m, room)
    if found is None:
        hits = find_blocking_boxes(np.asarray([vehicle.start_m]), vehicle, room)[0]
        if not hits:
            return None
        expected = (
            f"{vehicle.facts.body.radius_m:g} m of free space around the {vehicle.model}, "
            f"from the start up to its search height of {vehicle.search_height_m:g} m"
        )
        found = f"{', '.join(hits)} in it"
    free_m = nearest_start_m(vehicle, room)
    remedy = f"Nearest free start: {point_text(free_m)}." if free_m else ""
    return Problem(where=path, expected=expected, found=f"{point_text(vehicle.start_m)}, {found}", remedy=remedy)


def _problems_of_neighbours(agents: Sequence[AgentSpec]) -> list[Problem]:
    problems: list[Problem] = []
    for (_, first), (j, second) in combinations(enumerate(agents), 2):
        a, b = first.vehicle, second.vehicle
        apart_m = distance(a.start_m[:2], b.start_m[:2])
        least_m = a.facts.body.radius_m + b.facts.body.radius_m
        if apart_m >= least_m:
            continue
        problems.append(
            Problem(
                where=f"agents[{j}].vehicle.start_m",
                expected=f"at least {least_m:g} m, seen from above, from the start of {first.name}",
                found=f"{point_text(b.start_m)}, which is {apart_m:.3g} m from it",
                remedy=f"Move it {least_m - apart_m:.2f} m further away.",
            )
        )
    return problems


# Yields the centres of the air cells around a point, (n, 3) [m], and the distance [m] within which they are complete;
# the surroundings grow up to the whole room. `is_level` limits them to the layer of cells at the point.
def _growing_surroundings(
    position_m: Vec3, room: EnvironmentGeometry, *, is_level: bool = False
) -> Iterator[tuple[NDArray[np.float64], float]]:
    grid, point = room.grid, np.asarray(position_m)
    cell = np.clip(grid.cell_of(point), 0, np.asarray(grid.shape) - 1)
    outside_m = norm3(*(point - np.clip(point, grid.origin_m, grid.max_m)).tolist())
    reach, is_all = 4, False
    while not is_all:
        reaches = np.array([reach, reach, 0 if is_level else reach])
        low, high = np.maximum(cell - reaches, 0), np.minimum(cell + reaches + 1, grid.shape)
        is_all = (grid.shape[0], grid.shape[1]) == (high[0] - low[0], high[1] - low[1]) and (
            is_level or high[2] - low[2] == grid.shape[2]
        )
        reach_m = np.inf if is_all else norm2(outside_m, reach * grid.cell_m)
        window = tuple(slice(int(a), int(b)) for a, b in zip(low, high, strict=True))
        yield grid.centres_of(np.argwhere(room.occupancy[window] != Cell.SOLID) + low), reach_m
        reach *= 4


# Air with six neighbours of air; the walls around the grid are solid.
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


def _random_start_m(
    room: EnvironmentGeometry, vehicle: VehicleSpec, rng: np.random.Generator, taken_m: Sequence[Vec3]
) -> Vec3 | None:
    grid = room.grid
    layer = int((START_HEIGHT_M + 1e-9) / grid.cell_m)
    cells = np.argwhere(room.occupancy[:, :, min(layer, grid.shape[2] - 1)] != Cell.SOLID)
    escape = None if vehicle.avoidance == "none" else _EscapePath(room, vehicle)
    for i, j in rng.permutation(cells)[:N_TRIES]:
        x_m, y_m = (grid.origin_m[axis] + (n + 0.5) * grid.cell_m for axis, n in ((0, i), (1, j)))
        start_m = _rounded((x_m, y_m, grid.origin_m[2] + START_HEIGHT_M))
        is_apart = all(norm2(x_m - other[0], y_m - other[1]) >= 1.0 for other in taken_m)
        if is_apart and can_start_at(start_m, vehicle, room) and (escape is None or escape.leads_from(start_m)):
            return start_m
    return None


class _EscapePath:
    """Check that a vehicle with a planner gets off the ground and away from its start.

    Planner and autopilot depend on whole cells, which are larger than the boxes in them: a start beside a wall, with
    enough space for the vehicle, may be blocked for them.
    """

    def __init__(self, room: EnvironmentGeometry, vehicle: VehicleSpec) -> None:
        from gslcosim.environment.paths.planner import MARGIN_M, free_space

        self._room, self._vehicle = room, vehicle
        body, floor_m = vehicle.facts.body, room.grid.origin_m[2]
        ground_m = floor_m if vehicle.drives else None
        self._height_m = floor_m + body.half_height_m if vehicle.drives else vehicle.search_height_m
        self._space = free_space(room, radius_m=body.radius_m, margin_m=MARGIN_M, ground_m=ground_m)
        is_flat = vehicle.drives or vehicle.avoidance == "2d"
        self._free_cells = self._space.slab(self._height_m, self._height_m) if is_flat else self._space
        self._path_height_m = 0.0 if is_flat else self._height_m
        sizes = np.bincount(self._free_cells.parts[self._free_cells.parts > 0], minlength=2)
        self._largest = int(sizes.argmax())

    # A vehicle too near to an obstacle moves to the nearest free place in sight, as during a run.
    def leads_from(self, start_m: Vec3) -> bool:
        if not self._vehicle.drives:
            wanted_m = self._vehicle.search_height_m
            to_m = clear_height_m(self._room, self._vehicle.facts.body.radius_m, start_m, wanted_m)
            if not is_climb_sufficient(start_m[2], to_m, wanted_m):
                return False
        place_m = self._free_cells.nearest_m((start_m[0], start_m[1], self._path_height_m), in_sight=True)
        return place_m is not None and self._free_cells.part_of(place_m) == self._largest


def _rounded(point_m: Iterable[float]) -> Vec3:
    x_m, y_m, z_m = (round(float(coordinate_m), 6) for coordinate_m in point_m)
    return x_m, y_m, z_m
