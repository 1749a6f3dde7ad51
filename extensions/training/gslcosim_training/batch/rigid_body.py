# pyright: basic, reportCallIssue=false
# ruff: noqa: ANN001, ANN201, N806 - kernels have no types, and symbols of equations
"""Rigid body of a rotorcraft in free flight, with the control, rotors, drag and step of a run.

Symbols: p, v position and velocity in the world frame; q the attitude; omega the angular velocity in the body frame.
"""

import numpy as np

from gslcosim.base.scalar_kernels import norm2
from gslcosim.environment.grid_kernels import trilinear_wind
from gslcosim_services.world.multirotor_control import rotation_from_quaternion
from gslcosim_services.world.simulation_loop import (
    advance_free_body_inplace,
    is_state_plausible,
    path_time_s,
    step_rotorcraft_inplace,
)
from gslcosim_training.batch.free_space import array_at, may_touch, wind_address_at
from gslcosim_training.batch.reference_free_kernels import reference_free_njit
from gslcosim_training.batch.scalar_compilation import address_of


@reference_free_njit()
def fly_rigid_tick(search, path, vehicle, case, room, work, tick, begin_s):
    """Fly a rotorcraft for a tick as a run does, with the control, the rotors and the drag of `world`.

    Args:
        search: Record of `SEARCH`; pose, motion and acceleration are advanced.
        path: Record of `records.STATE`; integral, heading and rotor speeds are advanced.
        vehicle: Record of `records.CONSTANTS`.
        case: Record of `CASE`.
        room: Record of `ROOM`.
        work: Record of `WORK`.
        tick: The tick that is advanced to.
        begin_s: Time since the sources opened at the tick's beginning [s], of which the wind is.

    Returns:
        False where something may be touched, or the state has exploded: `touched_at` is the first physics step that is
        left to MuJoCo, and to `ContactScene`, which refuses such a state.

    Held by:
        extensions/training/tests/integration/test_rigid_body_equals_flight.py
    """
    p = array_at(address_of(search.position_m), 7, np.float64)
    v = array_at(address_of(search.velocity_m_s), 6, np.float64)
    force, acceleration = work.force, work.acceleration
    nx, ny, nz = room.wind_shape[1], room.wind_shape[2], room.wind_shape[3]
    wind = array_at(wind_address_at(room, begin_s), (nx, ny, nz, 3), np.float32)
    origin_m = (room.origin_m[0], room.origin_m[1], room.origin_m[2])
    dt_s = case.tick_s / case.n_substeps
    for i_substep in range(case.n_substeps):
        if may_touch(room, case.hull_half_m, p) or not is_state_plausible(p, v):
            search.touched_at = i_substep
            return False
        t_s = path_time_s(path, tick, case.tick_s, i_substep, dt_s)
        wind_u, wind_v, wind_w = trilinear_wind(wind, origin_m, room.cell_m, p[0], p[1], p[2])
        step_rotorcraft_inplace(vehicle, path, p, v, force, t_s, dt_s, wind_u, wind_v, wind_w)
        advance_free_body_inplace(vehicle, p, v, acceleration, force, case.physics_step_s)
        for axis in range(3):
            search.acceleration_m_s2[axis] = acceleration[axis]
    return True


@reference_free_njit()
def turn_sensors_inplace(search, places_m, world_m, velocity_m_s, rotation):
    """Write the heading of a rigid body, and where its sensors are and how they move.

    x = p + R m,  dx/dt = v + R (omega x m)
    [m], [m/s] = [rad/s] [m]

    Args:
        search: Record of `SEARCH`; its heading is written.
        places_m: (n, 3) m, mounts in the body frame [m].
        world_m: (n or more, 3) written: x, world frame [m].
        velocity_m_s: (n or more, 3) written: velocities, world frame [m/s].
        rotation: (9,) written: R, row by row.

    Held by:
        extensions/training/tests/integration/test_rigid_body_equals_flight.py
    """
    p, v, q, omega = search.position_m, search.velocity_m_s, search.quaternion_wxyz, search.rates_rad_s
    R = rotation_from_quaternion(q[0], q[1], q[2], q[3])
    for k, number in enumerate(R):
        rotation[k] = number
    across = norm2(R[0], R[3])
    if across > 0.0:
        search.yaw_sin, search.yaw_cos = R[3] / across, R[0] / across
    for n in range(places_m.shape[0]):
        x, y, z = places_m[n, 0], places_m[n, 1], places_m[n, 2]
        a, b, c = omega[1] * z - omega[2] * y, omega[2] * x - omega[0] * z, omega[0] * y - omega[1] * x
        for axis in range(3):
            row = 3 * axis
            world_m[n, axis] = p[axis] + rotation[row] * x + rotation[row + 1] * y + rotation[row + 2] * z
            velocity_m_s[n, axis] = v[axis] + rotation[row] * a + rotation[row + 1] * b + rotation[row + 2] * c
