"""Control of a vehicle on wheels: from a path, or a speed and a turn rate, to the torques of two wheels.

A differential drive with the body frame's origin above the middle of its axle: x forward, y left.

Arguments of several functions: `vehicle` a record of `vehicle_records.CONSTANTS`; `dt_s` length of a sub-step [s].
"""

# ruff: noqa: ANN001, ANN201, N806 - kernels have no types, and symbols of equations
# pyright: basic

import math

import numba

from gslcosim.base import elementary
from gslcosim_services.world.multirotor_control import (
    DRIVE,
    advance_heading_inplace,
    align_heading_reference_inplace,
    reference_at,
    rotation_from_quaternion,
    wrap_angle,
)

# Slower than this a reference stands still and has no direction of its own.
_STANDSTILL_SPEED_M_S = 1e-3
# Excess of a wheel over its top speed that the control may use to correct errors.
_WHEEL_SPEED_RESERVE = 1.2
# Its z axis further from the vertical than this, a vehicle lies and its wheels are stopped.
_MIN_UPRIGHTNESS = 0.3


@numba.njit(cache=True, nogil=True)
def path_speed_and_turn(vehicle, state, x, y, yaw, t_s, dt_s):
    """Return the speed and the rate of turn that bring a vehicle on wheels onto its path.

    v = v_r cos e_th + k_x e_x
    w = w_r + v_r k_y e_y + k_th sin e_th,  w_r = (v_x a_y - v_y a_x)/v_r^2
    [m/s] = [1/s] [m];  [rad/s] = [m/s] [1/m^2] [m] = [1/s]

    e_x, e_y are the way from the vehicle to the reference along its nose and to its left, e_th is the direction of the
    reference's motion seen from the nose; for a reference at rest, that of the desired heading. Beyond a quarter
    turn e_th is taken as one.

    Args:
        state: Record of `records.STATE`; its heading is advanced.
        x, y: Position, world frame [m].
        yaw: Heading, counter-clockwise from world x [rad].
        t_s: Time since the end of the trajectory's start tick [s].

    Returns:
        (speed [m/s], rate of turn to the left [rad/s]).

    Source:
        Kanayama, Kimura, Miyazaki and Noguchi 1990, doi:10.1109/ROBOT.1990.126006, equation 7.
    Deviation:
        k_th does not shrink with the speed, so that a standing vehicle turns too; with the Lyapunov function
        (e_x^2 + e_y^2)/2 + (1 - cos e_th)/k_y the errors fall as in the paper.
    Held by:
        tests/unit/services/world/test_rover_control.py, tests/analytic/test_world_driving.py
    """
    x_r, u_r, a_x, _ = reference_at(state, 0, t_s)
    y_r, v_r, a_y, _ = reference_at(state, 1, t_s)
    speed = math.sqrt(u_r * u_r + v_r * v_r)
    if speed > _STANDSTILL_SPEED_M_S:
        direction = elementary.atan2(v_r, u_r)
        turn = (u_r * a_y - v_r * a_x) / (speed * speed)
        state.yaw_rad = direction
        state.wanted_yaw_rad = direction
        state.yaw_rate_rad_s = 0.0
    else:
        advance_heading_inplace(vehicle, state, 0.0, 0.0, dt_s)
        direction, turn = state.yaw_rad, state.yaw_rate_rad_s
    c, s = elementary.cos(yaw), elementary.sin(yaw)
    e_x, e_y = c * (x_r - x) + s * (y_r - y), c * (y_r - y) - s * (x_r - x)
    e_th = min(max(wrap_angle(direction - yaw), -0.5 * math.pi), 0.5 * math.pi)
    v = speed * elementary.cos(e_th) + vehicle.along_gain_s * e_x
    return v, turn + speed * vehicle.across_gain_m2 * e_y + vehicle.heading_gain_s * elementary.sin(e_th)


@numba.njit(cache=True, nogil=True)
def wheel_torque_inplace(vehicle, state, i_wheel, wanted_rad_s, speed_rad_s, dt_s):
    """Return the torque of a wheel's motor, a servo of its speed.

    tau = k e + i, |tau| <= tau_max;  di/dt = k_i e, |i| <= tau_max;  e = w_wanted - w
    [N m] = [N m s] [rad/s];  [N m/s] = [N m] [rad/s]

    Args:
        state: Record of `records.STATE`; the wheel's integral is advanced.
        i_wheel: 0 for the left one, 1 for the right one.
        wanted_rad_s: Desired speed [rad/s].
        speed_rad_s: Speed [rad/s].

    Held by:
        tests/unit/services/world/test_rover_control.py
    """
    error, most = wanted_rad_s - speed_rad_s, vehicle.max_wheel_torque_n_m
    integral = state.wheel_integral_n_m[i_wheel] + vehicle.wheel_integral_gain_n_m * error * dt_s
    integral = min(max(integral, -most), most)
    state.wheel_integral_n_m[i_wheel] = integral
    return min(max(vehicle.wheel_gain_n_m_s * error + integral, -most), most)


@numba.njit(cache=True, nogil=True)
def wheel_speeds(vehicle, speed_m_s, turn_rad_s):
    """Return the speeds of left and right wheel [rad/s] for a speed and a rate of turn.

    w_left = (v - w b)/r, w_right = (v + w b)/r
    [rad/s] = [m/s] / [m],  b half the track, r the radius of the wheels

    A turn is kept and the speed is cut where a wheel would turn faster than it can.

    Args:
        speed_m_s: Along the nose [m/s].
        turn_rad_s: To the left [rad/s].

    Held by:
        tests/unit/services/world/test_rover_control.py
    """
    most_turn = vehicle.max_yaw_rate_rad_s * _WHEEL_SPEED_RESERVE
    turn = min(max(turn_rad_s, -most_turn), most_turn) * vehicle.half_track_m
    most = max(vehicle.max_speed_m_s * _WHEEL_SPEED_RESERVE - abs(turn), 0.0)
    speed = min(max(speed_m_s, -most), most)
    return (speed - turn) / vehicle.wheel_radius_m, (speed + turn) / vehicle.wheel_radius_m


@numba.njit(cache=True, nogil=True)
def step_rover_inplace(vehicle, state, p, v, force, t_s, dt_s):
    """Advance the controller of a vehicle on wheels by one sub-step and write the torques of its wheels.

    A setpoint of the agent is approached with the vehicle's acceleration; a path already keeps to it.

    Args:
        state: Record of `records.STATE`; heading, set speed and integrals are advanced.
        p: (7,) position, world frame [m], and attitude quaternion wxyz.
        v: (8,) velocity of the body, then speeds of left and right wheel [rad/s].
        force: (8,) the last two are written: torques of left and right wheel [N m].
        t_s: Time since the end of the trajectory's start tick [s].

    Held by:
        tests/analytic/test_world_driving.py, tests/unit/services/world/test_rover.py
    """
    R = rotation_from_quaternion(p[3], p[4], p[5], p[6])
    speed = turn = 0.0
    if state.is_armed and R[8] > _MIN_UPRIGHTNESS:
        if state.control == DRIVE:
            step = vehicle.max_acceleration_m_s2 * dt_s
            state.drive_speed_m_s += min(max(state.setpoint[0] - state.drive_speed_m_s, -step), step)
            step /= vehicle.half_track_m
            state.drive_turn_rad_s += min(max(state.setpoint[1] - state.drive_turn_rad_s, -step), step)
            speed, turn = state.drive_speed_m_s, state.drive_turn_rad_s
            align_heading_reference_inplace(state, R)
        else:
            yaw = elementary.atan2(R[3], R[0])
            speed, turn = path_speed_and_turn(vehicle, state, p[0], p[1], yaw, t_s, dt_s)
            state.drive_speed_m_s, state.drive_turn_rad_s = speed, turn
    left, right = wheel_speeds(vehicle, speed, turn)
    force[6] = wheel_torque_inplace(vehicle, state, 0, left, v[6], dt_s)
    force[7] = wheel_torque_inplace(vehicle, state, 1, right, v[7], dt_s)
