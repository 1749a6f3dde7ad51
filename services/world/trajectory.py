# pyright: basic
"""Minimum-jerk trajectories: polynomials, and the quickest within limits of speed and acceleration.

Arguments of several functions: `coefficients` (3, 6) axis xyz, power 0 to 5, world frame [m/s^i], written by what ends
in `_inplace`; `duration_s` length of the polynomial [s], > 0; `start` (3, 3) rows position [m], velocity [m/s],
acceleration [m/s^2]; columns xyz, world frame; `start_tick` the tick at whose end it starts; `limits` speed and
acceleration kept to.
"""

# ruff: noqa: ANN001, ANN201, ANN202, N806 - kernels have no types, and symbols of equations

import math
from dataclasses import dataclass, field

import numba
import numpy as np
from numpy.typing import NDArray

from gslcosim.base.quantities import Vec3
from gslcosim.base.scalar_kernels import scalar_kernel
from gslcosim.base.ticks import seconds_from_ticks

# Peak speed and acceleration of the rest-to-rest quintic, in units of d/T and d/T^2 (see `rest_to_rest_duration`).
PEAK_SPEED_FACTOR = 15.0 / 8.0
PEAK_ACCELERATION_FACTOR = 10.0 / math.sqrt(3.0)

N_SAMPLES = 32
# Samples of a path for its deviation from the straight line.
_N_DEVIATION_SAMPLES = 10
# Greatest deviation of a path to rest from the straight line: in braking distances, and beyond that [m].
_ALLOWED_BRAKING_DISTANCES = 2.0
_ALLOWED_DEVIATION_M = 0.25

# No polynomial is shorter than a few times the response of an attitude loop: a vehicle could not follow its jerk.
MIN_DURATION_S = 0.2
DURATION_GROWTH = 1.04
_N_DURATIONS = 250
# Slightly more than the limit, so that rounding never rejects a path that a full check accepts.
_ROUNDING_MARGIN = 1.0 + 1e-9
# Compiled functions take positional arguments only: values of the flag of `plan_quickest_inplace`.
_TO_POINT, _TO_VELOCITY = False, True
_ZERO: Vec3 = (0.0, 0.0, 0.0)
# Ticks and durations that differ by less are the same instant.
_TIME_TOLERANCE_S = 1e-9


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
    """Return position [m], velocity [m/s] and acceleration [m/s^2] of a polynomial as rows.

    Args:
        coefficients: (3, 6) axis xyz, power 0 to 5, world frame [m/s^i].
        t_s: Time since the polynomial's start [s].

    Returns:
        (3, 3) rows position, velocity, acceleration; columns xyz, world frame.

    Held by:
        tests/analytic/test_world_trajectory.py
    """
    state = np.empty((3, 3))
    write_polynomial_state_inplace(state, coefficients, t_s)
    return state


@numba.njit(cache=True, nogil=True)
def polynomial_position(coefficients, t_s):
    """Return the first row of `polynomial_state` as three numbers."""
    x, _, _, _ = polynomial_at(coefficients, 0, t_s)
    y, _, _, _ = polynomial_at(coefficients, 1, t_s)
    z, _, _, _ = polynomial_at(coefficients, 2, t_s)
    return x, y, z


@numba.njit(cache=True, nogil=True)
def write_polynomial_state_inplace(state, coefficients, t_s):
    """Write what `polynomial_state` returns into `state` (3, 3)."""
    for axis in range(3):
        state[0, axis], state[1, axis], state[2, axis], _ = polynomial_at(coefficients, axis, t_s)


@numba.njit(cache=True, nogil=True)
def _norm(vector):
    return math.sqrt(vector[0] ** 2 + vector[1] ** 2 + vector[2] ** 2)


@numba.njit(cache=True, nogil=True)
def max_lateral_deviation_m(coefficients, duration_s, place_m):
    """Return the deviation of a path to rest from the straight line to its end [m], from ten samples.

    Args:
        place_m: (3,) where it ends, world frame [m].

    Held by:
        tests/analytic/test_world_trajectory.py
    """
    start_x, start_y, start_z = coefficients[0, 0], coefficients[1, 0], coefficients[2, 0]
    way_x, way_y, way_z = place_m[0] - start_x, place_m[1] - start_y, place_m[2] - start_z
    length2 = max(way_x * way_x + way_y * way_y + way_z * way_z, 1e-12)
    farthest = 0.0
    for k in range(1, _N_DEVIATION_SAMPLES + 1):
        if k == _N_DEVIATION_SAMPLES:
            x, y, z = way_x, way_y, way_z
        else:
            t = duration_s * k / _N_DEVIATION_SAMPLES
            x, y = polynomial_at(coefficients, 0, t)[0] - start_x, polynomial_at(coefficients, 1, t)[0] - start_y
            z = polynomial_at(coefficients, 2, t)[0] - start_z
        along = min(max((x * way_x + y * way_y + z * way_z) / length2, 0.0), 1.0)
        x, y, z = x - along * way_x, y - along * way_y, z - along * way_z
        farthest = max(farthest, math.sqrt(x * x + y * y + z * z))
    return farthest


@numba.njit(cache=True, nogil=True)
def allowed_lateral_deviation_m(speed_m_s, max_acceleration_m_s2):
    """Return the greatest deviation of a path to rest from the straight line [m]: twice the braking distance, and more.

    Args:
        speed_m_s: Speed at its start [m/s].
        max_acceleration_m_s2: Greatest acceleration [m/s^2].

    Held by:
        tests/unit/services/world/test_mission.py
    """
    return _ALLOWED_BRAKING_DISTANCES * 0.75 * speed_m_s**2 / max_acceleration_m_s2 + _ALLOWED_DEVIATION_M


@numba.njit(cache=True, nogil=True)
def deviates_too_far(coefficients, duration_s, place_m, velocity_m_s, max_acceleration_m_s2):
    """Return whether a path to rest leaves the straight line so far that the vehicle had better stop first.

    Args:
        place_m: (3,) where it ends, world frame [m].
        velocity_m_s: (3,) velocity at its start, world frame [m/s].
        max_acceleration_m_s2: Greatest acceleration [m/s^2].

    Held by:
        tests/unit/services/world/test_mission.py
    """
    speed_m_s = _norm(velocity_m_s)
    if speed_m_s == 0.0:
        return False
    allowed_m = allowed_lateral_deviation_m(speed_m_s, max_acceleration_m_s2)
    return max_lateral_deviation_m(coefficients, duration_s, place_m) > allowed_m


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


@numba.njit(cache=True, nogil=True)
def _limit_excess(coefficients, duration_s, speed_limit, acceleration_limit, allowed):
    """Return the greater of a polynomial's peaks in units of its limits; infinity where few samples exceed them.

    Args:
        speed_limit: Greatest speed [m/s].
        acceleration_limit: Greatest acceleration [m/s^2].
        allowed: Excess that is not too great.

    Held by:
        tests/analytic/test_world_trajectory.py
    """
    most_speed2 = (allowed * speed_limit) ** 2 * _ROUNDING_MARGIN
    most_acceleration2 = (allowed * acceleration_limit) ** 2 * _ROUNDING_MARGIN
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
    return x * x + y * y + z * z > most * most * _ROUNDING_MARGIN


@numba.njit(cache=True, nogil=True)
def _set_polynomial(coefficients, start, end, is_velocity, duration_s):
    if is_velocity:
        set_quartic_to_velocity_inplace(coefficients, start, end[1], duration_s)
    else:
        set_quintic_inplace(coefficients, start, end, duration_s)


@numba.njit(cache=True, nogil=True)
def plan_quickest_inplace(coefficients, start, end, is_velocity, max_speed_m_s, max_acceleration_m_s2, least_s, step_s):
    """Write the quickest minimum-jerk polynomial within the limits and return its duration [s].

    From rest to rest and from steady flight to a velocity the duration is in closed form. Otherwise durations grow by
    4 % from a short one until both peaks are within the limits; a start or end that already breaks a limit raises that
    limit to itself, and where no duration is feasible (speed at its limit and still accelerating) the one that breaks
    the limits least is taken. Sampled peaks may lie 2 % above the limits where an end state is passed in motion.

    Args:
        end: (3, 3) the state to reach; of a velocity only its row counts.
        is_velocity: Only the velocity of `end` counts, at any position.
        max_speed_m_s: Greatest speed [m/s], > 0.
        max_acceleration_m_s2: Greatest acceleration [m/s^2], > 0.
        least_s: No shorter than this [s], >= 0.
        step_s: The duration is a whole multiple of this [s]; 0: any duration.

    Returns:
        Duration [s], >= 0.2, or a step where that is given.

    Held by:
        tests/analytic/test_world_trajectory.py, tests/properties/test_world_trajectory_laws.py
    """
    speed, acceleration = max(_norm(start[1]), _norm(end[1])), max(_norm(start[2]), _norm(end[2]))
    row = 1 if is_velocity else 0
    dx, dy, dz = end[row, 0] - start[row, 0], end[row, 1] - start[row, 1], end[row, 2] - start[row, 2]
    change = math.sqrt(dx**2 + dy**2 + dz**2)
    if is_velocity:
        shortest = 1.5 * change / max_acceleration_m_s2
    else:
        shortest = rest_to_rest_duration(change, max_speed_m_s, max_acceleration_m_s2)
    if acceleration == 0.0 and (is_velocity or speed == 0.0):
        duration = _whole_steps(max(MIN_DURATION_S, shortest, least_s), step_s)
        _set_polynomial(coefficients, start, end, is_velocity, duration)
        return duration

    is_passing = not is_velocity and _norm(end[1]) > 0.0
    allowed = 1.02 if is_passing else 1.0 + 1e-9
    speed_limit = max(max_speed_m_s, speed)
    acceleration_limit = max(max_acceleration_m_s2, acceleration)
    # From one velocity to another it may be far quicker than from rest to rest, but not quicker than its way needs.
    quickest = 0.5 * change / speed_limit if is_passing else 0.3 * shortest
    duration = max(MIN_DURATION_S if step_s == 0.0 else step_s, quickest, least_s)
    first_duration = best_duration = duration
    least = np.inf
    # Few samples reject most durations; the least excess over the limits matters only where no duration is feasible.
    for _ in range(_N_DURATIONS):
        duration = _whole_steps(duration, step_s)
        if not (is_velocity and _is_surely_too_short(start, dx, dy, dz, duration, allowed * acceleration_limit)):
            _set_polynomial(coefficients, start, end, is_velocity, duration)
            if _limit_excess(coefficients, duration, speed_limit, acceleration_limit, allowed) <= allowed:
                return duration
        duration = max(duration * DURATION_GROWTH, duration + step_s)
    duration = first_duration
    for _ in range(_N_DURATIONS):
        duration = _whole_steps(duration, step_s)
        _set_polynomial(coefficients, start, end, is_velocity, duration)
        peak_speed, peak_acceleration = peak_speed_and_acceleration(coefficients, duration)
        excess = max(peak_speed / speed_limit, peak_acceleration / acceleration_limit)
        if excess < least:
            least = excess
            best_duration = duration
        duration = max(duration * DURATION_GROWTH, duration + step_s)
    _set_polynomial(coefficients, start, end, is_velocity, best_duration)
    return best_duration


@numba.njit(cache=True, nogil=True)
def _whole_steps(duration_s, step_s):
    if step_s == 0.0:
        return duration_s
    return max(1.0, math.ceil(duration_s / step_s - 1e-6)) * step_s


@scalar_kernel
def is_path_over(elapsed_s: float, duration_s: float) -> bool:
    """Return whether a path of a duration [s] has ended, a time after its start [s]."""
    return elapsed_s >= duration_s - _TIME_TOLERANCE_S


@scalar_kernel
def is_beyond_limit(value: float, limit: float) -> bool:
    """Return whether a value is above a limit by more than rounding."""
    return value > limit * (1 + 1e-9)


@dataclass(frozen=True, kw_only=True)
class Limits:
    """Limits of a trajectory: greatest speed [m/s] and acceleration [m/s^2] of the reference."""

    max_speed_m_s: float
    max_acceleration_m_s2: float


@dataclass(frozen=True, kw_only=True)
class Heading:
    """Heading of a vehicle: along its path, or towards an angle from world x [rad]; neither: unchanged."""

    yaw_rad: float | None = None
    is_along_path: bool = False


UNCHANGED_HEADING = Heading()


@dataclass(frozen=True, kw_only=True)
class Trajectory:
    """A polynomial from the end of `start_tick` on; after `duration_s` it continues with `end_velocity_world_m_s`.

    `coefficients` is (3, 6): axis xyz, power 0 to 5, world frame [m/s^i]. `forgets_integral` clears what the controller
    has learned of steady forces: after pushing against an obstacle that is wrong.
    """

    start_tick: int
    coefficients: NDArray[np.float64] = field(repr=False)
    duration_s: float
    end_world_m: Vec3
    end_velocity_world_m_s: Vec3 = (0.0, 0.0, 0.0)
    end_acceleration_world_m_s2: Vec3 = (0.0, 0.0, 0.0)
    forgets_integral: bool = False
    heading: Heading = UNCHANGED_HEADING

    def position_at(self, tick: int, tick_ns: int) -> Vec3:
        """Return the position of the reference at the end of a tick, world frame [m]."""
        return self._position_after(seconds_from_ticks(tick - self.start_tick, tick_ns))

    def state_at(self, tick: int, tick_ns: int) -> NDArray[np.float64]:
        """Return the reference at the end of a tick as (3, 3): rows position [m], velocity [m/s], acceleration."""
        return self.state_after(seconds_from_ticks(tick - self.start_tick, tick_ns))

    def state_after(self, t_s: float) -> NDArray[np.float64]:
        """Return the reference at a time since the end of the start tick [s]."""
        if is_path_over(t_s, self.duration_s):
            is_at_end = t_s - self.duration_s <= _TIME_TOLERANCE_S
            acceleration = self.end_acceleration_world_m_s2 if is_at_end else _ZERO
            return np.array([self._position_after(t_s), self.end_velocity_world_m_s, acceleration])
        return polynomial_state(self.coefficients, t_s)

    def _position_after(self, t_s: float) -> Vec3:
        if not is_path_over(t_s, self.duration_s):
            return polynomial_position(self.coefficients, t_s)
        beyond_s = max(0.0, t_s - self.duration_s)
        (x, y, z), (u, v, w) = self.end_world_m, self.end_velocity_world_m_s
        return x + beyond_s * u, y + beyond_s * v, z + beyond_s * w

    def is_over(self, tick: int, tick_ns: int) -> bool:
        """Return whether the polynomial has ended at the end of a tick."""
        return is_path_over(seconds_from_ticks(tick - self.start_tick, tick_ns), self.duration_s)


def plan_rest(
    position_world_m: Vec3, start_tick: int, *, duration_s: float = 0.0, forgets_integral: bool = False
) -> Trajectory:
    """Return the trajectory that rests at a point, world frame [m]; it counts as over after a duration [s]."""
    coefficients = np.zeros((3, 6))
    coefficients[:, 0] = position_world_m
    return Trajectory(
        start_tick=start_tick,
        coefficients=coefficients,
        duration_s=duration_s,
        end_world_m=position_world_m,
        forgets_integral=forgets_integral,
    )


def plan_to_point(start: NDArray[np.float64], end_world_m: Vec3, limits: Limits, start_tick: int) -> Trajectory:
    """Return the quickest trajectory that comes to rest at a point.

    Args:
        end_world_m: Place of rest, world frame [m].
    """
    return plan_to_state(start, np.array([end_world_m, _ZERO, _ZERO]), limits, start_tick)


def plan_to_state(
    start: NDArray[np.float64],
    end: NDArray[np.float64],
    limits: Limits,
    start_tick: int,
    *,
    least_s: float = 0.0,
    step_s: float = 0.0,
) -> Trajectory:
    """Return the quickest trajectory that reaches a state of motion and continues with its velocity.

    Args:
        end: (3, 3) the same at the end.
        least_s: It takes at least this long [s].
        step_s: It takes a whole multiple of this [s]; 0: any time.
    """
    coefficients, duration_s = _plan(start, end, limits, is_velocity=_TO_POINT, least_s=least_s, step_s=step_s)
    return Trajectory(
        start_tick=start_tick,
        coefficients=coefficients,
        duration_s=duration_s,
        end_world_m=to_vec3(end[0]),
        end_velocity_world_m_s=to_vec3(end[1]),
        end_acceleration_world_m_s2=to_vec3(end[2]),
    )


def plan_to_velocity(
    start: NDArray[np.float64], velocity_world_m_s: Vec3, limits: Limits, start_tick: int
) -> Trajectory:
    """Return the quickest trajectory that reaches a velocity and continues with it; zero is a stop.

    Args:
        velocity_world_m_s: Velocity to reach, world frame [m/s].
    """
    end = np.array([_ZERO, velocity_world_m_s, _ZERO])
    coefficients, duration_s = _plan(start, end, limits, is_velocity=_TO_VELOCITY)
    return Trajectory(
        start_tick=start_tick,
        coefficients=coefficients,
        duration_s=duration_s,
        end_world_m=to_vec3(polynomial_state(coefficients, duration_s)[0]),
        end_velocity_world_m_s=velocity_world_m_s,
    )


def _plan(
    start: NDArray[np.float64],
    end: NDArray[np.float64],
    limits: Limits,
    *,
    is_velocity: bool,
    least_s: float = 0.0,
    step_s: float = 0.0,
) -> tuple[NDArray[np.float64], float]:
    coefficients = np.empty((3, 6))
    speed, acceleration = limits.max_speed_m_s, limits.max_acceleration_m_s2
    duration_s = plan_quickest_inplace(coefficients, start, end, is_velocity, speed, acceleration, least_s, step_s)
    return coefficients, float(duration_s)


def to_vec3(row: NDArray[np.float64]) -> Vec3:
    """Return a row of three numbers as plain numbers."""
    x, y, z = row.tolist()
    return x, y, z
