"""Bumper: reports contact of the vehicle with something."""

from collections import deque

import numpy as np

from gslcosim.base.quantities import Vec3
from gslcosim.contract.messages import Reading
from gslcosim.scenario.models.onboard_sensors import BumpSensorSpec
from gslcosim.scenario.models.sensors import SENSOR_BLOCKS
from gslcosim_services.sensing.models.base import SensorKind, Surroundings


class Bumper:
    """values = (1 or 0,): whether anything touched the vehicle in the last `period_s`; without a period, in the tick.

    What wheels roll on does not count; what a vehicle in the air stands on before its take-off does. State: the
    contacts of each tick within the period. Draws nothing. Held by: tests/unit/services/sensing/test_bumper.py
    """

    def __init__(self, spec: BumpSensorSpec, tick_s: float, rng: np.random.Generator) -> None:
        del rng
        self._sensor = spec.name
        self._touched: deque[bool] = deque(maxlen=max(1, round((spec.period_s or tick_s) / tick_s)))

    def read(self, sample: Surroundings, mount_velocity_world_m_s: Vec3) -> Reading:
        """Return 1 after a contact, else 0; see `SensorModel.read`."""
        del mount_velocity_world_m_s
        self._touched.append(bool(sample.body.contacts))
        return Reading(sensor=self._sensor, quantity="contact", unit="1", values=(float(any(self._touched)),))


BUMPER = SensorKind(
    name="bump",
    settings=SENSOR_BLOCKS["bump"],
    quantity="contact",
    unit="1",
    description="Bumper: values = (1 or 0,), whether something touched the vehicle since the last reading.",
    build=Bumper,
    n_with_errors=0,
)
