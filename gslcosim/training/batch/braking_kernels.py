"""Paths of a search, and whether one that keeps a velocity must brake now; see `gslcosim.world.guidance.edges`."""
# pyright: basic, reportCallIssue=false

import math

from gslcosim.training.batch.reference_free_kernels import reference_free_njit
from gslcosim.training.batch.space_kernels import array_at, is_edge_ahead, is_open_ahead
from gslcosim.world.paths.quickest_kernels import GROWTH, SHORTEST_S, plan_inplace
from gslcosim.world.paths.trajectory_kernels import polynomial_at
from gslcosim.world.physics.records import STATE

# See `gslcosim.world.paths.trajectory`.
SAME_S = 1e-9
_NS_PER_S = 1_000_000_000
_TO_VELOCITY = True
# What rounding may add, and a stop that no search looks at.
_HAIR = 1.0 + 1e-9
_FAR_TOO_LONG_S = 1000.0


@reference_free_njit()
def seconds_of(ticks, tick_ns):
    """Return the simulated time of a number of ticks [s]; see `gslcosim.ticks.seconds_from_ticks`."""
    return ticks * tick_ns / _NS_PER_S


@reference_free_njit()
def state_after_inplace(state, path, t_s):
    """Write the state of a path after a time: rows position [m], velocity [m/s], acceleration [m/s^2].

    Args:
        state: (3, 3) written.
        path: Record of `records.STATE`, of which the path counts.
        t_s: Time since its start [s].
    """
    if t_s >= path.duration_s - SAME_S:
        beyond_s = max(0.0, t_s - path.duration_s)
        for axis in range(3):
            velocity = path.end_velocity_world_m_s[axis]
            state[0, axis] = path.end_world_m[axis] + beyond_s * velocity
            state[1, axis] = velocity
            state[2, axis] = 0.0
        return
    for axis in range(3):
        state[0, axis], state[1, axis], state[2, axis], _ = polynomial_at(path.coefficients, axis, t_s)


@reference_free_njit()
def fly_at_inplace(path, case, start, end, u, v, w, tick):
    """Take the quickest path to a velocity.

    Args:
        path: Record of `records.STATE`; written.
        case: Record of `CASE`, with the limits.
        start: (3, 3) rows place [m], velocity [m/s], acceleration [m/s^2] at the tick's end, world frame.
        end: (3, 3) scratch, whose accelerations are 0.
        u: Velocity along world x [m/s].
        v: Velocity along world y [m/s].
        w: Velocity along world z [m/s].
        tick: The tick that ended.
    """
    end[1, 0], end[1, 1], end[1, 2] = u, v, w
    coefficients = path.coefficients
    duration_s = plan_inplace(
        coefficients, start, end, _TO_VELOCITY, case.max_speed_m_s, case.max_acceleration_m_s2, 0.0, 0.0
    )
    path.start_tick = tick
    path.duration_s = duration_s
    path.end_velocity_world_m_s[0] = u
    path.end_velocity_world_m_s[1] = v
    path.end_velocity_world_m_s[2] = w
    for axis in range(3):
        path.end_world_m[axis], _, _, _ = polynomial_at(coefficients, axis, duration_s)


@reference_free_njit()
def motion_inplace(state, path, case, tick):
    """Write the state of a path at the end of a tick; see `state_after_inplace`."""
    state_after_inplace(state, path, seconds_of(tick - path.start_tick, case.tick_ns))


@reference_free_njit()
def longest_stop_s(case, velocity_m_s, acceleration_m_s2):
    """Return a time [s] that the quickest stop does not take longer than; infinity where that is not seen at once.

    v(s) = (1 - s)^2 ((1 + 2 s) v + s a T),  s = t/T
    [m/s]

    Its acceleration is at most the greatest of |a|, 2 |v|/T, and 1.5 |v|/T + |a|/3. It is never faster than
    |v| + 4/27 |a| T, nor than |v| where a does not point along v and |a| T < sqrt(6) |v|. So a duration is known to be
    feasible without a look at the polynomial, and the search for the quickest, in steps of 4 %, ends there at the
    latest.

    Args:
        case: Record of `CASE`, with the limits.
        velocity_m_s: (3,) v, world frame [m/s].
        acceleration_m_s2: (3,) a, world frame [m/s^2].

    Source:
        `set_quartic_to_velocity_inplace`, to rest.
    Held by:
        tests/unit/training/batch/test_braking_kernels.py
    """
    v, a = velocity_m_s, acceleration_m_s2
    speed = math.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
    size = math.sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2])
    at_rest_s = 1.5 * speed / case.max_acceleration_m_s2
    if size == 0.0:
        return _HAIR * max(SHORTEST_S, at_rest_s)
    most = max(case.max_acceleration_m_s2, size)
    feasible_s = max(2.0 * speed / most, 1.5 * speed / (most - size / 3.0))
    longest_s = _HAIR * max(SHORTEST_S, 0.3 * at_rest_s, GROWTH * feasible_s)
    if speed + (4.0 / 27.0) * size * longest_s <= max(case.max_speed_m_s, speed):
        return longest_s
    slows = v[0] * a[0] + v[1] * a[1] + v[2] * a[2] <= 0.0
    return longest_s if slows and size * longest_s < 2.4 * speed else math.inf


@reference_free_njit()
def must_brake(path, case, room, work, tick):
    """Return whether a vehicle that began to brake a tick later would stop where it must not; see `guidance.edges`.

    Args:
        path: Record of `records.STATE`: what it flies.
        case: Record of `CASE`.
        room: Record of `ROOM`.
        work: Record of `WORK`.
        tick: The tick that ended.

    Held by:
        tests/unit/training/batch/test_braking_kernels.py
    """
    state, end, stop = work.states[0], work.states[1], array_at(work.paths, 2, STATE)[0]
    motion_inplace(state, path, case, tick + 1)
    # Mostly there is nothing anywhere near, and no need to know where exactly it stops.
    longest_s = longest_stop_s(case, state[1], state[2])
    if longest_s < _FAR_TOO_LONG_S and is_open_ahead(room, case.radius_m, state, longest_s):
        return False
    fly_at_inplace(stop, case, state, end, 0.0, 0.0, 0.0, tick)
    return is_edge_ahead(room, case.radius_m, stop.end_world_m, state[1])
