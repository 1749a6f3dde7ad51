"""The hot loop: control, rotors, drag and MuJoCo for all vehicles, sub-step by sub-step, in compiled code."""
# pyright: basic

import numba

from gslcosim.environment.wind_kernels import trilinear_wind
from gslcosim.world.control_kernels import (
    attitude_wrench,
    axis_acceleration_inplace,
    limited_specific_force,
    rotation_from_quaternion,
    rotor_speed_command,
)
from gslcosim.world.mujoco_kernels import call_step
from gslcosim.world.rotor_kernels import drag_force, lagged_rotor_speed, rotor_wrench

# Beyond these a state has exploded: [m], [m/s], [rad/s].
_FARTHEST_M = 1e5
_FASTEST_M_S = 200.0
_FASTEST_RAD_S = 500.0


@numba.njit(cache=True, nogil=True)
def is_sound(qpos, qvel, i_vehicle):
    """Return whether a vehicle's state is finite and within what a vehicle can do.

    Args:
        qpos: (7 n,) MuJoCo positions: per vehicle xyz [m] and quaternion wxyz, world frame.
        qvel: (6 n,) MuJoCo velocities: per vehicle xyz [m/s], world frame, and angular [rad/s], body frame.
        i_vehicle: Which vehicle.

    Held by:
        tests/unit/world/test_world_core.py
    """
    # Comparisons are written so that NaN fails them.
    for i in range(3):
        if not abs(qpos[7 * i_vehicle + i]) < _FARTHEST_M:
            return False
        if not abs(qvel[6 * i_vehicle + i]) < _FASTEST_M_S:
            return False
        if not abs(qvel[6 * i_vehicle + 3 + i]) < _FASTEST_RAD_S:
            return False
    return True


@numba.njit(cache=True, nogil=True)
def drive_inplace(vehicle, state, p, v, force, t_s, dt_s, wind_u, wind_v, wind_w):
    """Advance a vehicle's controller and rotors by one sub-step and write the force on its body.

    A vehicle without rotors gets the force and torque its controller wants, and feels no drag.

    Args:
        vehicle: Record of `records.CONSTANTS`.
        state: Record of `records.STATE`; integral and rotor speeds are advanced.
        p: (7,) position, world frame [m], and attitude quaternion wxyz.
        v: (6,) velocity, world frame [m/s], and angular velocity, body frame [rad/s].
        force: (6,) written: force, world frame [N], and torque, body frame [N m].
        t_s: Time since the end of the trajectory's start tick [s].
        dt_s: Length of a sub-step [s].
        wind_u: Wind at the vehicle along world x [m/s].
        wind_v: Wind at the vehicle along world y [m/s].
        wind_w: Wind at the vehicle along world z [m/s].

    Held by:
        tests/analytic/test_world_flight.py
    """
    R = rotation_from_quaternion(p[3], p[4], p[5], p[6])
    f_x = f_y = f_z = j_x = j_y = j_z = 0.0
    if state.is_armed:
        a_x, j_x = axis_acceleration_inplace(vehicle, state, 0, p[0], v[0], t_s, dt_s)
        a_y, j_y = axis_acceleration_inplace(vehicle, state, 1, p[1], v[1], t_s, dt_s)
        a_z, j_z = axis_acceleration_inplace(vehicle, state, 2, p[2], v[2], t_s, dt_s)
        f_x, f_y, f_z = limited_specific_force(vehicle, a_x, a_y, a_z)
    if vehicle.has_rotors:
        thrust = t_x = t_y = t_z = 0.0
        if state.is_armed:
            thrust, t_x, t_y, t_z = attitude_wrench(vehicle, R, v[3], v[4], v[5], f_x, f_y, f_z, j_x, j_y, j_z)
        speeds = state.rotor_speed_rad_s
        for i in range(4):
            command = rotor_speed_command(vehicle, i, thrust, t_x, t_y, t_z)
            speeds[i] = lagged_rotor_speed(vehicle, speeds[i], command)
        write_rotorcraft_force_inplace(vehicle, speeds, R, force, wind_u - v[0], wind_v - v[1], wind_w - v[2])
        return
    up = vehicle.gravity_m_s2
    _, t_x, t_y, t_z = attitude_wrench(vehicle, R, v[3], v[4], v[5], 0.0, 0.0, up, 0.0, 0.0, 0.0)
    force[0], force[1], force[2] = vehicle.mass_kg * f_x, vehicle.mass_kg * f_y, vehicle.mass_kg * f_z
    force[3], force[4], force[5] = t_x, t_y, t_z


@numba.njit(cache=True, nogil=True)
def write_rotorcraft_force_inplace(vehicle, speeds, R, force, u, v, w):
    """Write what rotors and air do to a rotorcraft.

    F_W = R (lift e3 + D(R' u));  torque in the body frame
    [N], [N m]

    Args:
        vehicle: Record of `records.CONSTANTS`.
        speeds: (4,) rotor speeds [rad/s].
        R: Nine numbers, rows of the matrix that turns body-frame into world-frame vectors.
        force: (6,) written: force, world frame [N], and torque, body frame [N m].
        u: Relative wind along world x [m/s].
        v: Relative wind along world y [m/s].
        w: Relative wind along world z [m/s].

    Held by:
        tests/analytic/test_world_flight.py
    """
    r00, r01, r02, r10, r11, r12, r20, r21, r22 = R
    lift, t_x, t_y, t_z, total = rotor_wrench(vehicle, speeds)
    d_x, d_y, d_z = drag_force(
        vehicle, total, r00 * u + r10 * v + r20 * w, r01 * u + r11 * v + r21 * w, r02 * u + r12 * v + r22 * w
    )
    d_z += lift
    force[0] = r00 * d_x + r01 * d_y + r02 * d_z
    force[1] = r10 * d_x + r11 * d_y + r12 * d_z
    force[2] = r20 * d_x + r21 * d_y + r22 * d_z
    force[3] = t_x
    force[4] = t_y
    force[5] = t_z


@numba.njit(cache=True, nogil=True)
def fly_substeps_inplace(
    first, n_substeps, tick, tick_s, vehicles, states, qpos, qvel, qfrc_applied, qfrc_constraint,
    wind_velocity_m_s, wind_origin_m, wind_cell_m, step_address, model_address, data_address,
):  # fmt: skip
    """Run sub-steps of a tick until its end, the first contact, or the first unsound state.

    Stopping at a contact lets the caller read MuJoCo's contact list, which is valid only until the next sub-step.

    Args:
        first: Index of the first sub-step to run, 0 to n_substeps.
        n_substeps: Sub-steps in a tick.
        tick: The tick that is advanced to; sub-step i starts at (tick - 1 + i/n_substeps) tick_s.
        tick_s: Length of a tick [s].
        vehicles: (n,) records of `records.CONSTANTS`.
        states: (n,) records of `records.STATE`; advanced.
        qpos: (7 n,) view of MuJoCo's positions: per vehicle xyz [m] and quaternion wxyz, world frame.
        qvel: (6 n,) view of MuJoCo's velocities: xyz [m/s], world frame, and angular [rad/s], body frame.
        qfrc_applied: (6 n,) view of MuJoCo's applied forces, in the axes of qvel [N, N m]; written.
        qfrc_constraint: (6 n,) view of MuJoCo's contact forces, in the axes of qvel [N, N m].
        wind_velocity_m_s: (nx, ny, nz, 3) wind at cell centres, world frame [m/s].
        wind_origin_m: (3,) corner of cell (0, 0, 0), world frame [m].
        wind_cell_m: Edge of the cells [m].
        step_address: Address of mj_step.
        model_address: Address of the mjModel.
        data_address: Address of the mjData.

    Returns:
        (next sub-step, index of the unsound vehicle or -1).

    Held by:
        tests/analytic/test_world_flight.py, tests/unit/world/test_world_core.py
    """
    n_vehicles = vehicles.shape[0]
    dt_s = tick_s / n_substeps
    for i_substep in range(first, n_substeps):
        for k in range(n_vehicles):
            if not is_sound(qpos, qvel, k):
                return i_substep, k
            p, v = qpos[7 * k : 7 * k + 7], qvel[6 * k : 6 * k + 6]
            wind_u, wind_v, wind_w = trilinear_wind(wind_velocity_m_s, wind_origin_m, wind_cell_m, p[0], p[1], p[2])
            t_s = (tick - 1 - states[k].start_tick) * tick_s + i_substep * dt_s
            drive_inplace(
                vehicles[k], states[k], p, v, qfrc_applied[6 * k : 6 * k + 6], t_s, dt_s, wind_u, wind_v, wind_w
            )
        call_step(step_address, model_address, data_address)  # pyright: ignore[reportCallIssue]
        for i in range(6 * n_vehicles):
            if qfrc_constraint[i] != 0.0:
                return i_substep + 1, -1
    for k in range(n_vehicles):
        if not is_sound(qpos, qvel, k):
            return n_substeps, k
    return n_substeps, -1
