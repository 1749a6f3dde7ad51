"""Minimum-jerk polynomials: coefficients, values and peaks."""
# pyright: basic

import math

import numba
import numpy as np

# Peak speed and acceleration of the rest-to-rest quintic, in units of d/T and d/T^2 (see `rest_to_rest_duration`).
PEAK_SPEED_FACTOR = 15.0 / 8.0
PEAK_ACCELERATION_FACTOR = 10.0 / math.sqrt(3.0)

N_SAMPLES = 32
# How often a path is looked at to see how far it leaves the straight line.
_N_LOOKS = 10
# How far a path to rest may leave the straight line: in ways that braking takes, and beyond that [m].
_SWINGS_UP_TO = 2.0
_SWINGS_BY_M = 0.25


@numba.njit(cache=True, nogil=True)
def rest_to_rest_duration(distance_m, max_speed_m_s, max_acceleration_m_s2):
    """Return the shortest duration of a rest-to-rest minimum-jerk leg within the limits.

    T = max(15/8 d / v_max, sqrt(10/sqrt(3) d / a_max))
    [s] = [m] / [m/s] = sqrt([m] / [m/s^2])

    The quintic is x = d (10 s^3 - 15 s^4 + 6 s^5), s = t/T; its speed peaks at s = 1/2, its acceleration at
    s = (1 -+ 1/sqrt(3))/2.

    Args:
        distance_m: Length of the leg [m], >= 0.
        max_speed_m_s: Greatest speed [m/s], > 0.
        max_acceleration_m_s2: Greatest acceleration [m/s^2], > 0.

    Returns:
        Duration [s]; 0 for a leg of no length.

    Source:
        Flash and Hogan 1985, doi:10.1523/JNEUROSCI.05-07-01688.1985 (the quintic); peaks by differentiation.
    Held by:
        tests/analytic/test_world_trajectory.py
    """
    by_speed = PEAK_SPEED_FACTOR * distance_m / max_speed_m_s
    by_acceleration = math.sqrt(PEAK_ACCELERATION_FACTOR * distance_m / max_acceleration_m_s2)
    return max(by_speed, by_acceleration)


@numba.njit(cache=True, nogil=True)
def set_quintic_inplace(coefficients, start, end, duration_s):
    """Write the minimum-jerk polynomial between two states.

    x(t) = c0 + c1 t + … + c5 t^5 with x, v, a given at t = 0 and at t = T
    [m] = [m/s^i] [s]^i

    Args:
        coefficients: (3, 6) written: axis xyz, power 0 to 5, world frame [m/s^i].
        start: (3, 3) rows position [m], velocity [m/s], acceleration [m/s^2]; columns xyz, world frame.
        end: (3, 3) the same at the end.
        duration_s: T [s], > 0.

    Source:
        Mueller, Hehn and D'Andrea 2015, doi:10.1109/TRO.2015.2479878 (fully defined end state), in powers of t.
    Held by:
        tests/analytic/test_world_trajectory.py
    """
    T = duration_s
    for i in range(3):
        h = end[0, i] - start[0, i]
        v, v_end = start[1, i] * T, end[1, i] * T
        a, a_end = start[2, i] * T * T, end[2, i] * T * T
        coefficients[i, 0] = start[0, i]
        coefficients[i, 1] = start[1, i]
        coefficients[i, 2] = 0.5 * start[2, i]
        coefficients[i, 3] = (10.0 * h - 6.0 * v - 4.0 * v_end - 1.5 * a + 0.5 * a_end) / T**3
        coefficients[i, 4] = (-15.0 * h + 8.0 * v + 7.0 * v_end + 1.5 * a - a_end) / T**4
        coefficients[i, 5] = (6.0 * h - 3.0 * v - 3.0 * v_end - 0.5 * a + 0.5 * a_end) / T**5


@numba.njit(cache=True, nogil=True)
def set_quartic_to_velocity_inplace(coefficients, start, end_velocity_world_m_s, duration_s):
    """Write the minimum-jerk polynomial that reaches a velocity, wherever that is.

    v(t) = v0 + a0 t + b t^2 + c t^3,  b = 3 dv/T^2 - 2 a0/T,  c = -2 dv/T^3 + a0/T^2,  dv = v_end - v0
    [m/s] = [m/s^(i+1)] [s]^i

    It ends with v = v_end and no acceleration; the way to there is T (v0 + v_end)/2 + T^2 a0/12, and for a0 = 0 the
    acceleration peaks at 1.5 dv/T.

    Args:
        coefficients: (3, 6) written: axis xyz, power 0 to 5, world frame [m/s^i].
        start: (3, 3) rows position [m], velocity [m/s], acceleration [m/s^2]; columns xyz, world frame.
        end_velocity_world_m_s: (3,) velocity at the end, world frame [m/s].
        duration_s: T [s], > 0.

    Source:
        Mueller, Hehn and D'Andrea 2015, doi:10.1109/TRO.2015.2479878 (free end position).
    Held by:
        tests/analytic/test_world_trajectory.py
    """
    T = duration_s
    for i in range(3):
        dv = end_velocity_world_m_s[i] - start[1, i]
        a0 = start[2, i]
        coefficients[i, 0] = start[0, i]
        coefficients[i, 1] = start[1, i]
        coefficients[i, 2] = 0.5 * a0
        coefficients[i, 3] = (3.0 * dv / T - 2.0 * a0) / (3.0 * T)
        coefficients[i, 4] = (-2.0 * dv / T + a0) / (4.0 * T * T)
        coefficients[i, 5] = 0.0


@numba.njit(cache=True, nogil=True, inline="always")
def polynomial_at(coefficients, axis, t_s):
    """Return position, velocity, acceleration and jerk of one axis of a polynomial (Horner's scheme).

    Args:
        coefficients: (…, 3, 6) axis xyz, power 0 to 5 [m/s^i].
        axis: 0, 1 or 2.
        t_s: Time since the polynomial's start [s].

    Returns:
        ([m], [m/s], [m/s^2], [m/s^3]).

    Held by:
        tests/analytic/test_world_trajectory.py
    """
    c0 = coefficients[axis, 0]
    c1 = coefficients[axis, 1]
    c2 = coefficients[axis, 2]
    c3 = coefficients[axis, 3]
    c4 = coefficients[axis, 4]
    c5 = coefficients[axis, 5]
    t = t_s
    position = c0 + t * (c1 + t * (c2 + t * (c3 + t * (c4 + t * c5))))
    velocity = c1 + t * (2.0 * c2 + t * (3.0 * c3 + t * (4.0 * c4 + t * 5.0 * c5)))
    acceleration = 2.0 * c2 + t * (6.0 * c3 + t * (12.0 * c4 + t * 20.0 * c5))
    jerk = 6.0 * c3 + t * (24.0 * c4 + t * 60.0 * c5)
    return position, velocity, acceleration, jerk


@numba.njit(cache=True, nogil=True)
def polynomial_state(coefficients, t_s):
    """Return position [m], velocity [m/s] and acceleration [m/s^2] of a polynomial as rows; see `polynomial_at`.

    Args:
        coefficients: (3, 6) axis xyz, power 0 to 5, world frame [m/s^i].
        t_s: Time since the polynomial's start [s].

    Returns:
        (3, 3) rows position, velocity, acceleration; columns xyz, world frame.

    Held by:
        tests/analytic/test_world_trajectory.py
    """
    state = np.empty((3, 3))
    for axis in range(3):
        state[0, axis], state[1, axis], state[2, axis], _ = polynomial_at(coefficients, axis, t_s)
    return state


@numba.njit(cache=True, nogil=True)
def farthest_aside_m(coefficients, duration_s, place_m):
    """Return how far a path to rest leaves the straight line to its end [m], from ten looks at it.

    Args:
        coefficients: (3, 6) axis xyz, power 0 to 5 [m/s^i].
        duration_s: Length of the polynomial [s], > 0.
        place_m: (3,) where it ends, world frame [m].

    Held by:
        tests/analytic/test_world_trajectory.py
    """
    start_x, start_y, start_z = coefficients[0, 0], coefficients[1, 0], coefficients[2, 0]
    way_x, way_y, way_z = place_m[0] - start_x, place_m[1] - start_y, place_m[2] - start_z
    length2 = max(way_x * way_x + way_y * way_y + way_z * way_z, 1e-12)
    farthest = 0.0
    for k in range(1, _N_LOOKS + 1):
        if k == _N_LOOKS:
            x, y, z = way_x, way_y, way_z
        else:
            t = duration_s * k / _N_LOOKS
            x, y = polynomial_at(coefficients, 0, t)[0] - start_x, polynomial_at(coefficients, 1, t)[0] - start_y
            z = polynomial_at(coefficients, 2, t)[0] - start_z
        along = min(max((x * way_x + y * way_y + z * way_z) / length2, 0.0), 1.0)
        x, y, z = x - along * way_x, y - along * way_y, z - along * way_z
        farthest = max(farthest, math.sqrt(x * x + y * y + z * z))
    return farthest


@numba.njit(cache=True, nogil=True)
def allowed_aside_m(speed_m_s, max_acceleration_m_s2):
    """Return how far a path to rest may leave the straight line [m]: twice the way that braking takes, and more.

    Args:
        speed_m_s: Speed at its start [m/s].
        max_acceleration_m_s2: Greatest acceleration [m/s^2].

    Held by:
        tests/unit/world/guidance/test_mission.py
    """
    return _SWINGS_UP_TO * 0.75 * speed_m_s**2 / max_acceleration_m_s2 + _SWINGS_BY_M


@numba.njit(cache=True, nogil=True)
def speed2_and_acceleration2_at(coefficients, t):
    """Return the squares of speed [m^2/s^2] and acceleration [m^2/s^4] of a polynomial (3, 6) at t [s].

    Held by:
        tests/analytic/test_world_trajectory.py
    """
    speed2 = 0.0
    acceleration2 = 0.0
    for i in range(3):
        _, v, a, _ = polynomial_at(coefficients, i, t)
        speed2 += v * v
        acceleration2 += a * a
    return speed2, acceleration2


@numba.njit(cache=True, nogil=True)
def peak_speed_and_acceleration(coefficients, duration_s):
    """Return the greatest speed [m/s] and acceleration [m/s^2] of a polynomial, from 33 equally spaced instants.

    The true peaks of the rest-to-rest quintic lie above the sampled ones by less than 0.5 %.

    Args:
        coefficients: (3, 6) axis xyz, power 0 to 5 [m/s^i].
        duration_s: Length of the polynomial [s], > 0.

    Held by:
        tests/analytic/test_world_trajectory.py
    """
    peak_speed = 0.0
    peak_acceleration = 0.0
    for k in range(N_SAMPLES + 1):
        speed2, acceleration2 = speed2_and_acceleration2_at(coefficients, duration_s * k / N_SAMPLES)
        peak_speed = max(peak_speed, speed2)
        peak_acceleration = max(peak_acceleration, acceleration2)
    return math.sqrt(peak_speed), math.sqrt(peak_acceleration)
