# pyright: basic
"""Separation of vehicles: velocities that pass others at a distance, and the evasion that follows them."""

# ruff: noqa: ANN001, ANN201, ANN202 - kernels have no types, and symbols of equations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

from gslcosim.base.quantities import Vec3
from gslcosim.base.ticks import ticks_from_seconds
from gslcosim_services.world.flight_space import FlightSpace
from gslcosim_services.world.leg_planners import AT_REST
from gslcosim_services.world.obstacle_avoidance import ObstacleAvoidance
from gslcosim_services.world.path_follower import ARRIVAL_RADIUS_M, PathFollower
from gslcosim_services.world.trajectory import Limits, Trajectory, plan_to_velocity

# Look-ahead of vehicles [s]. Chosen: at 1 m/s each, two of them detect one another 8 m apart.
HORIZON_S = 4.0
# Cost of a second less until a meeting, against the deviation from the desired velocity [m]; chosen.
_CONFLICT_COST_M = 3.0
_MIN_CONFLICT_TIME_S = 0.05
# Turns away from the desired direction [rad], to the right first: of equally good ones the first is taken.
_TURNS_RAD = tuple(side * i * math.pi / 8 for i in range(9) for side in ((-1, 1) if 0 < i < 8 else (-1,)))
_SPEED_FRACTIONS = (1.0, 0.5)
# Factors from a desired velocity to the candidates, (k, 3) cosine, sine and fraction of the climb: all turns at full
# and at half speed, then none.
_CANDIDATE_FACTORS = np.array(
    [(share * math.cos(a), share * math.sin(a), share) for share in _SPEED_FRACTIONS for a in _TURNS_RAD]
    + [(0.0, 0.0, 0.0)]
)
# Longest time for which a vehicle makes way for others on one leg, before it holds.
MAX_EVASION_S = 20.0
# The middle of a vehicle and its sides, in radii.
_HULL_OFFSETS = np.array([(0, 0, 0), (1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1)], np.float64)


@numba.njit(cache=True, nogil=True, inline="always")
def _pair_time_to_conflict_s(p_x, p_y, p_z, u, v, w, least_m):
    # Two meet at the first root of |p - v t| = d. A vehicle that is too near already meets at once if it comes nearer
    # still, else never.
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
def time_to_conflict_s(own, wanted, positions_m, velocities_m_s, least_m):
    """Return the time until a vehicle is nearer to another one than it may be, when all keep their velocities.

    |p - v t| = d at the first t >= 0        p offset, v approach, d distance to keep
    [m] = [m/s] [s]

    Args:
        own: Index of the vehicle among all.
        wanted: Its desired velocity, world frame xyz [m/s].
        positions_m: (n, 3) all vehicles, world frame [m].
        velocities_m_s: (n, 3) all vehicles, world frame [m/s]; that of `own` does not count.
        least_m: (n,) what it keeps from each [m].

    Returns:
        Time [s]; 0 for a vehicle that is too near already and comes nearer; infinite without a meeting.

    Source:
        Our derivation.
    Held by:
        tests/unit/services/world/test_separation.py
    """
    soonest_s = np.inf
    for i in range(positions_m.shape[0]):
        if i != own:
            meeting_s = _pair_time_to_conflict_s(
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
    """Return the costs of velocities of a vehicle among others.

    cost = |v - wanted| + w / max(t, t_soonest) where t < horizon        t time until the first meeting
    [m/s] = [m/s] + [m] / [s]

    Another one that makes way too keeps its velocity u in half of the change: the two approach with 2 v - own - u,
    else with v - u.

    Args:
        tried_m_s: (k, 3) velocities to choose from, world frame [m/s].
        own: Index of the vehicle among all.
        wanted: Velocity without the others, world frame xyz [m/s].
        positions_m: (n, 3) all vehicles, world frame [m].
        velocities_m_s: (n, 3) their velocities now, world frame [m/s].
        least_m: (n,) what it keeps from each [m].
        gives_way: (n,) whether each does its half.
        horizon_s: Meetings later than this cost nothing [s].
        soonest_s: Sooner ones cost no more than at this time [s].
        cost_m: w, cost of a meeting [m].

    Returns:
        (k,) costs [m/s].

    Source:
        van den Berg, Lin and Manocha 2008, doi:10.1109/ROBOT.2008.4543489, sections IV and V.
    Held by:
        tests/unit/services/world/test_separation.py
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
            met_s = _pair_time_to_conflict_s(
                offset_x, offset_y, offset_z, approach_u, approach_v, approach_w, least_m[i]
            )
            meeting_s = min(meeting_s, met_s)
        costs[k] = math.sqrt((u - wanted[0]) ** 2 + (v - wanted[1]) ** 2 + (w - wanted[2]) ** 2)
        if meeting_s < horizon_s:
            costs[k] += cost_m / max(meeting_s, soonest_s)
    return costs


@dataclass(frozen=True, kw_only=True, eq=False)
class Neighbours:
    """All vehicles as one of them sees them; `own` is its index.

    `positions_m` and `velocities_m_s` are (n, 3), world frame; `least_m` is (n,), its distance from each [m];
    `gives_way` (n,) marks those that do their half of keeping apart.
    """

    own: int
    positions_m: NDArray[np.float64]
    velocities_m_s: NDArray[np.float64]
    least_m: NDArray[np.float64]
    yields: NDArray[np.bool_]


def has_conflict(wanted_m_s: Vec3, neighbours: Neighbours, within_s: float) -> bool:
    """Return whether a velocity, kept, brings a vehicle nearer to another one than it may be, within a time [s]."""
    others = (neighbours.positions_m, neighbours.velocities_m_s, neighbours.least_m)
    return bool(time_to_conflict_s(neighbours.own, wanted_m_s, *others) < within_s)


def find_passing_velocity(wanted_m_s: Vec3, neighbours: Neighbours, is_open: Callable[[Vec3], bool]) -> Vec3:
    """Return the velocity, nearest to the desired one, that leads a vehicle past others.

    Reciprocal velocity obstacles: a vehicle in a pair that both make way changes its velocity by half of the need.
    `passing_costs` has the costs of velocities; the cheapest that leads to free places is taken.

    Args:
        wanted_m_s: Velocity that it would take alone, world frame [m/s], not zero.
        neighbours: The others, and its own velocity.
        is_open: Predicate: a velocity leads to free places.

    Source:
        van den Berg, Lin and Manocha 2008, Reciprocal velocity obstacles for real-time multi-agent navigation,
        doi:10.1109/ROBOT.2008.4543489, sections IV and V.
    Deviation:
        Velocities are tried on a fixed grid instead of drawn: turned about the vertical, to the right first.
    Held by:
        tests/unit/services/world/test_separation.py
    """
    tried = _candidate_velocities(wanted_m_s)
    others = (neighbours.positions_m, neighbours.velocities_m_s, neighbours.least_m, neighbours.yields)
    limits = (HORIZON_S, _MIN_CONFLICT_TIME_S, _CONFLICT_COST_M)
    costs = passing_costs(tried, neighbours.own, wanted_m_s, *others, *limits)
    for i in np.argsort(costs.round(9), kind="stable"):
        u, v, w = tried[i].tolist()
        if is_open((u, v, w)):
            return u, v, w
    return 0.0, 0.0, 0.0


def warm_up_separation() -> None:
    """Pass an invented vehicle once, so that no kernel is compiled or loaded while simulated time passes."""
    places_m = np.array([(0.0, 0.0, 0.0), (1.0, 0.0, 0.0)])
    is_giving_way = np.ones(2, np.bool_)
    ahead = Neighbours(own=0, positions_m=places_m, velocities_m_s=-places_m, least_m=np.ones(2), yields=is_giving_way)
    if has_conflict((1.0, 0.0, 0.0), ahead, HORIZON_S):
        find_passing_velocity((1.0, 0.0, 0.0), ahead, lambda _: True)


def _candidate_velocities(wanted_m_s: Vec3) -> NDArray[np.float64]:
    u, v, w = wanted_m_s
    cosine, sine, share = _CANDIDATE_FACTORS.T
    return np.stack([cosine * u - sine * v, sine * u + cosine * v, share * w], axis=1)


class Evasion:
    """Evasion of one vehicle: leaves its path to pass others, and counts how long.

    State: the path on which it last did so, and the tick from which on it no longer does so on this leg.
    """

    def __init__(
        self,
        follower: PathFollower,
        space: FlightSpace,
        limits: Limits,
        tick_ns: int,
        *,
        avoidance: ObstacleAvoidance | None,
    ) -> None:
        self._path_follower = follower
        self._space = space
        self._limits = limits
        self._tick_ns = tick_ns
        self._avoidance = avoidance
        self._path: Trajectory | None = None
        self._until_tick = 0

    def begin_leg(self, tick: int, *, is_new: bool) -> None:
        """Count the time from now where a leg begins that was not begun before."""
        if not is_new:
            return
        self._until_tick = tick + ticks_from_seconds(MAX_EVASION_S, self._tick_ns)

    @property
    def is_under_way(self) -> bool:
        """True while the vehicle is off its path."""
        return self._path is not None and self._path_follower.trajectory is self._path

    def is_too_long(self, tick: int) -> bool:
        """Return whether the vehicle has made way for too long on this leg."""
        return self._path_follower.leg is not None and self.is_under_way and tick >= self._until_tick

    def conflicting_velocity_m_s(self, tick: int, neighbours: Neighbours) -> Vec3 | None:
        """Return the desired velocity that would bring the vehicle too near to another one, or nothing."""
        wanted_m_s, within_s = self._wanted(tick)
        return wanted_m_s if has_conflict(wanted_m_s, neighbours, within_s) else None

    def evade(self, tick: int, wanted_m_s: Vec3, neighbours: Neighbours) -> None:
        """Set a velocity that passes the others, as near as possible to the desired one."""
        velocity_m_s = find_passing_velocity(wanted_m_s, neighbours, self._is_open)
        self._path = plan_to_velocity(self._path_follower.motion(tick).state, velocity_m_s, self._limits, tick)
        self._path_follower.divert(self._path)

    # The velocity straight to the goal, slower on the last metre, and its look-ahead.
    def _wanted(self, tick: int) -> tuple[Vec3, float]:
        kept_m_s, leg = self._path_follower.kept_velocity_m_s, self._path_follower.leg
        if kept_m_s is not None or leg is None:
            return kept_m_s or AT_REST, HORIZON_S
        here_m = self._path_follower.motion(tick).state[0].tolist()
        distance_m = math.dist(leg.place_world_m, here_m)
        if distance_m < ARRIVAL_RADIUS_M:
            return AT_REST, 0.0
        share_s = self._limits.max_speed_m_s * min(1.0, distance_m) / distance_m
        u, v, w = (share_s * (there - here) for there, here in zip(leg.place_world_m, here_m, strict=True))
        return (u, v, w), min(HORIZON_S, distance_m / math.hypot(u, v, w))

    # A second ahead, as wide as the vehicle.
    def _is_open(self, velocity_m_s: Vec3) -> bool:
        position_m = self._path_follower.position_m
        if self._avoidance is not None:
            u, v, w = velocity_m_s
            x_m, y_m, z_m = position_m
            return self._avoidance.is_line_clear(position_m, (x_m + u, y_m + v, z_m + w))
        ahead_m = np.multiply.outer((0.5, 1.0), velocity_m_s)[:, np.newaxis] + position_m
        return self._space.is_open((ahead_m + self._space.radius_m * _HULL_OFFSETS).reshape(-1, 3))
