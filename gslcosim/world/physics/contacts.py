"""The rest of a tick in which a vehicle touches something, by MuJoCo, for those who fly its free flight themselves."""
# MuJoCo is compiled and comes without stubs.
# pyright: reportAttributeAccessIssue=false

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from gslcosim.environment.model import Environment
from gslcosim.vehicles import Vehicle
from gslcosim.world.physics import records
from gslcosim.world.physics.flight_kernels import fly_substeps_inplace
from gslcosim.world.physics.mujoco_kernels import step_address
from gslcosim.world.physics.scene import build_scene

_AGENT = "vehicle"
_NO_INERTIAL = np.zeros((1, 0, 9))
_STILL_AIR = np.zeros((1, 1, 1, 3), np.float32)


@dataclass(frozen=True, kw_only=True)
class Touched:
    """A vehicle at the end of a tick: pose (7,), motion (6,) as MuJoCo has them, and whether anything touched it."""

    pose: NDArray[np.float64]
    motion: NDArray[np.float64]
    is_touched: bool


class ContactScene:
    """One vehicle that does not feel the air, in a room.

    Args:
        environment: The room.
        vehicle: The vehicle.
        step_s: Length of a physics step [s].
        n_substeps: Physics steps in a tick.
    """

    def __init__(self, environment: Environment, vehicle: Vehicle, step_s: float, n_substeps: int) -> None:
        self._model = build_scene(environment, [(_AGENT, vehicle)], step_s).model
        self._data = mujoco.MjData(self._model)
        self._constants = np.zeros(1, records.CONSTANTS)
        records.set_constants(self._constants[0], vehicle, self._model, f"{_AGENT}/", step_s)
        self._n_substeps = n_substeps
        data = self._data
        self._views = (data.qpos, data.qvel, data.qacc, data.qfrc_applied, data.qfrc_constraint, data.sensordata)
        self._addresses = (step_address(), self._model._address, data._address)

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
    ) -> Touched:
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
            i_substep, _ = fly_substeps_inplace(
                i_substep, self._n_substeps, tick, tick_s, self._constants, path, _NO_INERTIAL, *self._views,
                _STILL_AIR, np.zeros(3), 1.0, *self._addresses,
            )  # fmt: skip
            is_touched = is_touched or bool(data.ncon)
        return Touched(pose=data.qpos.copy(), motion=data.qvel.copy(), is_touched=is_touched)
