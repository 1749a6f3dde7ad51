# pyright: basic
# pyright: reportAttributeAccessIssue=false
# ruff: noqa: ANN001, ANN201 - kernels have no types, and symbols of equations
"""Scene of one vehicle for the rest of a tick in which it touches something, and the step of a point mass."""

from dataclasses import dataclass

import mujoco
import numba
import numpy as np
from numpy.typing import NDArray

from gslcosim.environment.model import Environment
from gslcosim.vehicles import Vehicle
from gslcosim_services.world import vehicle_records
from gslcosim_services.world.scene import build_scene
from gslcosim_services.world.simulation_loop import run_substeps_inplace

_VEHICLE_NAME = "vehicle"
_NO_INERTIAL = np.zeros((1, 0, 9))
_STILL_AIR = np.zeros((1, 1, 1, 3), np.float32)


@numba.njit(cache=True, nogil=True)
def advance_point_inplace(p, v, a_x, a_y, a_z, dt_s):
    """Advance a point mass by a semi-implicit Euler step, MuJoCo's step of a free body without torque to the bit.

    v <- v + dt a,  p <- p + dt v
    [m/s] = [s] [m/s^2],  [m] = [s] [m/s]

    Args:
        p: (3,) position, world frame [m]; advanced.
        v: (3,) velocity, world frame [m/s]; advanced.
        a_x: Acceleration along world x [m/s^2]; a_y and a_z likewise.
        a_y: See a_x.
        a_z: See a_x.
        dt_s: Length of the step [s].

    Held by:
        extensions/training/tests/integration/test_batch_equals_flight.py
    """
    v[0] += dt_s * a_x
    v[1] += dt_s * a_y
    v[2] += dt_s * a_z
    for axis in range(3):
        p[axis] += dt_s * v[axis]


@dataclass(frozen=True, kw_only=True)
class ContactResult:
    """State of a vehicle at the end of a tick: pose (7,), motion (6,) as MuJoCo has them, and its contact."""

    pose: NDArray[np.float64]
    motion: NDArray[np.float64]
    is_touched: bool


class ContactScene:
    """Scene of one vehicle that does not feel the air, for the rest of a tick in which it touches something.

    Args:
        environment: The room.
        vehicle: The vehicle.
        step_s: Length of a physics step [s].
        n_substeps: Physics steps in a tick.
    """

    def __init__(self, environment: Environment, vehicle: Vehicle, step_s: float, n_substeps: int) -> None:
        self._model = build_scene(environment, [(_VEHICLE_NAME, vehicle)], step_s).model
        self._data = mujoco.MjData(self._model)
        self._constants = np.zeros(1, vehicle_records.CONSTANTS)
        vehicle_records.set_constants(self._constants[0], vehicle, self._model, f"{_VEHICLE_NAME}/", step_s)
        self._n_substeps = n_substeps
        data = self._data
        self._views = (data.qpos, data.qvel, data.qacc, data.qfrc_applied, data.qfrc_constraint, data.sensordata)
        self._addresses = (self._model._address, data._address)

    @property
    def constants(self) -> NDArray[np.void]:
        """The vehicle's record of `records.CONSTANTS`."""
        return self._constants[0]

    def fly(
        self,
        first: int,
        tick: int,
        tick_s: float,
        path: NDArray[np.void],
        position_m: NDArray[np.float64],
        velocity_m_s: NDArray[np.float64],
        acceleration_m_s2: NDArray[np.float64],
    ) -> ContactResult:
        """Fly on from a physics step of a tick to the tick's end.

        Args:
            first: The physics step, counted in the tick.
            tick: The tick that ends.
            tick_s: Length of a tick [s].
            path: (1,) record of `records.STATE`; advanced.
            position_m: (3,) where the vehicle is, upright, world frame [m].
            velocity_m_s: (3,) how it moves without turning, world frame [m/s].
            acceleration_m_s2: (3,) how it was accelerated in the step before [m/s^2]; MuJoCo begins with that.
        """
        data = self._data
        mujoco.mj_resetData(self._model, data)
        data.qpos[:] = (*position_m, 1.0, 0.0, 0.0, 0.0)
        data.qvel[:] = (*velocity_m_s, 0.0, 0.0, 0.0)
        data.qacc_warmstart[:] = (*acceleration_m_s2, 0.0, 0.0, 0.0)
        i_substep, is_touched = first, False
        while i_substep < self._n_substeps:
            i_substep, _ = run_substeps_inplace(
                i_substep, self._n_substeps, tick, tick_s, self._constants, path, _NO_INERTIAL, *self._views,
                _STILL_AIR, np.zeros(3), 1.0, *self._addresses,
            )  # fmt: skip
            is_touched = is_touched or bool(data.ncon)
        return ContactResult(pose=data.qpos.copy(), motion=data.qvel.copy(), is_touched=is_touched)
