# pyright: basic, reportCallIssue=false
# ruff: noqa: ANN001, ANN201, N806 - kernels have no types, and symbols of equations
"""Rigid body of a rotorcraft in free flight: a run's control, rotors and drag, and MuJoCo's step of one free body.

Symbols: p, v position and velocity in the world frame; q the attitude; omega the angular velocity in the body frame.
"""

import math

import numpy as np

from gslcosim.base import elementary
from gslcosim.base.scalar_kernels import norm2
from gslcosim.environment.grid_kernels import trilinear_wind
from gslcosim_services.world.multirotor_control import rotation_from_quaternion
from gslcosim_services.world.simulation_loop import is_state_plausible, path_time_s, step_rotorcraft_inplace
from gslcosim_training.batch.free_space import array_at, may_touch, wind_address_at
from gslcosim_training.batch.reference_free_kernels import reference_free_njit
from gslcosim_training.batch.scalar_compilation import address_of

# Slower than this a body does not turn, as MuJoCo has it [rad/s].
_LEAST_RATE_RAD_S = 1e-15


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
    force, acceleration = work.force, search.acceleration_m_s2
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
    return True


@reference_free_njit()
def advance_free_body_inplace(vehicle, p, v, a, force, dt_s):
    """Advance a free rigid body by a semi-implicit Euler step, as MuJoCo does where nothing touches it.

    a = F/m - g e3,  v <- v + dt a,  p <- p + dt v
    omega <- omega + dt J^-1 (tau - omega x J omega),  q <- q/|q| exp(dt omega/2)
    [m/s^2] = [N]/[kg],  [m] = [s] [m/s],  [rad/s] = [s] [N m]/[kg m^2]

    Velocities advance first, and places with the new ones; the gyroscopic torque is that of the old rate.

    Args:
        vehicle: Record of `records.CONSTANTS`: mass, inertia about the body axes, gravity.
        p: (7,) position, world frame [m], and attitude quaternion wxyz; advanced.
        v: (6,) velocity, world frame [m/s], and angular velocity, body frame [rad/s]; advanced.
        a: (3,) written: acceleration, world frame [m/s^2].
        force: (6,) force, world frame [N], and torque, body frame [N m], about the centre of mass.
        dt_s: Length of the step [s].

    Source:
        MuJoCo, doi:10.1109/IROS.2012.6386109, its integrator Euler for a free joint without damping, and its
        `mju_quatIntegrate`, written anew from its documentation.
    Deviation:
        The order of some products and sums, so it differs by rounding. Contacts are left out.
    Held by:
        extensions/training/tests/unit/batch/test_rigid_body.py (against MuJoCo, step by step)
    """
    J = vehicle.inertia_kg_m2
    for axis in range(3):
        a[axis] = force[axis] / vehicle.mass_kg
    a[2] -= vehicle.gravity_m_s2
    for axis in range(3):
        v[axis] += dt_s * a[axis]
        p[axis] += dt_s * v[axis]
    x, y, z = v[3], v[4], v[5]
    v[3] = x + dt_s * ((force[3] - (J[2] - J[1]) * y * z) / J[0])
    v[4] = y + dt_s * ((force[4] - (J[0] - J[2]) * z * x) / J[1])
    v[5] = z + dt_s * ((force[5] - (J[1] - J[0]) * x * y) / J[2])
    x, y, z = v[3], v[4], v[5]
    rate = math.sqrt(x * x + y * y + z * z)
    if rate < _LEAST_RATE_RAD_S:
        return
    angle = 0.5 * dt_s * rate
    s, c = elementary.sin(angle) / rate, elementary.cos(angle)
    x, y, z = s * x, s * y, s * z
    norm = math.sqrt(p[3] * p[3] + p[4] * p[4] + p[5] * p[5] + p[6] * p[6])
    d, e, f, g = p[3] / norm, p[4] / norm, p[5] / norm, p[6] / norm
    p[3] = d * c - e * x - f * y - g * z
    p[4] = d * x + e * c + f * z - g * y
    p[5] = d * y - e * z + f * c + g * x
    p[6] = d * z + e * y - f * x + g * c


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
