"""The quickest minimum-jerk polynomial within limits of speed and acceleration."""
# pyright: basic

import math

import numba
import numpy as np

from gslcosim.world.paths.trajectory_kernels import (
    N_SAMPLES,
    peak_speed_and_acceleration,
    rest_to_rest_duration,
    set_quartic_to_velocity_inplace,
    set_quintic_inplace,
    speed2_and_acceleration2_at,
)

# No polynomial is shorter than a few times the response of an attitude loop: a vehicle could not follow its jerk.
SHORTEST_S = 0.2
GROWTH = 1.04
_N_DURATIONS = 250
# A hair more than what is allowed, so that rounding never rules out what a look at the whole path would not.
_HAIR = 1.0 + 1e-9


@numba.njit(cache=True, nogil=True)
def _excess_of(coefficients, duration_s, speed_limit, acceleration_limit, allowed):
    """Return the greater of a polynomial's peaks in units of its limits; infinity where few looks show it too great.

    Args:
        coefficients: (3, 6) axis xyz, power 0 to 5 [m/s^i].
        duration_s: Length of the polynomial [s], > 0.
        speed_limit: Greatest speed [m/s].
        acceleration_limit: Greatest acceleration [m/s^2].
        allowed: Excess that is not too great.

    Held by:
        tests/analytic/test_world_trajectory.py
    """
    most_speed2 = (allowed * speed_limit) ** 2 * _HAIR
    most_acceleration2 = (allowed * acceleration_limit) ** 2 * _HAIR
    for k in (N_SAMPLES // 2, N_SAMPLES // 4, 3 * N_SAMPLES // 4):
        speed2, acceleration2 = speed2_and_acceleration2_at(coefficients, duration_s * k / N_SAMPLES)
        if speed2 > most_speed2 or acceleration2 > most_acceleration2:
            return np.inf
    peak_speed, peak_acceleration = peak_speed_and_acceleration(coefficients, duration_s)
    return max(peak_speed / speed_limit, peak_acceleration / acceleration_limit)


# Halfway to a velocity the acceleration is 1.5 dv/T - a0/4.
@numba.njit(cache=True, nogil=True)
def _is_surely_too_short(start, dv_x, dv_y, dv_z, duration_s, most):
    per_s = 1.5 / duration_s
    x = per_s * dv_x - 0.25 * start[2, 0]
    y = per_s * dv_y - 0.25 * start[2, 1]
    z = per_s * dv_z - 0.25 * start[2, 2]
    return x * x + y * y + z * z > most * most * _HAIR


@numba.njit(cache=True, nogil=True)
def _set_polynomial(coefficients, start, end, is_velocity, duration_s):
    if is_velocity:
        set_quartic_to_velocity_inplace(coefficients, start, end[1], duration_s)
    else:
        set_quintic_inplace(coefficients, start, end, duration_s)


@numba.njit(cache=True, nogil=True)
def _size(vector):
    return math.sqrt(vector[0] ** 2 + vector[1] ** 2 + vector[2] ** 2)


@numba.njit(cache=True, nogil=True)
def plan_inplace(coefficients, start, end, is_velocity, max_speed_m_s, max_acceleration_m_s2, least_s, step_s):
    """Write the quickest minimum-jerk polynomial within the limits and return its duration [s].

    From rest to rest and from steady flight to a velocity the duration is in closed form. Otherwise durations grow by
    4 % from a short one until both peaks are within the limits; a start or end that already breaks a limit raises that
    limit to itself, and where no duration is feasible (speed at its limit and still accelerating) the one that breaks
    the limits least is taken. Sampled peaks may lie 2 % above the limits where an end state is flown through.

    Args:
        coefficients: (3, 6) written: axis xyz, power 0 to 5, world frame [m/s^i].
        start: (3, 3) rows position [m], velocity [m/s], acceleration [m/s^2]; columns xyz, world frame.
        end: (3, 3) the state to reach; of a velocity only its row counts.
        is_velocity: Whether only the velocity of `end` is to be reached, wherever that is.
        max_speed_m_s: Greatest speed [m/s], > 0.
        max_acceleration_m_s2: Greatest acceleration [m/s^2], > 0.
        least_s: No shorter than this [s], >= 0.
        step_s: The duration is a whole multiple of this [s]; 0: any duration.

    Returns:
        Duration [s], >= 0.2, or a step where that is given.

    Held by:
        tests/analytic/test_world_trajectory.py, tests/properties/test_world_trajectory_laws.py
    """
    speed, acceleration = max(_size(start[1]), _size(end[1])), max(_size(start[2]), _size(end[2]))
    row = 1 if is_velocity else 0
    dx, dy, dz = end[row, 0] - start[row, 0], end[row, 1] - start[row, 1], end[row, 2] - start[row, 2]
    change = math.sqrt(dx**2 + dy**2 + dz**2)
    if is_velocity:
        shortest = 1.5 * change / max_acceleration_m_s2
    else:
        shortest = rest_to_rest_duration(change, max_speed_m_s, max_acceleration_m_s2)
    if acceleration == 0.0 and (is_velocity or speed == 0.0):
        duration = _whole_steps(max(SHORTEST_S, shortest, least_s), step_s)
        _set_polynomial(coefficients, start, end, is_velocity, duration)
        return duration

    is_passing = not is_velocity and _size(end[1]) > 0.0
    allowed = 1.02 if is_passing else 1.0 + 1e-9
    speed_limit = max(max_speed_m_s, speed)
    acceleration_limit = max(max_acceleration_m_s2, acceleration)
    # From one velocity to another it may be far quicker than from rest to rest, but not quicker than its way needs.
    quickest = 0.5 * change / speed_limit if is_passing else 0.3 * shortest
    duration = max(SHORTEST_S if step_s == 0.0 else step_s, quickest, least_s)
    first_duration = best_duration = duration
    least = np.inf
    # Most durations are seen to be too short at once; what breaks the limits least matters only where none is feasible.
    for _ in range(_N_DURATIONS):
        duration = _whole_steps(duration, step_s)
        if not (is_velocity and _is_surely_too_short(start, dx, dy, dz, duration, allowed * acceleration_limit)):
            _set_polynomial(coefficients, start, end, is_velocity, duration)
            if _excess_of(coefficients, duration, speed_limit, acceleration_limit, allowed) <= allowed:
                return duration
        duration = max(duration * GROWTH, duration + step_s)
    duration = first_duration
    for _ in range(_N_DURATIONS):
        duration = _whole_steps(duration, step_s)
        _set_polynomial(coefficients, start, end, is_velocity, duration)
        peak_speed, peak_acceleration = peak_speed_and_acceleration(coefficients, duration)
        excess = max(peak_speed / speed_limit, peak_acceleration / acceleration_limit)
        if excess < least:
            least = excess
            best_duration = duration
        duration = max(duration * GROWTH, duration + step_s)
    _set_polynomial(coefficients, start, end, is_velocity, best_duration)
    return best_duration


@numba.njit(cache=True, nogil=True)
def _whole_steps(duration_s, step_s):
    if step_s == 0.0:
        return duration_s
    return max(1.0, math.ceil(duration_s / step_s - 1e-6)) * step_s
