"""Where the sensors are: the places in the world at which the fields are sampled."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gslcosim.contract.messages import BodyPoses
from gslcosim.errors import ModelError
from gslcosim.frames import world_from_body_rotation
from gslcosim.quantities import Vec3
from gslcosim.scenario import Scenario
from gslcosim.scenario.models.sensor_base import OnBoardSensorSpec


@dataclass(frozen=True, kw_only=True)
class Mount:
    """One sensor's mount; `i_place` counts into the places to sample (sensors at one mount share a place)."""

    agent: str
    sensor: str
    i_place: int


class MountPlaces:
    """The distinct mounts of all vehicles and where they are at a given pose."""

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
        """Return the (n_places, 3) places of the mounts, world frame [m]; overwritten by the next call.

        Raises:
            ModelError: a vehicle is missing in the poses.
        """
        state_of = {body.agent: body for body in bodies.bodies}
        for i, (agent, mount_body_m) in enumerate(self._places):
            if agent not in state_of:
                raise ModelError(f"fields: expected a pose of vehicle {agent!r} in tick {bodies.tick}, was none.")
            body = state_of[agent]
            self._position_world_m[i] = body.position_world_m
            if any(mount_body_m):
                self._position_world_m[i] += world_from_body_rotation(body.quaternion_wxyz) @ mount_body_m
        return self._position_world_m
