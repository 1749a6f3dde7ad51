# pyright: basic
# ruff: noqa: ANN001, ANN201, N803, N806 - kernels have no types, and symbols of equations
"""Control of a multirotor: position, attitude and the mixing of its rotors, whose lag, thrust and drag it has.

Symbols: p, v position and velocity in the world frame W; R turns body-frame vectors into world-frame vectors;
omega is the angular velocity in the body frame B; `_d` is desired.

Arguments of several functions: `vehicle` a record of `vehicle_records.CONSTANTS`; `R` nine numbers, rows of the matrix
that turns body-frame into world-frame vectors.
"""

import math
from typing import Any

import numba

from gslcosim.base import elementary
from gslcosim.contract.participant import Inbox
from gslcosim.scenario import Scenario
from gslcosim.scenario.models.events import RotorWeakensSpec
from gslcosim.scenario.models.scenario import find_due_events
from gslcosim_services.world.trajectory import polynomial_at

# Source of a vehicle's reference: a path, or the agent's setpoint.
PATH = 0
ATTITUDE = 1
RATES = 2
DRIVE = 3
# Bounds of the vertical specific force, in units of gravity: the vehicle never pushes downwards.
_MIN_LIFT = 0.3
_MAX_LIFT = 1.7
_HEADING_GAIN_S = 3.0
_MIN_PATH_SPEED_M_S = 0.05
_HEADING_TOLERANCE_RAD = 1e-6


@numba.njit(cache=True, nogil=True)
def lagged_rotor_speed(vehicle, speed, command):
    """Return a rotor's speed one sub-step later: first-order lag, slower down than up.

    speed += (1 - exp(-dt/tau)) (command - speed)
    [rad/s]; the fraction is dimensionless and exact for a command held over dt

    Args:
        vehicle: Record of `records.CONSTANTS`; holds the two fractions.
        speed: Rotor speed [rad/s], >= 0.
        command: Commanded speed [rad/s], >= 0.

    Source:
        Furrer, Burri, Achtelik and Siegwart 2016 (RotorS), doi:10.1007/978-3-319-26054-9_23.
    Held by:
        tests/unit/services/world/test_rotors.py
    """
    response = vehicle.response_up if command > speed else vehicle.response_down
    return speed + response * (command - speed)


@numba.njit(cache=True, nogil=True)
def rotor_wrench(vehicle, rotor_speed_rad_s):
    """Return thrust, torques about the body axes, and the sum of the rotors' speeds.

    (T, tau) = M (c speed_i^2)
    [N], [N m] = [1], [m] times [N s^2] [rad/s]^2

    Args:
        vehicle: Record of `records.CONSTANTS`; M is its `wrench_from_thrusts`.
        rotor_speed_rad_s: (n_rotors or more,) rotor speeds [rad/s].

    Returns:
        (thrust [N], torque x, y, z [N m], sum of speeds [rad/s]).

    Source:
        Mellinger and Kumar 2011, doi:10.1109/ICRA.2011.5980409, equation 2. Thrust does not depend on air speed; blade
        flapping, gyroscopic torque of the rotors, ground effect and downwash are left out.
    Held by:
        tests/unit/services/world/test_rotors.py
    """
    M = vehicle.wrench_from_thrusts
    thrust = tau_x = tau_y = tau_z = total = 0.0
    for i in range(vehicle.n_rotors):
        speed = rotor_speed_rad_s[i]
        T = vehicle.thrust_coefficient_n_s2 * speed * speed
        thrust += M[0, i] * T
        tau_x += M[1, i] * T
        tau_y += M[2, i] * T
        tau_z += M[3, i] * T
        total += speed
    return thrust, tau_x, tau_y, tau_z, total


@numba.njit(cache=True, nogil=True)
def drag_force(vehicle, total_speed, u, v, w):
    """Return the drag of rotors and hull in a relative wind, body frame.

    F_i = c_i sum(speed) u_i + 1/2 rho A_i |u| u_i          u air velocity minus body velocity
    [N] = [N s^2/m] [rad/s] [m/s] = [kg/m^3] [m^2] [m/s]^2

    Args:
        total_speed: Sum of the rotors' speeds [rad/s].
        u, v, w: Relative wind along body x, y, z [m/s].

    Returns:
        (F_x, F_y, F_z) body frame [N], at the centre of mass.

    Source:
        Rotor drag linear in speed: Furrer et al. 2016 (RotorS), doi:10.1007/978-3-319-26054-9_23; hull drag by the
        drag area per axis.
    Deviation:
        The rotors' drag acts at the centre of mass, not at the hubs, so that it makes no torque.
    Held by:
        tests/unit/services/world/test_rotors.py, tests/analytic/test_world_flight.py (terminal speed)
    """
    speed = math.sqrt(u * u + v * v + w * w)
    c, q = vehicle.rotor_drag_n_s2_m, vehicle.half_density_drag_area_kg_m
    return (
        (c[0] * total_speed + q[0] * speed) * u,
        (c[1] * total_speed + q[1] * speed) * v,
        (c[2] * total_speed + q[2] * speed) * w,
    )


class RotorFaults:
    """Rotor faults: events weaken rotors in the records of `CONSTANTS` of all vehicles, in place.

    A rotor of effectiveness s gives s k w^2 at a speed w, and its torques likewise; the allocation of thrusts stays
    as it was, because the control does not measure the loss.
    """

    def __init__(self, scenario: Scenario, constants: Any) -> None:
        """Prepare for the events of a scenario.

        Args:
            scenario: Its agents, in the order of the records.
            constants: The records, of sound vehicles.
        """
        self._scenario = scenario
        self._constants = constants
        self._sound = constants["wrench_from_thrusts"].copy()
        self._number = {agent.name: k for k, agent in enumerate(scenario.agents)}

    def reset(self) -> None:
        """Restore all rotors."""
        self._constants["wrench_from_thrusts"] = self._sound

    def obey(self, inbox: Inbox) -> None:
        """Do what takes effect in this tick."""
        for _, event in find_due_events(self._scenario, inbox):
            if isinstance(event, RotorWeakensSpec):
                k, i = self._number[event.agent], event.rotor
                self._constants["wrench_from_thrusts"][k, :, i] = event.share * self._sound[k, :, i]


@numba.njit(cache=True, nogil=True)
def reference_at(state, axis, t_s):
    """Return position, velocity, acceleration and jerk of one axis of a vehicle's reference.

    Args:
        state: Record of `records.STATE`.
        axis: 0, 1 or 2; world frame.
        t_s: Time since the end of the trajectory's start tick [s].

    Returns:
        ([m], [m/s], [m/s^2], [m/s^3]); after the polynomial's end steady motion with its end velocity.

    Held by:
        tests/unit/services/world/test_multirotor_control.py
    """
    if t_s < state.duration_s:
        return polynomial_at(state.coefficients, axis, t_s)
    velocity = state.end_velocity_world_m_s[axis]
    return state.end_world_m[axis] + velocity * (t_s - state.duration_s), velocity, 0.0, 0.0


@numba.njit(cache=True, nogil=True, inline="always")
def rotation_from_quaternion(w, x, y, z):
    """Return the rotation matrix of a unit quaternion, row by row: world-frame from body-frame vectors.

    Held by:
        tests/unit/services/world/test_multirotor_control.py (against gslcosim.base.frames)
    """
    return (
        1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y),
        2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x),
        2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y),
    )  # fmt: skip


@numba.njit(cache=True, nogil=True)
def axis_acceleration_inplace(vehicle, state, axis, p, v, t_s, dt_s):
    """Return the desired acceleration along one world axis, before gravity, and the reference's jerk.

    a_d = a_ref + k_p e_p + k_v e_v + i + k_drag v_ref,  di/dt = k_i e_p (clamped),  e = reference - state
    [m/s^2] = [1/s^2] [m] = [1/s] [m/s];  i in [m/s^2]

    k_drag v_ref is the rotor drag expected in still air on the horizontal axes.

    Args:
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
        tests/unit/services/world/test_multirotor_control.py, tests/analytic/test_world_flight.py
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
    """Return the desired specific force of the rotors: gravity added, lift and tilt kept within bounds.

    f = a + g z_W;  0.3 g <= f_z <= 1.7 g;  |f_xy| <= tan(tilt_max) f_z
    [m/s^2]

    Args:
        a_x, a_y, a_z: Desired acceleration, world frame [m/s^2].

    Returns:
        (f_x, f_y, f_z) world frame [m/s^2]; its direction is always defined.

    Source:
        Our bounds; they keep the desired attitude of Lee et al. 2010 defined, which needs f != 0.
    Held by:
        tests/unit/services/world/test_multirotor_control.py
    """
    g = vehicle.gravity_m_s2
    f_z = min(max(a_z + g, _MIN_LIFT * g), _MAX_LIFT * g)
    horizontal = math.sqrt(a_x * a_x + a_y * a_y)
    most = vehicle.max_tilt_tangent * f_z
    scale = most / horizontal if horizontal > most else 1.0
    return scale * a_x, scale * a_y, f_z


@numba.njit(cache=True, nogil=True)
def advance_heading_inplace(vehicle, state, v_x, v_y, dt_s):
    """Advance the reference of the heading by one sub-step: to the desired angle, or to that of the path.

    e = wrap(psi_wanted - psi);  psi += rate dt;  rate goes to clamp(k e, +- rate_max) by at most k rate_max dt
    [rad/s] = [1/s] [rad]

    Args:
        state: Record of `records.STATE`; its heading is advanced by dt_s.
        v_x, v_y: Velocity of the reference, world frame [m/s]; slower than 0.05 m/s the path has no direction.
        dt_s: Length of a sub-step [s].

    Source:
        Our choice; the limits keep the weak yaw torque of rotors within reach.
    Held by:
        tests/unit/services/world/test_heading.py
    """
    if state.faces_path and v_x * v_x + v_y * v_y > _MIN_PATH_SPEED_M_S**2:
        state.wanted_yaw_rad = elementary.atan2(v_y, v_x)
    error = state.wanted_yaw_rad - state.yaw_rad
    if error == 0.0 and state.yaw_rate_rad_s == 0.0:
        return
    error = wrap_angle(error)
    most, rate = vehicle.max_yaw_rate_rad_s, state.yaw_rate_rad_s
    step = _HEADING_GAIN_S * most * dt_s
    rate += min(max(min(max(_HEADING_GAIN_S * error, -most), most) - rate, -step), step)
    state.yaw_rate_rad_s = rate
    state.yaw_rad = wrap_angle(state.yaw_rad + rate * dt_s)
    if abs(error) < _HEADING_TOLERANCE_RAD and abs(rate) < _HEADING_TOLERANCE_RAD:
        state.wanted_yaw_rad = wrap_angle(state.wanted_yaw_rad)
        state.yaw_rad = state.wanted_yaw_rad
        state.yaw_rate_rad_s = 0.0


@numba.njit(cache=True, nogil=True)
def align_heading_reference_inplace(state, R):
    """Set the heading reference to the vehicle's true heading, for a path that follows later.

    Args:
        state: Record of `records.STATE`; its heading is written.

    Held by:
        tests/unit/services/world/test_setpoints.py
    """
    state.yaw_rad = elementary.atan2(R[3], R[0])
    state.wanted_yaw_rad = state.yaw_rad
    state.yaw_rate_rad_s = 0.0


@numba.njit(cache=True, nogil=True)
def wrap_angle(angle):
    """Return an angle [rad] within -pi to pi.

    Held by:
        tests/unit/services/world/test_heading.py
    """
    return angle - 2.0 * math.pi * math.floor((angle + math.pi) / (2.0 * math.pi))


@numba.njit(cache=True, nogil=True)
def attitude_from_force(f_x, f_y, f_z, j_x, j_y, j_z, yaw, yaw_rate):
    """Return the attitude whose thrust axis is along a force and whose nose is above a heading, and its rates.

    b3 = f/|f|, b2 = b3 x c/|b3 x c|, b1 = b2 x b3, R_d = [b1 b2 b3],  c = (cos yaw, sin yaw, 0)
    h = (j - (b3 . j) b3)/|f|, omega_d = (-h . b2, h . b1, yaw_rate b3_z)
    [rad/s] = [m/s^3] / [m/s^2]

    Args:
        f_x: Desired specific force, world frame [m/s^2], f_z > 0.
        f_y, f_z: Desired specific force, world frame [m/s^2].
        j_x, j_y, j_z: Jerk of the reference, world frame [m/s^3].
        yaw: Heading, counter-clockwise from world x [rad].
        yaw_rate: Its rate [rad/s].

    Returns:
        (nine numbers, rows of R_d), (three rates about the desired body axes [rad/s]).

    Source:
        Mellinger and Kumar 2011, doi:10.1109/ICRA.2011.5980409, section III.
    Held by:
        tests/unit/services/world/test_multirotor_control.py
    """
    size = math.sqrt(f_x * f_x + f_y * f_y + f_z * f_z)
    b3x, b3y, b3z = f_x / size, f_y / size, f_z / size
    c, s = elementary.cos(yaw), elementary.sin(yaw)
    # b3 x c, never zero because f_z > 0.
    b2x, b2y, b2z = -b3z * s, b3z * c, b3x * s - b3y * c
    n = math.sqrt(b2x * b2x + b2y * b2y + b2z * b2z)
    b2x, b2y, b2z = b2x / n, b2y / n, b2z / n
    b1x, b1y, b1z = b2y * b3z - b2z * b3y, b2z * b3x - b2x * b3z, b2x * b3y - b2y * b3x
    along = b3x * j_x + b3y * j_y + b3z * j_z
    h_x, h_y, h_z = (j_x - along * b3x) / size, (j_y - along * b3y) / size, (j_z - along * b3z) / size
    rates = (
        -(h_x * b2x + h_y * b2y + h_z * b2z),
        h_x * b1x + h_y * b1y + h_z * b1z,
        yaw_rate * b3z,
    )
    return (b1x, b2x, b3x, b1y, b2y, b3y, b1z, b2z, b3z), rates


@numba.njit(cache=True, nogil=True)
def attitude_from_angles(roll, pitch, yaw):
    """Return the rows of R = R_z(yaw) R_y(pitch) R_x(roll), angles in [rad].

    Held by:
        tests/unit/services/world/test_multirotor_control.py
    """
    cr, sr = elementary.cos(roll), elementary.sin(roll)
    cp, sp = elementary.cos(pitch), elementary.sin(pitch)
    cy, sy = elementary.cos(yaw), elementary.sin(yaw)
    return (
        cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr,
        sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr,
        -sp, cp * sr, cp * cr,
    )  # fmt: skip


@numba.njit(cache=True, nogil=True)
def attitude_torque(vehicle, R, omega_x, omega_y, omega_z, R_d, omega_d):
    """Return the body torque that turns a vehicle to an attitude and its rates.

    e_R = 1/2 vee(R_d' R - R' R_d), e_omega = omega - R' R_d omega_d
    tau = J (-k_R e_R - k_omega e_omega) + omega x J omega
    [N m] = [kg m^2] [1/s^2]

    Args:
        omega_x, omega_y, omega_z: Angular velocity, body frame [rad/s].
        R_d: The same nine numbers of the desired attitude.
        omega_d: Three rates about the axes of R_d [rad/s].

    Returns:
        Torque about body x, y, z [N m].

    Source:
        Lee, Leok and McClamroch 2010, doi:10.1109/CDC.2010.5717652, equations 10, 11, 16.
    Deviation:
        Gains per unit of inertia; the desired angular acceleration is left out.
    Held by:
        tests/unit/services/world/test_multirotor_control.py
    """
    r00, r01, r02, r10, r11, r12, r20, r21, r22 = R
    d00, d01, d02, d10, d11, d12, d20, d21, d22 = R_d
    # E = R' R_d.
    e00 = r00 * d00 + r10 * d10 + r20 * d20
    e10 = r01 * d00 + r11 * d10 + r21 * d20
    e20 = r02 * d00 + r12 * d10 + r22 * d20
    e01 = r00 * d01 + r10 * d11 + r20 * d21
    e11 = r01 * d01 + r11 * d11 + r21 * d21
    e21 = r02 * d01 + r12 * d11 + r22 * d21
    e02 = r00 * d02 + r10 * d12 + r20 * d22
    e12 = r01 * d02 + r11 * d12 + r21 * d22
    e22 = r02 * d02 + r12 * d12 + r22 * d22
    p_d, q_d, s_d = omega_d
    k_R = vehicle.attitude_gain_s2
    # vee(R_d' R - R' R_d) = (E12 - E21, E20 - E02, E01 - E10)
    return rate_torque(
        vehicle, omega_x, omega_y, omega_z,
        e00 * p_d + e01 * q_d + e02 * s_d, e10 * p_d + e11 * q_d + e12 * s_d, e20 * p_d + e21 * q_d + e22 * s_d,
        -0.5 * k_R[0] * (e12 - e21), -0.5 * k_R[1] * (e20 - e02), -0.5 * k_R[2] * (e01 - e10),
    )  # fmt: skip


@numba.njit(cache=True, nogil=True)
def rate_torque(vehicle, omega_x, omega_y, omega_z, p_d, q_d, s_d, a_x, a_y, a_z):
    """Return the body torque that turns a vehicle at desired rates, with angular accelerations besides.

    tau = J (a - k_omega (omega - omega_d)) + omega x J omega
    [N m] = [kg m^2] [1/s^2]

    Args:
        omega_x, omega_y, omega_z: Angular velocity, body frame [rad/s].
        p_d, q_d, s_d: Desired rate about body x, y, z [rad/s].
        a_x, a_y, a_z: Angular acceleration about body x, y, z [rad/s^2].

    Returns:
        Torque about body x, y, z [N m].

    Source:
        Lee, Leok and McClamroch 2010, doi:10.1109/CDC.2010.5717652, equation 16 without its attitude term.
    Held by:
        tests/unit/services/world/test_multirotor_control.py
    """
    J, k_w = vehicle.inertia_kg_m2, vehicle.rate_gain_s
    return (
        J[0] * (a_x - k_w[0] * (omega_x - p_d)) + (J[2] - J[1]) * omega_y * omega_z,
        J[1] * (a_y - k_w[1] * (omega_y - q_d)) + (J[0] - J[2]) * omega_z * omega_x,
        J[2] * (a_z - k_w[2] * (omega_z - s_d)) + (J[1] - J[0]) * omega_x * omega_y,
    )


@numba.njit(cache=True, nogil=True)
def thrust_along(vehicle, R, f_x, f_y, f_z):
    """Return the collective thrust whose part along a desired specific force [m/s^2] is that force: T = m f . R e3 [N].

    Source:
        Lee, Leok and McClamroch 2010, doi:10.1109/CDC.2010.5717652, equation 15.
    Held by:
        tests/unit/services/world/test_multirotor_control.py
    """
    return vehicle.mass_kg * max(0.0, f_x * R[2] + f_y * R[5] + f_z * R[8])


@numba.njit(cache=True, nogil=True)
def thrust_from_setpoint(vehicle, state, R, v_z):
    """Return the thrust of an attitude or rate setpoint: its own, or as much as keeps its vertical speed.

    T = m (g + k_v (climb - v_z))/max(R_zz, 0.3), the bracket within 0.3 g and 1.7 g
    [N] = [kg] [m/s^2]

    Args:
        state: Record of `records.STATE`; a thrust below 0 means that the vertical speed is to be kept.
        v_z: Vertical speed [m/s].

    Source:
        Our choice: the vertical axis of the position controller without its position term.
    Held by:
        tests/unit/services/world/test_setpoints.py
    """
    if state.thrust_n >= 0.0:
        return state.thrust_n
    wanted = vehicle.velocity_gain_s * (state.climb_m_s - v_z)
    _, _, f_z = limited_specific_force(vehicle, 0.0, 0.0, wanted)
    return vehicle.mass_kg * f_z / max(R[8], _MIN_LIFT)


@numba.njit(cache=True, nogil=True)
def rotor_speed_command(vehicle, i_rotor, thrust, tau_x, tau_y, tau_z):
    """Return the speed of one rotor for its part of a wrench.

    T_i = row i of M^+ (T, tau), 0 <= T_i <= c speed_max^2;  speed = sqrt(T_i/c)
    [rad/s] = sqrt([N] / [N s^2])

    Args:
        vehicle: Record of `records.CONSTANTS`; M^+ is its `thrusts_from_wrench`.
        i_rotor: 0 to n_rotors - 1.
        thrust: Collective thrust [N].
        tau_x, tau_y, tau_z: Torque about body x, y, z [N m].

    Returns:
        Rotor speed [rad/s], within 0 and its maximum. A wrench beyond reach is cut rotor by rotor.

    Source:
        Mellinger and Kumar 2011, doi:10.1109/ICRA.2011.5980409, equation 2, for any number of rotors
        anywhere in the plane: M^+ is the inverse of M for four, and its pseudo-inverse for more.
    Held by:
        tests/unit/services/world/test_multirotor_control.py
    """
    row = vehicle.thrusts_from_wrench[i_rotor]
    rotor_thrust = row[0] * thrust + row[1] * tau_x + row[2] * tau_y + row[3] * tau_z
    speed = math.sqrt(max(rotor_thrust, 0.0) / vehicle.thrust_coefficient_n_s2)
    return min(speed, vehicle.max_rotor_speed_rad_s)
