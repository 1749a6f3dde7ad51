"""Places drawn at random: sources in free, reachable air, vehicles where they can stand and rise."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from gslcosim.environment.model import Cell, Environment
from gslcosim.environment.of_scenario.places import can_start_at, random_free_point_m
from gslcosim.environment.of_scenario.room_origin import folder_of, problems_of_source, room_of
from gslcosim.environment.room import Room
from gslcosim.environment.store import load_environment
from gslcosim.errors import EnvironmentDataError
from gslcosim.quantities import Vec3
from gslcosim.rng import stream
from gslcosim.scenario.models.scenario import EnvironmentSpec, SolverSpec, VehicleSpec
from gslcosim.scenario.random_places import Wanted

# Above the floor: as high as the bundled scenarios' starts [m].
START_HEIGHT_M = 0.2
N_TRIES = 10_000


def draw_places(
    spec: EnvironmentSpec, wind: SolverSpec, scenario_dir: Path, seed: int, wanted: Sequence[Wanted]
) -> Mapping[str, Vec3]:
    """Return a place for each that is wanted and for which there is one, each from a random stream of its own.

    Sources come between 0.5 and 3 m above the floor and a cell from solids where there are such places; vehicles
    stand on the floor with space around them up to their search height, and not within a metre of another's place.

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


# Nothing when the room has problems, which others tell.
def _room(spec: EnvironmentSpec, wind: SolverSpec, scenario_dir: Path) -> Room | Environment | None:
    if spec.path is None:
        has_problems = bool(problems_of_source(spec, wind, scenario_dir=scenario_dir))
        return None if has_problems else room_of(spec, wind, scenario_dir=scenario_dir)
    try:
        return load_environment(folder_of(spec, scenario_dir))
    except EnvironmentDataError:
        return None


def _random_start_m(
    room: Room | Environment, vehicle: VehicleSpec, rng: np.random.Generator, taken_m: Sequence[Vec3]
) -> Vec3 | None:
    grid = room.grid
    layer = int((START_HEIGHT_M + 1e-9) / grid.cell_m)
    cells = np.argwhere(room.occupancy[:, :, min(layer, grid.shape[2] - 1)] != Cell.SOLID)
    for i, j in rng.permutation(cells)[:N_TRIES]:
        x_m, y_m = (grid.origin_m[axis] + (n + 0.5) * grid.cell_m for axis, n in ((0, i), (1, j)))
        start_m = _rounded((x_m, y_m, grid.origin_m[2] + START_HEIGHT_M))
        is_apart = all(np.hypot(x_m - other[0], y_m - other[1]) >= 1.0 for other in taken_m)
        if is_apart and can_start_at(start_m, vehicle, room):
            return start_m
    return None


def _rounded(point_m: Vec3) -> Vec3:
    x_m, y_m, z_m = (round(float(coordinate_m), 6) for coordinate_m in point_m)
    return x_m, y_m, z_m
