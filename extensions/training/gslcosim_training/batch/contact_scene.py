# pyright: basic
# pyright: reportAttributeAccessIssue=false
# ruff: noqa: ANN001, ANN201 - kernels have no types, and symbols of equations
"""Scene of one vehicle for the rest of a tick in which it touches something, and the step of a point mass."""

from dataclasses import dataclass
from typing import Any

import mujoco
import numba
import numpy as np
from numpy.typing import NDArray

from gslcosim.base import elementary
from gslcosim.base.errors import ModelError
from gslcosim.base.quantities import Vec3
from gslcosim.environment.model import Environment, freeze_array
from gslcosim.vehicles import Vehicle
from gslcosim_services.world import vehicle_records
from gslcosim_services.world.scene import build_scene
from gslcosim_services.world.simulation_loop import SceneArrays, run_substeps_inplace
from gslcosim_services.world.trajectory import to_vec3

_VEHICLE_NAME = "vehicle"
_NO_INERTIAL = np.zeros((1, 0, 9))


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


def find_hull_half_m(model: mujoco.MjModel) -> Vec3:
    """Return the half sizes of a box around the parts of a scene's one vehicle, body frame, about its centre [m]."""
    half_m = np.zeros(3)
    for i in np.flatnonzero(model.geom_bodyid > 0).tolist():
        rotation = np.zeros(9)
        mujoco.mju_quat2Mat(rotation, model.geom_quat[i])
        turned = rotation.reshape(3, 3)
        centre_m = model.geom_pos[i] + elementary.product(turned, model.geom_aabb[i, :3])
        half_m = np.maximum(half_m, np.abs(centre_m) + elementary.product(np.abs(turned), model.geom_aabb[i, 3:]))
    return to_vec3(half_m)


class ContactScene:
    """Scene of one vehicle for the rest of a tick in which it touches something.

    Args:
        environment: The room, with its wind.
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
        self._wind = environment.wind
        # As the world service has them: one compiled kernel serves both.
        self._frames_m_s = freeze_array(np.asarray(environment.wind.velocity_m_s).view())
        self._wind_grid = (np.array(environment.grid.origin_m, np.float64), float(environment.grid.cell_m))
        self._arrays = SceneArrays.of(self._model, self._data)

    @property
    def constants(self) -> NDArray[np.void]:
        """The vehicle's record of `records.CONSTANTS`."""
        return self._constants[0]

    @property
    def hull_half_m(self) -> Vec3:
        """Half sizes of a box around the vehicle's parts, body frame, its centre the vehicle's [m]."""
        return find_hull_half_m(self._model)

    def fly(
        self, first: int, tick: int, tick_s: float, begin_s: float, path: NDArray[np.void], search: Any
    ) -> ContactResult:
        """Fly on from a physics step of a tick to the tick's end.

        Args:
            first: The physics step, counted in the tick.
            tick: The tick that ends.
            tick_s: Length of a tick [s].
            begin_s: Time since the sources opened at the tick's beginning [s].
            path: (1,) record of `records.STATE`; advanced.
            search: Record of `batch_records.SEARCH`: how the vehicle stands and moves, and its acceleration in the step
                before, with which MuJoCo begins.

        Raises:
            ModelError: the state has exploded.
        """
        data = self._data
        mujoco.mj_resetData(self._model, data)
        data.qpos[:] = (*search["position_m"], *search["quaternion_wxyz"])
        data.qvel[:] = (*search["velocity_m_s"], *search["rates_rad_s"])
        data.qacc_warmstart[:] = (*search["acceleration_m_s2"], 0.0, 0.0, 0.0)
        wind_m_s = self._frames_m_s[self._wind.frame_at(begin_s)]
        i_substep, is_touched = first, False
        while i_substep < self._n_substeps:
            i_substep, i_unsound, has_contacts = run_substeps_inplace(
                i_substep, self._n_substeps, tick, tick_s, self._constants, path, _NO_INERTIAL, self._arrays,
                wind_m_s, *self._wind_grid,
            )  # fmt: skip
            if i_unsound >= 0:
                raise ModelError(
                    f"batch: expected a finite, plausible state of a vehicle at tick {tick}, was position "
                    f"{to_vec3(data.qpos[:3])} m, velocity {to_vec3(data.qvel[:3])} m/s."
                )
            is_touched = is_touched or (has_contacts and bool(data.ncon))
        return ContactResult(pose=data.qpos.copy(), motion=data.qvel.copy(), is_touched=is_touched)
