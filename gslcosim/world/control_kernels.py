"""Geometric position and attitude control of a multirotor, and the mixing of its rotors.

Symbols: p, v position and velocity in the world frame W; R turns body-frame vectors into world-frame vectors;
omega is the angular velocity in the body frame B; `_d` is desired.
"""
# pyright: basic

import math

import numba

from gslcosim.world.trajectory_kernels import polynomial_at

# Bounds of the vertical specific force, in units of gravity: the vehicle never pushes downwards.
_LEAST_LIFT = 0.3
_MOST_LIFT = 1.7


@numba.njit(cache=True, nogil=True, inline="always")
def reference_at(state, axis, t_s):
    """Return position, velocity, acceleration and jerk of one axis of a vehicle's reference.

    Args:
        state: Record of `records.STATE`.
        axis: 0, 1 or 2; world frame.
        t_s: Time since the end of the trajectory's start tick [s].

    Returns:
        ([m], [m/s], [m/s^2], [m/s^3]); after the polynomial's end steady motion with its end velocity.

    Held by:
        tests/unit/world/test_control_kernels.py
    """
    if t_s < state.duration_s:
        return polynomial_at(state.coefficients, axis, t_s)
    velocity = state.end_velocity_world_m_s[axis]
    return state.end_world_m[axis] + velocity * (t_s - state.duration_s), velocity, 0.0, 0.0


@numba.njit(cache=True, nogil=True, inline="always")
def rotation_from_quaternion(w, x, y, z):
    """Return the rotation matrix of a unit quaternion, row by row: world-frame from body-frame vectors.

    Held by:
        tests/unit/world/test_control_kernels.py (against gslcosim.frames)
    """
    return (
        1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y),
        2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x),
        2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y),
    )  # fmt: skip


@numba.njit(cache=True, nogil=True)
def axis_acceleration_inplace(vehicle, state, axis, p, v, t_s, dt_s):
    """Return the acceleration wanted along one world axis, before gravity, and the reference's jerk.

    a_d = a_ref + k_p e_p + k_v e_v + i + k_drag v_ref,  di/dt = k_i e_p (clamped),  e = reference - state
    [m/s^2] = [1/s^2] [m] = [1/s] [m/s];  i in [m/s^2]

    k_drag v_ref is the rotor drag expected in still air on the horizontal axes.

    Args:
        vehicle: Record of `records.CONSTANTS`.
        state: Record of `records.STATE`; its integral is advanced by dt_s.
        axis: 0, 1 or 2; world frame.
        p: Position along the axis [m].
        v: Velocity along the axis [m/s].
        t_s: Time since the end of the trajectory's start tick [s].
        dt_s: Length of a sub-step [s].

    Returns:
        (acceleration [m/s^2], jerk [m/s^3]).

    Source:
        Lee, Leok and McClamroch 2010, doi:10.1109/CDC.2010.5717652, equation 19, with an integral term as in Goodarzi,
        Lee and Lee 2013, doi:10.23919/ECC.2013.6669644; rotor drag ahead as in Faessler, Franchi and Scaramuzza 2018,
        doi:10.1109/LRA.2017.2776353.
    Deviation:
        Gains per unit of mass; the integral is of the position error alone and is clamped; the drag is that of hover.
    Held by:
        tests/unit/world/test_control_kernels.py, tests/analytic/test_world_flight.py
    """
    p_ref, v_ref, a_ref, jerk = reference_at(state, axis, t_s)
    e_p = p_ref - p
    limit = vehicle.integral_limit_m_s2
    integral = state.integral_m_s2[axis] + vehicle.integral_gain_s3 * e_p * dt_s
    integral = min(max(integral, -limit), limit)
    state.integral_m_s2[axis] = integral
    a = a_ref + vehicle.position_gain_s2 * e_p + vehicle.velocity_gain_s * (v_ref - v) + integral
    if axis < 2:
        a += vehicle.expected_drag_s * v_ref
    return a, jerk


@numba.njit(cache=True, nogil=True)
def limited_specific_force(vehicle, a_x, a_y, a_z):
    """Return the specific force wanted of the rotors: gravity added, lift and tilt kept within bounds.

    f = a + g z_W;  0.3 g <= f_z <= 1.7 g;  |f_xy| <= tan(tilt_max) f_z
    [m/s^2]

    Args:
        vehicle: Record of `records.CONSTANTS`.
        a_x: Acceleration wanted, world frame [m/s^2].
        a_y: Acceleration wanted, world frame [m/s^2].
        a_z: Acceleration wanted, world frame [m/s^2].

    Returns:
        (f_x, f_y, f_z) world frame [m/s^2]; its direction is always defined.

    Source:
        Our bounds; they keep the desired attitude of Lee et al. 2010 defined, which asks for f != 0.
    Held by:
        tests/unit/world/test_control_kernels.py
    """
    g = vehicle.gravity_m_s2
    f_z = min(max(a_z + g, _LEAST_LIFT * g), _MOST_LIFT * g)
    horizontal = math.sqrt(a_x * a_x + a_y * a_y)
    most = vehicle.max_tilt_tangent * f_z
    scale = most / horizontal if horizontal > most else 1.0
    return scale * a_x, scale * a_y, f_z


@numba.njit(cache=True, nogil=True)
def attitude_wrench(vehicle, R, omega_x, omega_y, omega_z, f_x, f_y, f_z, j_x, j_y, j_z):
    """Return collective thrust and body torque that turn the thrust axis to the wanted force, heading along world x.

    T = m f . R e3
    b3 = f/|f|, b2 = b3 x e1/|b3 x e1|, b1 = b2 x b3, R_d = [b1 b2 b3]
    e_R = 1/2 vee(R_d' R - R' R_d), e_omega = omega - R' R_d omega_d
    h = (j - (b3 . j) b3)/|f|, omega_d = (-h . b2, h . b1, 0)
    tau = J (-k_R e_R - k_omega e_omega) + omega x J omega
    [N] = [kg] [m/s^2];  [N m] = [kg m^2] [1/s^2]

    Args:
        vehicle: Record of `records.CONSTANTS`.
        R: Nine numbers, rows of the matrix that turns body-frame into world-frame vectors.
        omega_x: Angular velocity, body frame [rad/s].
        omega_y: Angular velocity, body frame [rad/s].
        omega_z: Angular velocity, body frame [rad/s].
        f_x: Specific force wanted, world frame [m/s^2], f_z > 0.
        f_y: Specific force wanted, world frame [m/s^2].
        f_z: Specific force wanted, world frame [m/s^2].
        j_x: Jerk of the reference, world frame [m/s^3].
        j_y: Jerk of the reference, world frame [m/s^3].
        j_z: Jerk of the reference, world frame [m/s^3].

    Returns:
        (thrust [N], torque about body x, y, z [N m]).

    Source:
        Lee, Leok and McClamroch 2010, doi:10.1109/CDC.2010.5717652, equations 10, 11, 15, 16; omega_d from the jerk as
        in Mellinger and Kumar 2011, doi:10.1109/ICRA.2011.5980409, section III.
    Deviation:
        Gains per unit of inertia; the desired angular acceleration is left out; the heading is fixed.
    Held by:
        tests/unit/world/test_control_kernels.py
    """
    r00, r01, r02, r10, r11, r12, r20, r21, r22 = R
    size = math.sqrt(f_x * f_x + f_y * f_y + f_z * f_z)
    b3x, b3y, b3z = f_x / size, f_y / size, f_z / size
    # b3 x e1 = (0, b3z, -b3y), never zero because f_z > 0.
    n = math.sqrt(b3z * b3z + b3y * b3y)
    b2y, b2z = b3z / n, -b3y / n
    b1x, b1y, b1z = b2y * b3z - b2z * b3y, b2z * b3x, -b2y * b3x
    # E = R' R_d, column by column.
    e00 = r00 * b1x + r10 * b1y + r20 * b1z
    e10 = r01 * b1x + r11 * b1y + r21 * b1z
    e20 = r02 * b1x + r12 * b1y + r22 * b1z
    e01 = r10 * b2y + r20 * b2z
    e11 = r11 * b2y + r21 * b2z
    e21 = r12 * b2y + r22 * b2z
    e02 = r00 * b3x + r10 * b3y + r20 * b3z
    e12 = r01 * b3x + r11 * b3y + r21 * b3z
    along = b3x * j_x + b3y * j_y + b3z * j_z
    h_x, h_y, h_z = (j_x - along * b3x) / size, (j_y - along * b3y) / size, (j_z - along * b3z) / size
    p_d = -(h_y * b2y + h_z * b2z)
    q_d = h_x * b1x + h_y * b1y + h_z * b1z
    J, k_R, k_w = vehicle.inertia_kg_m2, vehicle.attitude_gain_s2, vehicle.rate_gain_s
    # vee(R_d' R - R' R_d) = (E12 - E21, E20 - E02, E01 - E10)
    tau_x = J[0] * (-0.5 * k_R[0] * (e12 - e21) - k_w[0] * (omega_x - e00 * p_d - e01 * q_d))
    tau_y = J[1] * (-0.5 * k_R[1] * (e20 - e02) - k_w[1] * (omega_y - e10 * p_d - e11 * q_d))
    tau_z = J[2] * (-0.5 * k_R[2] * (e01 - e10) - k_w[2] * (omega_z - e20 * p_d - e21 * q_d))
    tau_x += (J[2] - J[1]) * omega_y * omega_z
    tau_y += (J[0] - J[2]) * omega_z * omega_x
    tau_z += (J[1] - J[0]) * omega_x * omega_y
    thrust = vehicle.mass_kg * max(0.0, f_x * r02 + f_y * r12 + f_z * r22)
    return thrust, tau_x, tau_y, tau_z


@numba.njit(cache=True, nogil=True)
def rotor_speed_command(vehicle, i_rotor, thrust, tau_x, tau_y, tau_z):
    """Return the speed of one rotor that gives its share of a wrench.

    T_i = row i of M^-1 (T, tau), 0 <= T_i <= c speed_max^2;  speed = sqrt(T_i/c)
    [rad/s] = sqrt([N] / [N s^2])

    Args:
        vehicle: Record of `records.CONSTANTS`; M is its `wrench_from_thrusts`.
        i_rotor: 0 to 3.
        thrust: Collective thrust [N].
        tau_x: Torque about body x [N m].
        tau_y: Torque about body y [N m].
        tau_z: Torque about body z [N m].

    Returns:
        Rotor speed [rad/s], within 0 and its maximum. A wrench beyond reach is cut rotor by rotor.

    Source:
        Mellinger and Kumar 2011, doi:10.1109/ICRA.2011.5980409, equation 2, for rotors anywhere in the plane.
    Held by:
        tests/unit/world/test_control_kernels.py
    """
    row = vehicle.thrusts_from_wrench[i_rotor]
    rotor_thrust = row[0] * thrust + row[1] * tau_x + row[2] * tau_y + row[3] * tau_z
    speed = math.sqrt(max(rotor_thrust, 0.0) / vehicle.thrust_coefficient_n_s2)
    return min(speed, vehicle.max_rotor_speed_rad_s)
