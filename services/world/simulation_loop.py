# pyright: basic
# pyright: reportAttributeAccessIssue=false
"""Compiled simulation loop: control, rotors, drag and MuJoCo's step for all vehicles, sub-step by sub-step.

Arguments of several functions: `vehicle` a record of `vehicle_records.CONSTANTS`; `state` one of `STATE`, whose
integral, heading and rotor speeds are advanced; `p` (7 or more,) position, world frame [m], and attitude quaternion
wxyz; `v` (6 or more,) velocity, world frame [m/s], and angular velocity, body frame [rad/s]; `force` (6,) written:
force, world frame [N], and torque, body frame [N m]; `R` nine numbers, rows of the matrix that turns body-frame into
world-frame vectors; `t_s` time since the end of the trajectory's start tick [s]; `dt_s` length of a sub-step [s].
"""

# ruff: noqa: ANN001, ANN201, ANN202, N803, N806 - kernels have no types, and symbols of equations

import ctypes
import math
from pathlib import Path
from typing import Any, NamedTuple, Self, cast

import mujoco
import numba
import numpy as np
from llvmlite import binding
from numba import types
from numba.extending import intrinsic
from numba.np.arrayobj import make_array
from numpy.typing import NDArray

from gslcosim.base import elementary
from gslcosim.base.errors import ModelError
from gslcosim.environment.grid_kernels import trilinear_wind
from gslcosim_services.world.multirotor_control import (
    ATTITUDE,
    PATH,
    advance_heading_inplace,
    align_heading_reference_inplace,
    attitude_from_angles,
    attitude_from_force,
    attitude_torque,
    axis_acceleration_inplace,
    drag_force,
    lagged_rotor_speed,
    limited_specific_force,
    rate_torque,
    reference_at,
    rotation_from_quaternion,
    rotor_speed_command,
    rotor_wrench,
    thrust_along,
    thrust_from_setpoint,
)
from gslcosim_services.world.rover_control import step_rover_inplace

# Beyond these a state has exploded: [m], [m/s], [rad/s].
_MAX_POSITION_M = 1e5
_MAX_SPEED_M_S = 200.0
_MAX_RATE_RAD_S = 500.0
# Slower than this a body does not turn, as in MuJoCo.
_LEAST_RATE_RAD_S = 1e-15
# 1.5 times 2^19: added and taken away, it leaves multiples of 2^-33.
_ROUNDER = 786432.0
_mj_step = types.ExternalFunction("mujoco_mj_step", types.void(types.intp, types.intp))


def _find_step_address() -> int:
    folder = Path(mujoco.__file__).parent
    for pattern in ("libmujoco.so*", "libmujoco*.dylib", "mujoco.dll"):
        for path in sorted(folder.glob(pattern)):
            address = ctypes.cast(ctypes.CDLL(str(path)).mj_step, ctypes.c_void_p).value
            if address:
                return address
    raise ModelError(f"mujoco {mujoco.__version__}: expected its shared library beside the package.\nFolder: {folder}")


# Called by its name, since code from the cache of kernels runs in processes where the address is another.
binding.add_symbol("mujoco_mj_step", _find_step_address())


@numba.njit(cache=True, nogil=True)
def is_state_plausible(p, v):
    """Return whether a vehicle's state is finite and within what a vehicle can do.

    Held by:
        tests/unit/services/world/test_world_core.py
    """
    # Comparisons are written so that NaN fails them.
    for i in range(3):
        if not abs(p[i]) < _MAX_POSITION_M:
            return False
        if not abs(v[i]) < _MAX_SPEED_M_S:
            return False
        if not abs(v[3 + i]) < _MAX_RATE_RAD_S:
            return False
    return True


@numba.njit(cache=True, nogil=True)
def path_time_s(state, tick, tick_s, i_substep, dt_s):
    """Return the time since the end of a path's start tick [s] at which a sub-step of a tick begins.

    Args:
        tick: The tick that is advanced to.
        tick_s: Length of a tick [s].
        i_substep: The sub-step, counted in the tick.
    """
    return (tick - 1 - state.start_tick) * tick_s + i_substep * dt_s


@numba.njit(cache=True, nogil=True)
def path_force_inplace(vehicle, state, p, v, t_s, dt_s):
    """Return the specific force [m/s^2] that follows the path and the reference's jerk, world frame.

    Held by:
        tests/analytic/test_world_flight.py
    """
    a_x, j_x = axis_acceleration_inplace(vehicle, state, 0, p[0], v[0], t_s, dt_s)
    a_y, j_y = axis_acceleration_inplace(vehicle, state, 1, p[1], v[1], t_s, dt_s)
    a_z, j_z = axis_acceleration_inplace(vehicle, state, 2, p[2], v[2], t_s, dt_s)
    u_ref = v_ref = 0.0
    if state.faces_path:
        u_ref, v_ref = reference_at(state, 0, t_s)[1], reference_at(state, 1, t_s)[1]
    advance_heading_inplace(vehicle, state, u_ref, v_ref, dt_s)
    f_x, f_y, f_z = limited_specific_force(vehicle, a_x, a_y, a_z)
    return f_x, f_y, f_z, j_x, j_y, j_z


@numba.njit(cache=True, nogil=True)
def step_rotorcraft_inplace(vehicle, state, p, v, force, t_s, dt_s, wind_u, wind_v, wind_w):
    """Advance a multirotor's controller and rotors by one sub-step and write the force on its body.

    Args:
        wind_u: Wind at the vehicle along world x [m/s].
        wind_v: Wind at the vehicle along world y [m/s].
        wind_w: Wind at the vehicle along world z [m/s].

    Held by:
        tests/analytic/test_world_flight.py, tests/unit/services/world/test_setpoints.py
    """
    R = rotation_from_quaternion(p[3], p[4], p[5], p[6])
    thrust = t_x = t_y = t_z = 0.0
    if state.is_armed and state.control == PATH:
        f_x, f_y, f_z, j_x, j_y, j_z = path_force_inplace(vehicle, state, p, v, t_s, dt_s)
        R_d, omega_d = attitude_from_force(f_x, f_y, f_z, j_x, j_y, j_z, state.yaw_rad, state.yaw_rate_rad_s)
        thrust = thrust_along(vehicle, R, f_x, f_y, f_z)
        t_x, t_y, t_z = attitude_torque(vehicle, R, v[3], v[4], v[5], R_d, omega_d)
    elif state.is_armed:
        a, b, c = state.setpoint[0], state.setpoint[1], state.setpoint[2]
        thrust = thrust_from_setpoint(vehicle, state, R, v[2])
        if state.control == ATTITUDE:
            R_d = attitude_from_angles(a, b, c)
            t_x, t_y, t_z = attitude_torque(vehicle, R, v[3], v[4], v[5], R_d, (0.0, 0.0, 0.0))
        else:
            t_x, t_y, t_z = rate_torque(vehicle, v[3], v[4], v[5], a, b, c, 0.0, 0.0, 0.0)
        align_heading_reference_inplace(state, R)
    speeds = state.rotor_speed_rad_s
    for i in range(vehicle.n_rotors):
        command = rotor_speed_command(vehicle, i, thrust, t_x, t_y, t_z)
        speeds[i] = lagged_rotor_speed(vehicle, speeds[i], command)
    write_rotorcraft_force_inplace(vehicle, speeds, R, force, wind_u - v[0], wind_v - v[1], wind_w - v[2])


@numba.njit(cache=True, nogil=True)
def step_point_robot_inplace(vehicle, state, p, v, force, t_s, dt_s):
    """Advance a point robot's controller by one sub-step and write its force and torque; the robot has no drag.

    Held by:
        tests/analytic/test_world_flight.py
    """
    R = rotation_from_quaternion(p[3], p[4], p[5], p[6])
    f_x = f_y = f_z = 0.0
    if state.is_armed:
        f_x, f_y, f_z, _, _, _ = path_force_inplace(vehicle, state, p, v, t_s, dt_s)
    upright, rates = attitude_from_force(0.0, 0.0, 1.0, 0.0, 0.0, 0.0, state.yaw_rad, state.yaw_rate_rad_s)
    t_x, t_y, t_z = attitude_torque(vehicle, R, v[3], v[4], v[5], upright, rates)
    force[0], force[1], force[2] = vehicle.mass_kg * f_x, vehicle.mass_kg * f_y, vehicle.mass_kg * f_z
    force[3], force[4], force[5] = t_x, t_y, t_z


@numba.njit(cache=True, nogil=True)
def write_rotorcraft_force_inplace(vehicle, speeds, R, force, u, v, w):
    """Write what rotors and air do to a rotorcraft.

    F_W = R (lift e3 + D(R' u));  torque in the body frame
    [N], [N m]

    Args:
        speeds: (n_rotors or more,) rotor speeds [rad/s].
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
def has_contact(vehicle, qfrc_constraint, sensordata):
    """Return whether something touches a vehicle that may be a collision.

    A vehicle that drives stands on the floor all the time: its hull has a sensor for touch. Others are free bodies, on
    which only contacts act.

    Args:
        qfrc_constraint: View of MuJoCo's contact forces, in the axes of qvel [N, N m].
        sensordata: View of MuJoCo's sensors [N].

    Held by:
        tests/unit/services/world/test_world_core.py, tests/unit/services/world/test_rover.py
    """
    if vehicle.i_touch >= 0:
        return sensordata[vehicle.i_touch] > 0.0
    touched = False
    for i in range(vehicle.i_qvel, vehicle.i_qvel + 6):
        touched |= qfrc_constraint[i] != 0.0
    return touched


@numba.njit(cache=True, nogil=True)
def write_inertial_inplace(vehicle, p, v, a, row):
    """Write what an inertial measurement unit at a vehicle's origin would feel after a sub-step.

    f_B = R' (a_W - g_W)      [m/s^2], g downwards

    Args:
        a: (6 or more,) their rates of change during the sub-step.
        row: (9,) written: specific force [m/s^2], angular velocity [rad/s] and acceleration [rad/s^2], body frame.

    Held by:
        tests/unit/services/world/test_inertial.py
    """
    r00, r01, r02, r10, r11, r12, r20, r21, r22 = rotation_from_quaternion(p[3], p[4], p[5], p[6])
    f_x, f_y, f_z = a[0], a[1], a[2] + vehicle.gravity_m_s2
    row[0] = r00 * f_x + r10 * f_y + r20 * f_z
    row[1] = r01 * f_x + r11 * f_y + r21 * f_z
    row[2] = r02 * f_x + r12 * f_y + r22 * f_z
    for i in range(3):
        row[3 + i] = v[3 + i]
        row[6 + i] = a[3 + i]


class SceneArrays(NamedTuple):
    """Views of the arrays of a MuJoCo scene and their addresses, which stay valid as long as model and data live.

    Attributes:
        qpos: (n_qpos,) positions: per vehicle xyz [m] and quaternion wxyz, world frame, then wheels.
        qvel: (n_qvel,) velocities: xyz [m/s], world frame, and angular [rad/s], body frame, then wheels.
        qacc: (n_qvel,) accelerations, in the axes of qvel.
        qacc_warmstart: (n_qvel,) accelerations with which MuJoCo begins to look for those of the next step.
        qfrc_applied: (n_qvel,) applied forces, in the axes of qvel [N, N m].
        qfrc_constraint: (n_qvel,) contact forces, in the axes of qvel [N, N m].
        sensordata: Sensors of touch [N].
        contype: (n_bodies,) bits of what a body collides as; 0 here and below takes it out of all collisions.
        conaffinity: (n_bodies,) bits of what collides with it.
        obstacles_m: (n, 2, 3) middle and half sides of boxes around all that is fixed, world frame [m].
        model_address: Address of the mjModel.
        data_address: Address of the mjData.
    """

    qpos: NDArray[np.float64]
    qvel: NDArray[np.float64]
    qacc: NDArray[np.float64]
    qacc_warmstart: NDArray[np.float64]
    qfrc_applied: NDArray[np.float64]
    qfrc_constraint: NDArray[np.float64]
    sensordata: NDArray[np.float64]
    contype: NDArray[np.int32]
    conaffinity: NDArray[np.int32]
    obstacles_m: NDArray[np.float64]
    model_address: int
    data_address: int

    @classmethod
    def of(cls, model: mujoco.MjModel, data: mujoco.MjData) -> Self:
        """Return the arrays of a scene whose fixed geoms are boxes along the axes of the world."""
        fixed = model.geom_bodyid == 0
        return cls(
            data.qpos, data.qvel, data.qacc, data.qacc_warmstart, data.qfrc_applied, data.qfrc_constraint,
            data.sensordata, model.body_contype, model.body_conaffinity,
            np.stack([model.geom_pos[fixed], model.geom_size[fixed]], axis=1), model._address, data._address,
        )  # fmt: skip


@numba.njit(cache=True, nogil=True)
def mark_near_inplace(is_near, vehicles, qpos, obstacles_m):
    """Mark the vehicles that may touch something: a fixed box or another vehicle is in reach of one along all axes.

    One that is no plain body is marked too: MuJoCo advances it.

    Args:
        is_near: (n,) written.
        vehicles: (n,) records of `records.CONSTANTS`.
        qpos: See `SceneArrays`, and for `obstacles_m`.

    Held by:
        tests/unit/services/world/test_world_core.py
    """
    n_vehicles = vehicles.shape[0]
    spheres = np.empty((n_vehicles, 4))
    for k in range(n_vehicles):
        i_qpos = vehicles[k].i_qpos
        x, y, z, reach = qpos[i_qpos], qpos[i_qpos + 1], qpos[i_qpos + 2], vehicles[k].reach_m
        spheres[k, 0], spheres[k, 1], spheres[k, 2], spheres[k, 3] = x, y, z, reach
        near = not vehicles[k].is_plain_body
        for i in range(obstacles_m.shape[0]):
            near |= (
                abs(x - obstacles_m[i, 0, 0]) <= obstacles_m[i, 1, 0] + reach
                and abs(y - obstacles_m[i, 0, 1]) <= obstacles_m[i, 1, 1] + reach
                and abs(z - obstacles_m[i, 0, 2]) <= obstacles_m[i, 1, 2] + reach
            )
        for i in range(k):
            both_m = spheres[i, 3] + reach
            if abs(x - spheres[i, 0]) > both_m or abs(y - spheres[i, 1]) > both_m or abs(z - spheres[i, 2]) > both_m:
                continue
            is_near[i] = near = True
        is_near[k] = near


# The array without its count of references, which would change with each of its slices; the caller holds it meanwhile.
@cast(Any, intrinsic)
def _uncounted(typing_context, array):
    def build(context, builder, signature, arguments):
        view = make_array(array)(context, builder, arguments[0])
        view.meminfo = view.meminfo.type(None)
        return view._getvalue()

    return array(array), build


# Looking for the contacts of what is far from all else takes MuJoCo longer than a step, and finds none.
@numba.njit(cache=True, nogil=True)
def _step_near(is_near, vehicles, scene) -> bool:
    mark_near_inplace(is_near, vehicles, scene.qpos, scene.obstacles_m)
    if not is_near.any():
        return False
    contype, conaffinity = scene.contype, scene.conaffinity
    for k in range(vehicles.shape[0]):
        if not is_near[k]:
            contype[vehicles[k].i_body] = conaffinity[vehicles[k].i_body] = 0
    _mj_step(scene.model_address, scene.data_address)
    for k in range(vehicles.shape[0]):
        contype[vehicles[k].i_body], conaffinity[vehicles[k].i_body] = vehicles[k].contype, vehicles[k].conaffinity
    return True


@numba.njit(cache=True, nogil=True)
def turn_attitude_inplace(q, w, dt_s):
    """Turn an attitude at a constant rate.

    q <- q/|q| (cos(|w| dt / 2), w / |w| sin(|w| dt / 2))

    Args:
        q: (4,) quaternion wxyz, body to world; turned.
        w: (3,) angular velocity, body frame [rad/s].
        dt_s: Time of the rotation [s].

    Source:
        MuJoCo's `mju_quatIntegrate`, whose sine is the C library's.
    Held by:
        tests/unit/services/world/test_world_core.py
    """
    x, y, z = w[0], w[1], w[2]
    rate = math.sqrt(x * x + y * y + z * z)
    if rate < _LEAST_RATE_RAD_S:
        return
    angle = 0.5 * dt_s * rate
    s, c = elementary.sin(angle) / rate, elementary.cos(angle)
    x, y, z = s * x, s * y, s * z
    norm = math.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    d, e, f, g = q[0] / norm, q[1] / norm, q[2] / norm, q[3] / norm
    q[0] = d * c - e * x - f * y - g * z
    q[1] = d * x + e * c + f * z - g * y
    q[2] = d * y - e * z + f * c + g * x
    q[3] = d * z + e * y - f * x + g * c


# To multiples of 2^-33, a ten-thousandth of a micrometre: MuJoCo's builds for other processors differ by less.
@numba.njit(cache=True, nogil=True)
def _round_inplace(numbers):
    for i in range(numbers.shape[0]):
        numbers[i] = (numbers[i] + _ROUNDER) - _ROUNDER


@numba.njit(cache=True, nogil=True)
def advance_free_body_inplace(vehicle, p, v, a, force, dt_s):
    """Advance a plain body by a semi-implicit Euler step, as MuJoCo does where nothing touches it.

    a = F/m - g e3,  v <- v + dt a,  p <- p + dt v
    alpha = J^-1 (tau - omega x J omega),  omega <- omega + dt alpha,  q <- q/|q| exp(dt omega/2)
    [m/s^2] = [N]/[kg],  [m] = [s] [m/s],  [rad/s^2] = [N m]/[kg m^2]

    Velocities advance first, and places with the new ones; the gyroscopic torque is that of the old rate.

    Args:
        a: (6,) written: acceleration, world frame [m/s^2], and angular acceleration, body frame [rad/s^2].
        force: (6,) force, world frame [N], and torque, body frame [N m], about the centre of mass.

    Source:
        MuJoCo, doi:10.1109/IROS.2012.6386109, its integrator Euler for a free joint without damping, written anew from
        its documentation.
    Deviation:
        The order of some products and sums, so it differs by rounding, and is the same on every processor.
    Held by:
        tests/unit/services/world/test_free_body.py (against MuJoCo, step by step)
    """
    J = vehicle.inertia_kg_m2
    for axis in range(3):
        a[axis] = force[axis] / vehicle.mass_kg
    a[2] -= vehicle.gravity_m_s2
    x, y, z = v[3], v[4], v[5]
    a[3] = (force[3] - (J[2] - J[1]) * y * z) / J[0]
    a[4] = (force[4] - (J[0] - J[2]) * z * x) / J[1]
    a[5] = (force[5] - (J[1] - J[0]) * x * y) / J[2]
    for axis in range(6):
        v[axis] += dt_s * a[axis]
    for axis in range(3):
        p[axis] += dt_s * v[axis]
    turn_attitude_inplace(p[3:7], v[3:6], dt_s)


@numba.njit(cache=True, nogil=True)
def run_substeps_inplace(
    first, n_substeps, tick, tick_s, vehicles, states, inertial, scene, wind_velocity_m_s, wind_origin_m, wind_cell_m
):
    """Run sub-steps of a tick until its end, the first contact, or the first unsound state.

    MuJoCo's step is taken where a vehicle is near something, and counts for those that touch something or are no plain
    bodies; all others are advanced by `advance_free_body_inplace`.

    Stopping at a contact lets the caller read MuJoCo's contact list, which is valid only until the next sub-step.

    Args:
        first: Index of the first sub-step to run, 0 to n_substeps.
        n_substeps: Sub-steps in a tick.
        tick: The tick that is advanced to; sub-step i starts at (tick - 1 + i/n_substeps) tick_s.
        tick_s: Length of a tick [s].
        vehicles: (n,) records of `records.CONSTANTS`, with the indices of each vehicle's numbers in those of MuJoCo.
        states: (n,) records of `records.STATE`; advanced.
        inertial: (n, n_substeps or 0, 9) written where it has rows: see `write_inertial_inplace`.
        scene: `SceneArrays`; advanced.
        wind_velocity_m_s: (nx, ny, nz, 3) wind at cell centres, world frame [m/s].
        wind_origin_m: (3,) corner of cell (0, 0, 0), world frame [m].
        wind_cell_m: Edge of the cells [m].

    Returns:
        (next sub-step, index of the unsound vehicle or -1, whether MuJoCo's contact list is that of the last sub-step).

    Held by:
        tests/analytic/test_world_flight.py, tests/unit/services/world/test_world_core.py
    """
    n_vehicles = vehicles.shape[0]
    qpos, qvel, qacc = _uncounted(scene.qpos), _uncounted(scene.qvel), _uncounted(scene.qacc)
    applied, constraint = _uncounted(scene.qfrc_applied), _uncounted(scene.qfrc_constraint)
    warmstart = _uncounted(scene.qacc_warmstart)
    is_near = np.empty(n_vehicles, np.bool_)
    dt_s = tick_s / n_substeps
    poses, motions = np.empty((n_vehicles, 7)), np.empty((n_vehicles, 6))
    is_stepped = False
    for i_substep in range(first, n_substeps):
        for k in range(n_vehicles):
            vehicle, state = vehicles[k], states[k]
            p, v = qpos[vehicle.i_qpos : vehicle.i_qpos + 7], qvel[vehicle.i_qvel : vehicle.i_qvel + 8]
            if not is_state_plausible(p, v):
                return i_substep, k, is_stepped
            poses[k], motions[k] = p, v[:6]
            force = applied[vehicle.i_qvel : vehicle.i_qvel + 8]
            t_s = path_time_s(state, tick, tick_s, i_substep, dt_s)
            if vehicle.has_rotors:
                wind_u, wind_v, wind_w = trilinear_wind(wind_velocity_m_s, wind_origin_m, wind_cell_m, p[0], p[1], p[2])
                step_rotorcraft_inplace(vehicle, state, p, v, force, t_s, dt_s, wind_u, wind_v, wind_w)
            elif vehicle.has_wheels:
                step_rover_inplace(vehicle, state, p, v, force, t_s, dt_s)
            else:
                step_point_robot_inplace(vehicle, state, p, v, force, t_s, dt_s)
        is_stepped, is_any_touched = _step_near(is_near, vehicles, scene), False
        for k in range(n_vehicles):
            vehicle = vehicles[k]
            i, j = vehicle.i_qpos, vehicle.i_qvel
            p, v, a = qpos[i : i + 7], qvel[j : j + 6], qacc[j : j + 6]
            is_touched = is_near[k] and has_contact(vehicle, constraint, scene.sensordata)
            is_any_touched |= is_touched
            if vehicle.is_plain_body and not is_touched:
                p[:], v[:] = poses[k], motions[k]
                advance_free_body_inplace(vehicle, p, v, a, applied[j : j + 6], dt_s)
                warmstart[j : j + 3], warmstart[j + 3 : j + 6] = a[:3], 0.0
            else:
                p[3:7] = poses[k, 3:7]
                turn_attitude_inplace(p[3:7], v[3:6], dt_s)
                _round_inplace(p)
                _round_inplace(v)
        if inertial.shape[1]:
            for k in range(n_vehicles):
                vehicle = vehicles[k]
                write_inertial_inplace(
                    vehicle, qpos[vehicle.i_qpos :], qvel[vehicle.i_qvel :], qacc[vehicle.i_qvel :],
                    inertial[k, i_substep],
                )  # fmt: skip
        if is_any_touched:
            return i_substep + 1, -1, True
    for k in range(n_vehicles):
        vehicle = vehicles[k]
        if not is_state_plausible(qpos[vehicle.i_qpos :], qvel[vehicle.i_qvel :]):
            return n_substeps, k, is_stepped
    return n_substeps, -1, is_stepped
