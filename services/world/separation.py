# pyright: basic
"""Separation of vehicles: velocities that pass others at a distance, and the evasion that follows them.

Arguments of kernels: `own` index of a vehicle among all; `wanted` its velocity without the others, world frame xyz
[m/s]; `positions_m`, `velocities_m_s` (n, 3) those of all vehicles now, world frame; `least_m` (n,) what it keeps from
each [m].
"""

# ruff: noqa: ANN001, ANN201, ANN202 - kernels have no types, and symbols of equations

import math
from collections.abc import Callable
from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from gslcosim.base import elementary
from gslcosim.base.quantities import Vec3
from gslcosim.base.scalar_kernels import distance, norm3
from gslcosim.base.ticks import ticks_from_seconds
from gslcosim.environment.model import Cell, Environment
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
    [(share * elementary.cos(a), share * elementary.sin(a), share) for share in _SPEED_FRACTIONS for a in _TURNS_RAD]
    + [(0.0, 0.0, 0.0)]
)
# Longest time for which a vehicle makes way for others on one leg, before it holds.
MAX_EVASION_S = 20.0
# The middle of a vehicle and its sides, in radii.
_HULL_OFFSETS = np.array([(0, 0, 0), (1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1)], np.float64)

_SOLID = int(Cell.SOLID)


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
def rank_passing_velocities(own, wanted, positions_m, velocities_m_s, least_m, gives_way):
    """Return velocities that a vehicle may take among others, the cheapest first.

    cost = |v - wanted| + w / max(t, t_soonest) where t < horizon        t time until the first meeting
    [m/s] = [m/s] + [m] / [s]

    Another one that makes way too keeps its velocity u in half of the change: the two approach with 2 v - own - u,
    else with v - u. Costs are compared in units of 1e-9 m/s; of equal ones the first velocity comes first.

    Args:
        gives_way: (n,) whether each does its half.

    Returns:
        (k, 3) velocities, world frame [m/s].

    Source:
        van den Berg, Lin and Manocha 2008, doi:10.1109/ROBOT.2008.4543489, sections IV and V.
    Held by:
        tests/unit/services/world/test_separation.py
    """
    ranked = np.empty((_CANDIDATE_FACTORS.shape[0], 3))
    costs = np.empty(_CANDIDATE_FACTORS.shape[0])
    x, y, z = positions_m[own, 0], positions_m[own, 1], positions_m[own, 2]
    own_u, own_v, own_w = velocities_m_s[own, 0], velocities_m_s[own, 1], velocities_m_s[own, 2]
    for k in range(_CANDIDATE_FACTORS.shape[0]):
        cosine, sine, fraction = _CANDIDATE_FACTORS[k]
        u, v, w = cosine * wanted[0] - sine * wanted[1], sine * wanted[0] + cosine * wanted[1], fraction * wanted[2]
        meeting_s = np.inf
        for i in range(positions_m.shape[0]):
            if i == own:
                continue
            n_halves = 2.0 if gives_way[i] else 1.0
            approach_u = own_u + (u - own_u) * n_halves - velocities_m_s[i, 0]
            approach_v = own_v + (v - own_v) * n_halves - velocities_m_s[i, 1]
            approach_w = own_w + (w - own_w) * n_halves - velocities_m_s[i, 2]
            offset_x, offset_y, offset_z = positions_m[i, 0] - x, positions_m[i, 1] - y, positions_m[i, 2] - z
            met_s = _pair_time_to_conflict_s(
                offset_x, offset_y, offset_z, approach_u, approach_v, approach_w, least_m[i]
            )
            meeting_s = min(meeting_s, met_s)
        cost = math.sqrt((u - wanted[0]) ** 2 + (v - wanted[1]) ** 2 + (w - wanted[2]) ** 2)
        if meeting_s < HORIZON_S:
            cost += _CONFLICT_COST_M / max(meeting_s, _MIN_CONFLICT_TIME_S)
        cost = np.rint(cost * 1e9) / 1e9
        place = k
        while place > 0 and costs[place - 1] > cost:
            costs[place], ranked[place] = costs[place - 1], ranked[place - 1]
            place -= 1
        costs[place] = cost
        ranked[place, 0], ranked[place, 1], ranked[place, 2] = u, v, w
    return ranked


@numba.njit(cache=True, nogil=True)
def is_hull_open_ahead(position_m, velocity_m_s, radius_m, occupancy, origin_m, cell_m):
    """Return whether a vehicle that keeps a velocity is in the room and in free cells half a second and a second later.

    Args:
        position_m: Its middle now, world frame xyz [m].
        velocity_m_s: World frame xyz [m/s].
        radius_m: Distance of its sides, which are looked at too, from its middle [m].
        occupancy: (nx, ny, nz) contents of cells.
        origin_m: Corner of cell (0, 0, 0), world frame xyz [m].
        cell_m: Edge of the cells [m].

    Held by:
        tests/unit/services/world/test_separation.py
    """
    nx, ny, nz = occupancy.shape
    for ahead_s in (0.5, 1.0):
        x, y, z = (
            ahead_s * velocity_m_s[0] + position_m[0],
            ahead_s * velocity_m_s[1] + position_m[1],
            ahead_s * velocity_m_s[2] + position_m[2],
        )
        for side in _HULL_OFFSETS:
            i = math.floor((x + radius_m * side[0] - origin_m[0]) / cell_m)
            j = math.floor((y + radius_m * side[1] - origin_m[1]) / cell_m)
            k = math.floor((z + radius_m * side[2] - origin_m[2]) / cell_m)
            if not (0 <= i < nx and 0 <= j < ny and 0 <= k < nz) or occupancy[i, j, k] == _SOLID:
                return False
    return True


class Neighbours(NamedTuple):
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
    `rank_passing_velocities` has their costs; the cheapest that leads to free places is taken.

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
    others = (neighbours.positions_m, neighbours.velocities_m_s, neighbours.least_m, neighbours.yields)
    for u, v, w in rank_passing_velocities(neighbours.own, wanted_m_s, *others).tolist():
        if is_open((u, v, w)):
            return u, v, w
    return 0.0, 0.0, 0.0


def warm_up_separation(room: Environment) -> None:
    """Pass an invented vehicle once, so that no kernel is compiled or loaded while simulated time passes."""
    places_m = np.array([(0.0, 0.0, 0.0), (1.0, 0.0, 0.0)])
    is_giving_way = np.ones(2, np.bool_)
    ahead = Neighbours(own=0, positions_m=places_m, velocities_m_s=-places_m, least_m=np.ones(2), yields=is_giving_way)
    space = FlightSpace(environment=room, radius_m=0.5)
    if has_conflict((1.0, 0.0, 0.0), ahead, HORIZON_S):
        find_passing_velocity((1.0, 0.0, 0.0), ahead, lambda velocity: is_open_ahead(space, AT_REST, velocity))


def is_open_ahead(space: FlightSpace, position_m: Vec3, velocity_m_s: Vec3) -> bool:
    """Return whether a vehicle at a place, world frame [m], that keeps a velocity [m/s] has room for a second."""
    room = space.room
    return is_hull_open_ahead(
        position_m, velocity_m_s, space.radius_m, room.occupancy, room.grid.origin_m, room.grid.cell_m
    )


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
        here_m = self._path_follower.trajectory.position_at(tick, self._tick_ns)
        distance_m = distance(leg.place_world_m, here_m)
        if distance_m < ARRIVAL_RADIUS_M:
            return AT_REST, 0.0
        share_s = self._limits.max_speed_m_s * min(1.0, distance_m) / distance_m
        (x, y, z), (to_x, to_y, to_z) = here_m, leg.place_world_m
        u, v, w = share_s * (to_x - x), share_s * (to_y - y), share_s * (to_z - z)
        return (u, v, w), min(HORIZON_S, distance_m / norm3(u, v, w))

    # A second ahead, as wide as the vehicle.
    def _is_open(self, velocity_m_s: Vec3) -> bool:
        position_m = self._path_follower.position_m
        if self._avoidance is not None:
            u, v, w = velocity_m_s
            x_m, y_m, z_m = position_m
            return self._avoidance.is_line_clear(position_m, (x_m + u, y_m + v, z_m + w))
        return is_open_ahead(self._space, position_m, velocity_m_s)
