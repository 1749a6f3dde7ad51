# pyright: basic
"""Sample points: positions of sensors' mounts, and points along beams up to the first wall."""

# ruff: noqa: ANN001, ANN201 - kernels have no types, and symbols of equations

import math
from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

from gslcosim.base import elementary
from gslcosim.base.errors import ModelError
from gslcosim.base.frames import world_from_body_rotation
from gslcosim.base.quantities import Vec3
from gslcosim.base.scalar_kernels import norm3
from gslcosim.contract.messages import BodyPoses
from gslcosim.environment.grid_kernels import SOLID, to_next_border
from gslcosim.environment.model import AT_START, Closed, Environment
from gslcosim.scenario import Scenario
from gslcosim.scenario.models.sensors import OnBoardSensorSpec, TdlasSensorSpec
from gslcosim_services.fields.mixing_ratio import to_float3

# Models with readings that are means along a beam. Midpoints so far apart at most sum a Gaussian of 0.1 m to nine
# digits.
BEAM_SPACING_M = 0.1


@dataclass(frozen=True, kw_only=True)
class Mount:
    """One sensor's mount; `i_place` counts into the places to sample (sensors at one mount share a place)."""

    agent: str
    sensor: str
    i_place: int


class MountPositions:
    """Distinct mounts of all vehicles and their positions at a given pose."""

    def __init__(self, scenario: Scenario) -> None:
        places: dict[tuple[str, Vec3], int] = {}
        mounts: list[Mount] = []
        for agent in scenario.agents:
            for sensor in (s for s in agent.sensors if not isinstance(s, OnBoardSensorSpec)):
                i_place = places.setdefault((agent.name, sensor.mount_m), len(places))
                mounts.append(Mount(agent=agent.name, sensor=sensor.name, i_place=i_place))
        self.mounts = tuple(mounts)
        self._places = tuple(places)
        self._position_world_m = np.zeros((len(places), 3))

    @property
    def n_places(self) -> int:
        """Number of distinct places to sample."""
        return len(self._places)

    def positions_world_m(self, bodies: BodyPoses) -> NDArray[np.float64]:
        """Return the (n_places, 3) places of the mounts, world frame [m]; overwritten by the next call."""
        state_of = {body.agent: body for body in bodies.bodies}
        for i, (agent, mount_body_m) in enumerate(self._places):
            if agent not in state_of:
                raise ModelError(f"fields: expected a pose of vehicle {agent!r} in tick {bodies.tick}, was none.")
            body = state_of[agent]
            self._position_world_m[i] = body.position_world_m
            if any(mount_body_m):
                self._position_world_m[i] += elementary.product(
                    world_from_body_rotation(body.quaternion_wxyz), mount_body_m
                )
        return self._position_world_m


@numba.njit(cache=True, nogil=True)
def distance_to_wall_m(occupancy, origin_m, cell_m, x, y, z, dx, dy, dz):
    """Return the way from a point along a unit vector to the first solid cell, or to the border of the grid [m].

    0 when the point is outside the grid or in a solid cell.

    Args:
        occupancy: (nx, ny, nz) uint8, 1 is solid; index order ij.
        origin_m: (3,) corner of cell (0, 0, 0), world frame [m].
        cell_m: Edge of the cubic cells [m].
        x, y, z: Point, world frame [m].
        dx, dy, dz: Direction, world frame, of length 1.

    Source:
        Amanatides and Woo 1987, A fast voxel traversal algorithm for ray tracing, Eurographics, section 2.
    Held by:
        tests/unit/services/fields/test_sample_points.py (against small steps in a box with three side
        lengths)
    """
    nx, ny, nz = occupancy.shape
    sx, sy, sz = (x - origin_m[0]) / cell_m, (y - origin_m[1]) / cell_m, (z - origin_m[2]) / cell_m
    i, j, k = math.floor(sx), math.floor(sy), math.floor(sz)
    next_x, gap_x = to_next_border(sx, i, dx)
    next_y, gap_y = to_next_border(sy, j, dy)
    next_z, gap_z = to_next_border(sz, k, dz)
    distance = 0.0
    while 0 <= i < nx and 0 <= j < ny and 0 <= k < nz and occupancy[i, j, k] != SOLID:
        distance = min(next_x, next_y, next_z)
        if next_x <= next_y and next_x <= next_z:
            i += 1 if dx > 0.0 else -1
            next_x += gap_x
        elif next_y <= next_z:
            j += 1 if dy > 0.0 else -1
            next_y += gap_y
        else:
            k += 1 if dz > 0.0 else -1
            next_z += gap_z
    return distance * cell_m


@dataclass(frozen=True, kw_only=True)
class Beam:
    """One instrument's beam: from its mount in the direction `beam_body`, as far as `max_range_m` at most."""

    agent: str
    sensor: str
    mount_body_m: Vec3
    beam_body: Vec3
    max_range_m: float


class Beams:
    """All beams of a scenario in its room. Vehicles neither reflect nor block them."""

    def __init__(self, scenario: Scenario, environment: Environment) -> None:
        rooms = environment.by_doors()
        self._rooms = {closed: np.ascontiguousarray(room.occupancy, np.uint8) for closed, room in rooms.items()}
        self._occupancy = self._rooms[AT_START]
        self._origin_m = to_float3(environment.grid.origin_m)
        self._cell_m = float(environment.grid.cell_m)
        self._beams = {
            (agent.name, sensor.name): Beam(
                agent=agent.name,
                sensor=sensor.name,
                mount_body_m=sensor.mount_m,
                beam_body=sensor.beam_body,
                max_range_m=sensor.max_range_m,
            )
            for agent in scenario.agents
            for sensor in agent.sensors
            if isinstance(sensor, TdlasSensorSpec)
        }

    def __len__(self) -> int:
        """Return the number of beams."""
        return len(self._beams)

    def close_doors(self, closed: Closed) -> None:
        """Close these doors of the room and open all others; None sets the doors of the start."""
        self._occupancy = self._rooms.get(closed, self._rooms[AT_START])

    def points_of(self, bodies: BodyPoses) -> dict[tuple[str, str], tuple[float, NDArray[np.float64]]]:
        """Return for each (agent, sensor) with a beam its length [m] and (n, 3) points evenly along it [m].

        Length 0 and no points where nothing reflects the beam within its range.
        """
        state_of = {body.agent: body for body in bodies.bodies}
        found: dict[tuple[str, str], tuple[float, NDArray[np.float64]]] = {}
        for key, beam in self._beams.items():
            if beam.agent not in state_of:
                raise ModelError(f"fields: expected a pose of vehicle {beam.agent!r} in tick {bodies.tick}, was none.")
            body = state_of[beam.agent]
            rotation = world_from_body_rotation(body.quaternion_wxyz)
            start_m = np.array(body.position_world_m) + elementary.product(rotation, beam.mount_body_m)
            direction = elementary.product(rotation, beam.beam_body)
            direction = direction / norm3(*direction.tolist())
            found[key] = self._along(start_m, direction, beam.max_range_m)
        return found

    def _along(
        self, start_m: NDArray[np.float64], direction: NDArray[np.float64], max_range_m: float
    ) -> tuple[float, NDArray[np.float64]]:
        length_m = float(
            distance_to_wall_m(
                self._occupancy, self._origin_m, self._cell_m, *map(float, start_m), *map(float, direction)
            )
        )
        if not 0.0 < length_m <= max_range_m:
            return 0.0, np.zeros((0, 3))
        n = math.ceil(length_m / BEAM_SPACING_M)
        return length_m, start_m + np.outer((np.arange(n) + 0.5) * (length_m / n), direction)
