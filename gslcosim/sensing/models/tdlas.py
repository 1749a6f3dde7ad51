"""Open-path laser: the gas along a beam, times the way."""

import numpy as np

from gslcosim.contract.messages import MountSample, Reading
from gslcosim.quantities import Vec3
from gslcosim.scenario.models.gas_sensors import TdlasSensorSpec
from gslcosim.scenario.models.sensors import SENSOR_BLOCKS
from gslcosim.sensing.models.base import SensorKind

QUANTITY = "path_integrated_mixing_ratio"
UNIT = "ppm m"


class TdlasSensor:
    """A tunable diode laser that looks along a beam to the first wall and back, tuned to the gas that is searched for.

    reading = mean of the mixing ratio along the beam times its length      [ppm m] = [ppm] [m]

    The beam starts at the mount and points in the direction `beam_body`. Where no wall reflects it within
    `max_range_m`, the reading is 0 and `is_saturated`: nothing came back. State: none. No noise of its own, no lag.

    Source:
        GADEN's simulated TDLAS marches along a ray and sums ppm times metres of methane.
    Deviation:
        Any gas can be chosen; the sum takes the beam to the wall exactly.
    Left out:
        The wall's reflectivity and the fall of the signal with distance.
    Held by:
        tests/unit/sensing/test_tdlas.py, tests/unit/fields/reading/test_beams.py
    """

    def __init__(self, spec: TdlasSensorSpec) -> None:
        self._sensor = spec.name

    def read(self, sample: MountSample, mount_velocity_world_m_s: Vec3) -> Reading:
        """Return the reading [ppm m]; see `SensorModel.read`. The first gas is the one that is searched for."""
        del mount_velocity_world_m_s
        beam_m = sample.beam_m or 0.0
        ppm = sample.gases[0].mixing_ratio_ppm if sample.gases else 0.0
        return Reading(
            sensor=self._sensor, quantity=QUANTITY, unit=UNIT, values=(ppm * beam_m,), is_saturated=beam_m == 0.0
        )


def _build(spec: TdlasSensorSpec, tick_s: float, rng: np.random.Generator) -> TdlasSensor:
    del tick_s, rng
    return TdlasSensor(spec)


TDLAS = SensorKind(
    name="tdlas",
    settings=SENSOR_BLOCKS["tdlas"],
    quantity=QUANTITY,
    unit=UNIT,
    description="Open-path laser: values = (ppm m,), the gas that is searched for summed along the beam to the wall.",
    build=_build,
)
