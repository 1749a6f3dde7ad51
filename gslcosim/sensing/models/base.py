"""What a sensor model is: true sample in, reading out."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from gslcosim.contract.messages import Reading
from gslcosim.contract.record import unchecked
from gslcosim.quantities import Vec3
from gslcosim.scenario.models.gas_sources import GasDefinition
from gslcosim.scenario.models.sensor_base import MeasuringSensorSpec, OnBoardSensorSpec, SensorSpec


class SensorModel(Protocol):
    """One instrument on one vehicle, new in every run; it is read once a tick, from tick 0 on."""

    def read(self, sample: Any, mount_velocity_world_m_s: Vec3) -> Reading:
        """Return what the instrument shows at the end of the tick.

        Args:
            sample: True gas and wind at the mount, a `MountSample`; for on-board sensors their `Surroundings`.
            mount_velocity_world_m_s: How the mount moves, world frame [m/s].
        """
        ...


new_reading = unchecked(Reading)
"""Makes a `Reading` of values whose types are known; models that are read at every tick use it."""

Estimator = Callable[[Reading], Reading]

ESTIMATE_ENDING = "_ppm"
_LONGEST_NAME = 40


def estimate_name(sensor: str) -> str:
    """Return the name of the second reading of a sensor, with the mixing ratio that the first one suggests."""
    return sensor[: _LONGEST_NAME - len(ESTIMATE_ENDING)] + ESTIMATE_ENDING


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
        """Whether it looks at the vehicle and what is around it, not at gas and wind."""
        return issubclass(self.settings, OnBoardSensorSpec)
