"""Interface of sensor models: the sample or the surroundings in, a reading out; and a model's row in the table."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from gslcosim.base.frames import world_from_body_rotation
from gslcosim.base.quantities import Vec3
from gslcosim.contract.messages import BodyState, CameraImage, Reading
from gslcosim.contract.record import build_unchecked_constructor
from gslcosim.scenario.models.gas_sources import GasDefinition
from gslcosim.scenario.models.sensor_base import MeasuringSensorSpec, OnBoardSensorSpec, SensorSpec
from gslcosim_services.sensing.ray_scene import RayScene


class SensorModel(Protocol):
    """One instrument on one vehicle, new in every run; it is read once a tick, from tick 0 on."""

    def read(self, sample: Any, mount_velocity_world_m_s: Vec3) -> Reading:
        """Return what the instrument shows at the end of the tick.

        Args:
            sample: True gas and wind at the mount, a `MountSample`; for on-board sensors their `Surroundings`.
            mount_velocity_world_m_s: How the mount moves, world frame [m/s].
        """
        ...


new_reading = build_unchecked_constructor(Reading)
"""Makes a `Reading` of values whose types are known; models that are read at every tick use it."""

Estimator = Callable[[Reading], Reading]

ESTIMATE_SUFFIX = "_ppm"
_MAX_NAME_LENGTH = 40


def estimate_name(sensor: str) -> str:
    """Return the name of the second reading of a sensor, with the mixing ratio that the first one suggests."""
    return sensor[: _MAX_NAME_LENGTH - len(ESTIMATE_SUFFIX)] + ESTIMATE_SUFFIX


@dataclass(frozen=True, kw_only=True)
class SensorKind:
    """One row of the table of sensor models.

    `settings` is the block of a scenario that describes one: what it has beside its base is the sensor's own.
    `build(spec, tick_s, rng)` returns a new instrument; `spec` is such a block, `rng` its own random stream. `quantity`
    and `unit` are those of its readings, `description` says what it stands for and what the reading's values are.
    `has_own_noise` says that the model itself applies the scenario's `noise_std`. `n_with_errors` says how many of a
    reading's values, from the first on, have the scenario's bias, drift, noise and limit (absent: all of them),
    `least_value` below which they never are.

    `for_gases(definitions)` returns the row for a scenario that defines gases of its own, where that matters.
    `estimator(gas)` returns how to turn a reading into a second one that tells the mixing ratio [ppm] of a gas, as the
    maker's sheet would have it; nothing where the sheet does not know the gas. The second reading is named after the
    sensor with `_ppm` behind.
    """

    name: str
    quantity: str
    unit: str
    description: str
    build: Callable[[Any, float, np.random.Generator], SensorModel]
    settings: type[SensorSpec] = MeasuringSensorSpec
    has_own_noise: bool = False
    n_with_errors: int | None = None
    least_value: float = -math.inf
    for_gases: "Callable[[tuple[GasDefinition, ...]], SensorKind] | None" = None
    estimator: Callable[[str], Estimator | None] | None = None

    @property
    def is_on_board(self) -> bool:
        """True for sensors of the vehicle and its surroundings, false for those of gas and wind."""
        return issubclass(self.settings, OnBoardSensorSpec)


@dataclass(frozen=True)
class Surroundings:
    """True surroundings of one vehicle at the end of a tick; on-board sensors get them in place of a gas sample.

    `others` are the other vehicles; `images` are the pictures just taken, by the sensor's name.
    """

    body: BodyState
    scene: RayScene
    others: tuple[BodyState, ...] = ()
    images: dict[str, CameraImage] = field(default_factory=dict)

    @cached_property
    def world_from_body(self) -> NDArray[np.float64]:
        """The (3, 3) matrix that turns body-frame vectors into world-frame vectors."""
        return world_from_body_rotation(self.body.quaternion_wxyz)

    def place_world_m(self, mount_body_m: Vec3) -> Vec3:
        """Return the position of a mount, world frame [m]."""
        x_m, y_m, z_m = self.body.position_world_m
        if not any(mount_body_m):
            return x_m, y_m, z_m
        dx_m, dy_m, dz_m = (self.world_from_body @ np.array(mount_body_m)).tolist()
        return x_m + dx_m, y_m + dy_m, z_m + dz_m
