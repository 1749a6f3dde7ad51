"""Random positions: sources in free, reachable air, vehicles where they can stand and rise."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from gslcosim.base.errors import EnvironmentDataError
from gslcosim.base.quantities import Vec3
from gslcosim.base.rng import stream
from gslcosim.environment.build.geometry_source import build_geometry, find_folder, find_source_problems
from gslcosim.environment.build.position_checks import can_start_at, random_free_point_m
from gslcosim.environment.geometry_model import EnvironmentGeometry
from gslcosim.environment.model import Cell, Environment
from gslcosim.environment.paths.planner import MARGIN_M, free_space
from gslcosim.environment.store import load_environment
from gslcosim.scenario.models.scenario import EnvironmentSpec, SolverSpec, VehicleSpec
from gslcosim.scenario.random_positions import RandomPosition

# Above the floor: as high as the bundled scenarios' starts [m].
START_HEIGHT_M = 0.2
N_TRIES = 10_000


def draw_positions(
    spec: EnvironmentSpec, wind: SolverSpec, scenario_dir: Path, seed: int, wanted: Sequence[RandomPosition]
) -> Mapping[str, Vec3]:
    """Return a place for each that is wanted and for which there is one, each from a random stream of its own.

    Sources come between 0.5 and 3 m above the floor and a cell from solids where there are such places; vehicles
    stand on the floor with space around them up to their search height, and not within a metre of another's place. One
    with `avoidance` stands where its planner leads to the largest connected space.

    Args:
        spec: What the scenario says of its environment.
        wind: Gives a generated room its cells.
        scenario_dir: What relative paths are relative to.
        seed: The scenario's.
        wanted: What places are wanted for.
    """
    room = _room(spec, wind, scenario_dir)
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


# Nothing when the room has problems, which other checks report.
def _room(spec: EnvironmentSpec, wind: SolverSpec, scenario_dir: Path) -> EnvironmentGeometry | Environment | None:
    if spec.path is None:
        has_problems = bool(find_source_problems(spec, wind, scenario_dir=scenario_dir))
        return None if has_problems else build_geometry(spec, wind, scenario_dir=scenario_dir)
    try:
        return load_environment(find_folder(spec, scenario_dir))
    except EnvironmentDataError:
        return None


def _random_start_m(
    room: EnvironmentGeometry | Environment, vehicle: VehicleSpec, rng: np.random.Generator, taken_m: Sequence[Vec3]
) -> Vec3 | None:
    grid = room.grid
    layer = int((START_HEIGHT_M + 1e-9) / grid.cell_m)
    cells = np.argwhere(room.occupancy[:, :, min(layer, grid.shape[2] - 1)] != Cell.SOLID)
    escape = None if vehicle.avoidance == "none" else _EscapePath(room, vehicle)
    for i, j in rng.permutation(cells)[:N_TRIES]:
        x_m, y_m = (grid.origin_m[axis] + (n + 0.5) * grid.cell_m for axis, n in ((0, i), (1, j)))
        start_m = _rounded((x_m, y_m, grid.origin_m[2] + START_HEIGHT_M))
        is_apart = all(np.hypot(x_m - other[0], y_m - other[1]) >= 1.0 for other in taken_m)
        if is_apart and can_start_at(start_m, vehicle, room) and (escape is None or escape.leads_from(x_m, y_m)):
            return start_m
    return None


class _EscapePath:
    """Check that a vehicle's planner finds a way from its start: not out of what is narrower than the vehicle."""

    def __init__(self, room: EnvironmentGeometry | Environment, vehicle: VehicleSpec) -> None:
        body, floor_m = vehicle.facts.body, room.grid.origin_m[2]
        ground_m = floor_m if vehicle.drives else None
        self._height_m = floor_m + body.half_height_m if vehicle.drives else vehicle.search_height_m
        self._space = free_space(room, radius_m=body.radius_m, margin_m=MARGIN_M, ground_m=ground_m)
        is_flat = vehicle.drives or vehicle.avoidance == "2d"
        self._free_cells = self._space.slab(self._height_m, self._height_m) if is_flat else self._space
        self._path_height_m = 0.0 if is_flat else self._height_m
        sizes = np.bincount(self._free_cells.parts[self._free_cells.parts > 0], minlength=2)
        self._largest = int(sizes.argmax())

    # A start too near to something is left to the nearest free place in sight, as in flight.
    def leads_from(self, x_m: float, y_m: float) -> bool:
        place_m = self._free_cells.nearest_m((x_m, y_m, self._path_height_m), in_sight=True)
        return place_m is not None and self._free_cells.part_of(place_m) == self._largest


def _rounded(point_m: Vec3) -> Vec3:
    x_m, y_m, z_m = (round(float(coordinate_m), 6) for coordinate_m in point_m)
    return x_m, y_m, z_m
