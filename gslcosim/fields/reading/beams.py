"""Instruments with a beam: where it goes, and the points at which gas along it is looked at."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gslcosim.contract.messages import BodyPoses
from gslcosim.environment.model import AT_START, Closed, Environment
from gslcosim.errors import ModelError
from gslcosim.fields.reading.beam_kernels import distance_to_wall_m
from gslcosim.fields.reading.concentration import float3
from gslcosim.frames import world_from_body_rotation
from gslcosim.quantities import Vec3
from gslcosim.scenario import Scenario
from gslcosim.scenario.models.gas_sensors import TdlasSensorSpec

# Models whose readings are means along a beam.
# Midpoints so far apart at most sum a Gaussian of 0.1 m to nine digits.
SPACING_M = 0.1


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
        self._origin_m = float3(environment.grid.origin_m)
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
        """Let these doors of the room be closed and all others open; or all as at the start."""
        self._occupancy = self._rooms.get(closed, self._rooms[AT_START])

    def points_of(self, bodies: BodyPoses) -> dict[tuple[str, str], tuple[float, NDArray[np.float64]]]:
        """Return for each (agent, sensor) with a beam its length [m] and (n, 3) points evenly along it [m].

        Length 0 and no points where nothing reflects the beam within its range.

        Raises:
            ModelError: a vehicle is missing in the poses.
        """
        state_of = {body.agent: body for body in bodies.bodies}
        found: dict[tuple[str, str], tuple[float, NDArray[np.float64]]] = {}
        for key, beam in self._beams.items():
            if beam.agent not in state_of:
                raise ModelError(f"fields: expected a pose of vehicle {beam.agent!r} in tick {bodies.tick}, was none.")
            body = state_of[beam.agent]
            rotation = world_from_body_rotation(body.quaternion_wxyz)
            start_m = np.array(body.position_world_m) + rotation @ np.array(beam.mount_body_m)
            direction = rotation @ np.array(beam.beam_body)
            direction = direction / np.linalg.norm(direction)
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
        n = math.ceil(length_m / SPACING_M)
        return length_m, start_m + np.outer((np.arange(n) + 0.5) * (length_m / n), direction)
