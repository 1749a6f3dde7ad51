"""When vehicles meet that keep their velocities, and what velocities that pass cost."""
# pyright: basic

import math

import numba
import numpy as np


@numba.njit(cache=True, nogil=True, inline="always")
def _meeting_s(p_x, p_y, p_z, u, v, w, least_m):
    # Two meet at the first root of |p - v t| = d. Who is too near already meets at once when it comes nearer still,
    # else never.
    closing = u * p_x + v * p_y + w * p_z
    if closing <= 0.0:
        return np.inf
    gap_m2 = p_x * p_x + p_y * p_y + p_z * p_z - least_m * least_m
    if gap_m2 <= 0.0:
        return 0.0
    speed2 = u * u + v * v + w * w
    under_root = closing * closing - speed2 * gap_m2
    return (closing - math.sqrt(under_root)) / speed2 if under_root > 0.0 else np.inf


@numba.njit(cache=True, nogil=True)
def soonest_meeting_s(own, wanted, positions_m, velocities_m_s, least_m):
    """Return after what time a vehicle is nearer to another one than it may be, when all keep their velocities.

    |p - v t| = d at the first t >= 0        p offset, v approach, d distance to keep
    [m] = [m/s] [s]

    Args:
        own: Index of the vehicle among all.
        wanted: Its velocity, world frame xyz [m/s].
        positions_m: (n, 3) all vehicles, world frame [m].
        velocities_m_s: (n, 3) all vehicles, world frame [m/s]; that of `own` does not count.
        least_m: (n,) what it keeps from each [m].

    Returns:
        Time [s]; 0 for who is too near already and comes nearer; infinite when it meets nobody.

    Source:
        Our derivation.
    Held by:
        tests/unit/world/guidance/test_separation.py
    """
    soonest_s = np.inf
    for i in range(positions_m.shape[0]):
        if i != own:
            meeting_s = _meeting_s(
                positions_m[i, 0] - positions_m[own, 0],
                positions_m[i, 1] - positions_m[own, 1],
                positions_m[i, 2] - positions_m[own, 2],
                wanted[0] - velocities_m_s[i, 0],
                wanted[1] - velocities_m_s[i, 1],
                wanted[2] - velocities_m_s[i, 2],
                least_m[i],
            )
            soonest_s = min(soonest_s, meeting_s)
    return soonest_s


@numba.njit(cache=True, nogil=True)
def passing_costs(
    tried_m_s, own, wanted, positions_m, velocities_m_s, least_m, gives_way, horizon_s, soonest_s, cost_m
):
    """Return what velocities cost a vehicle among others.

    cost = |v - wanted| + w / max(t, t_soonest) where t < horizon        t time until the first meeting
    [m/s] = [m/s] + [m] / [s]

    Another one that gives way too keeps its velocity u in half of the change: the two approach with 2 v - own - u,
    else with v - u.

    Args:
        tried_m_s: (k, 3) velocities to choose from, world frame [m/s].
        own: Index of the vehicle among all.
        wanted: Velocity that it would take alone, world frame xyz [m/s].
        positions_m: (n, 3) all vehicles, world frame [m].
        velocities_m_s: (n, 3) their velocities now, world frame [m/s].
        least_m: (n,) what it keeps from each [m].
        gives_way: (n,) whether each does its half.
        horizon_s: Meetings later than this cost nothing [s].
        soonest_s: Sooner ones cost no more than at this time [s].
        cost_m: w, what a meeting costs [m].

    Returns:
        (k,) costs [m/s].

    Source:
        van den Berg, Lin and Manocha 2008, doi:10.1109/ROBOT.2008.4543489, sections IV and V.
    Held by:
        tests/unit/world/guidance/test_separation.py
    """
    costs = np.empty(tried_m_s.shape[0])
    x, y, z = positions_m[own, 0], positions_m[own, 1], positions_m[own, 2]
    own_u, own_v, own_w = velocities_m_s[own, 0], velocities_m_s[own, 1], velocities_m_s[own, 2]
    for k in range(tried_m_s.shape[0]):
        u, v, w = tried_m_s[k, 0], tried_m_s[k, 1], tried_m_s[k, 2]
        meeting_s = np.inf
        for i in range(positions_m.shape[0]):
            if i == own:
                continue
            share = 0.5 if gives_way[i] else 1.0
            approach_u = own_u + (u - own_u) / share - velocities_m_s[i, 0]
            approach_v = own_v + (v - own_v) / share - velocities_m_s[i, 1]
            approach_w = own_w + (w - own_w) / share - velocities_m_s[i, 2]
            offset_x, offset_y, offset_z = positions_m[i, 0] - x, positions_m[i, 1] - y, positions_m[i, 2] - z
            met_s = _meeting_s(offset_x, offset_y, offset_z, approach_u, approach_v, approach_w, least_m[i])
            meeting_s = min(meeting_s, met_s)
        costs[k] = math.sqrt((u - wanted[0]) ** 2 + (v - wanted[1]) ** 2 + (w - wanted[2]) ** 2)
        if meeting_s < horizon_s:
            costs[k] += cost_m / max(meeting_s, soonest_s)
    return costs
