"""Sniffy Bug: waypoints by particle swarm, flown with four range finders along lines, along walls and past each other.

Duisterhof, Li, Burgues, Reddi, de Croon 2021 (IROS). Places and directions are in the world frame, (2,) float64.
Beams are numbered 0 front, 1 left, 2 back, 3 right; modulo 4 they turn counter-clockwise.

Held by:
    extensions/search/tests/unit/swarms/test_sniffy_bug.py
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gslcosim.base.errors import MethodError
from gslcosim.contract.messages import Briefing
from gslcosim_search import elementary
from gslcosim_search.elementary import distance, norm2
from gslcosim_search.senses.instruments import RangeFinder, find_range_finders

Vector = NDArray[np.float64]
RIGHT_ANGLE_RAD = 1.5707963267948966
N_BEAMS = 4
_LEAST_M = 1e-9


@dataclass(frozen=True, kw_only=True)
class BugParameters:
    """One set of parameters.

    Before there is gas, `search_inertia` w' and `search_draw` r_r make waypoints; afterwards `inertia` w, `own` phi_p
    and `swarm` phi_g. A new one is made within `reached_m` of the last or `waypoint_s` after it. `wall_m` is d_laser,
    `robot_m` d_swarm, `line_m` d_line; `wall_push` k_laser, `robot_push` k_swarm and `wall_push_m` d_laser' are those
    of the forces. `leg_m` cuts each waypoint to a leg, `square_m` draws places within so much of the robot in x and y
    instead of from the whole room; both 0: not.
    """

    inertia: float
    own: float
    swarm: float
    search_inertia: float
    search_draw: float
    waypoint_s: float
    reached_m: float
    wall_m: float
    robot_m: float
    line_m: float
    wall_push: float
    robot_push: float
    wall_push_m: float
    leg_m: float = 0.0
    square_m: float = 0.0


TABLES = {
    # Evolved in training rooms drawn so that hard ones came more often; read in the authors' code.
    "evolved_with_doping": BugParameters(
        inertia=0.271, own=-0.333, swarm=1.856, search_inertia=1.571, search_draw=2.034, waypoint_s=51.979,
        reached_m=2.690, wall_m=1.407, robot_m=0.782, line_m=0.469, wall_push=16.167, robot_push=10.032,
        wall_push_m=0.594,
    ),
    # Evolved in rooms drawn alike; the name of a file in the authors' code says so.
    "evolved": BugParameters(
        inertia=0.020, own=0.938, swarm=3.439, search_inertia=2.948, search_draw=1.200, waypoint_s=12.141,
        reached_m=4.125, wall_m=1.623, robot_m=1.269, line_m=0.461, wall_push=1.968, robot_push=2.814,
        wall_push_m=1.032,
    ),
    # Set by hand; remembered, unverified.
    "manual": BugParameters(
        inertia=0.5, own=0.8, swarm=2.0, search_inertia=0.3, search_draw=0.7, waypoint_s=10.0, reached_m=0.5,
        wall_m=1.5, robot_m=0.8, line_m=0.2, wall_push=5.0, robot_push=15.0, wall_push_m=1.5,
    ),
    # The port in GSL-Bench, read in its code: legs of 0.5 m. What it has not (walls, forces) is as set by hand.
    "gsl_bench": BugParameters(
        inertia=0.5, own=-0.333, swarm=1.856, search_inertia=0.1, search_draw=0.7, waypoint_s=10.0, reached_m=0.1,
        wall_m=1.5, robot_m=1.5, line_m=0.2, wall_push=5.0, robot_push=15.0, wall_push_m=1.5, leg_m=0.5, square_m=2.0,
    ),
}  # fmt: skip


def searching_waypoint(place_m: Vector, last_m: Vector, drawn_m: Vector, *, inertia: float, draw: float) -> Vector:
    """Return the next waypoint before any of the swarm has met gas.

    wp = x + w' (wp_last - x) + r_r (x_rand - x)        [m] = [m] + [1] [m] + [1] [m]

    Args:
        place_m: (2,) x, the robot [m].
        last_m: (2,) wp_last, its last waypoint [m].
        drawn_m: (2,) x_rand, a place drawn at random [m].
        inertia: w', how much of the last waypoint is kept.
        draw: r_r, how far it is to the place drawn.

    Source:
        Duisterhof et al. 2021, as read in the authors' code.
    """
    return place_m + inertia * (last_m - place_m) + draw * (drawn_m - place_m)


def tracking_waypoint(
    place_m: Vector, last_m: Vector, own_best_m: Vector, swarm_best_m: Vector, table: BugParameters
) -> Vector:
    """Return the next waypoint when somebody has met gas.

    wp = x + w (wp_last - x) + phi_p (p - x) + phi_g (g - x)        [m] = [m] + [1] [m] + ...; nothing is drawn

    Args:
        place_m: (2,) x, the robot [m].
        last_m: (2,) wp_last, its last waypoint [m].
        own_best_m: (2,) p, where it met most gas itself [m].
        swarm_best_m: (2,) g, where the swarm did [m].
        table: w, phi_p, phi_g.

    Source:
        Duisterhof et al. 2021, as read in the authors' code.
    """
    to_own, to_swarm = own_best_m - place_m, swarm_best_m - place_m
    return place_m + table.inertia * (last_m - place_m) + table.own * to_own + table.swarm * to_swarm


def beam_direction(beam: int, yaw_rad: float) -> Vector:
    """Return the unit vector along a beam, world frame."""
    angle_rad = yaw_rad + beam * RIGHT_ANGLE_RAD
    return np.array([elementary.cos(angle_rad), elementary.sin(angle_rad)])


def bracketing_beams(bearing_rad: float, yaw_rad: float) -> tuple[int, int]:
    """Return the two neighbouring beams between which a bearing lies, the one to its right first."""
    right = math.floor((bearing_rad - yaw_rad) / RIGHT_ANGLE_RAD + 1e-9) % N_BEAMS
    return right, (right + 1) % N_BEAMS


def off_line_m(place_m: Vector, start_m: Vector, goal_m: Vector) -> float:
    """Return the distance of a position to the left of the line from start to goal, negative to the right [m].

    e = d x (x - start) / |d|,  d = goal - start        0 where the line has no length
    """
    along_m, from_start_m = goal_m - start_m, place_m - start_m
    length_m = norm2(*along_m)
    if length_m <= _LEAST_M:
        return 0.0
    return float(along_m[0] * from_start_m[1] - along_m[1] * from_start_m[0]) / length_m


def avoidance_direction(
    place_m: Vector,
    goal_m: Vector,
    ranges_m: Sequence[float],
    yaw_rad: float,
    others_m: Sequence[Vector],
    table: BugParameters,
) -> Vector:
    """Return the direction in which a robot avoids others that are near: a unit vector, or zero where all balances.

    F = (wp - x) - sum over beams of k_laser max(0, d_laser' - range) b
               + sum over robots of k_swarm max(0, d_swarm - d) (x - x_j) / d        b along the beam, d = |x - x_j|
    F / |F|; [m] = [m] + [1] [m] + [1] [m]

    Args:
        place_m: (2,) x, the robot [m].
        goal_m: (2,) wp, its waypoint [m].
        ranges_m: The four ranges: front, left, back, right [m].
        yaw_rad: Where the first beam looks [rad].
        others_m: (2,) x_j each, the other robots [m].
        table: k_laser, d_laser', k_swarm, d_swarm.

    Source:
        Duisterhof et al. 2021.
    Deviation:
        The waypoint attracts by its distance; the gain of this term is not known to us.
    """
    total = goal_m - place_m
    for beam, range_m in enumerate(ranges_m):
        total = total - table.wall_push * max(0.0, table.wall_push_m - range_m) * beam_direction(beam, yaw_rad)
    for other_m in others_m:
        away_m = place_m - other_m
        distance_m = norm2(*away_m)
        if _LEAST_M < distance_m < table.robot_m:
            total = total + table.robot_push * (table.robot_m - distance_m) * away_m / distance_m
    size = norm2(*total)
    return total / size if size > _LEAST_M else np.zeros(2)


def remove_blocked_parts(direction: Vector, ranges_m: Sequence[float], yaw_rad: float, least_m: float) -> Vector:
    """Return a direction without the part that leads along beams which see something nearer than a least distance.

    Deviation:
        Ours: forces that balance and waypoints that jump must not fly a robot into a wall.
    """
    kept = direction
    for beam, range_m in enumerate(ranges_m):
        along = beam_direction(beam, yaw_rad)
        if range_m < least_m:
            kept = kept - max(0.0, float((kept * along).sum())) * along
    return kept


class Bug:
    """Brings a robot to its waypoint along the line, along walls, or pushed by others, one direction at a time.

    It flies along one of the two beams that bracket the line, and changes to the other one when it is `line_m` off it.
    Where what it wants is blocked (a range below `wall_m`) it follows the wall on the side nearer to the waypoint,
    until it is back on the line, nearer to the waypoint than where it met the wall.
    A wall's end is passed by `past_m` before it turns round it.

    State: the line, the beam it flies along, on which side the wall is (+1 left, -1 right, 0 none), how far the
    waypoint was where it met the wall, and where the wall was last seen.

    Source:
        Duisterhof et al. 2021, as described in words; the details of wall following are ours.
    """

    def __init__(self, table: BugParameters, *, past_m: float = 0.5) -> None:
        self._table = table
        self._past_m = past_m
        self._start_m = self._goal_m = np.zeros(2)
        self._met_wall_at_m = 0.0
        self._seen_wall_m: Vector | None = None
        self._turned_at_m = np.zeros(2)
        self._beam: int | None = None
        self.wall_side = 0

    def aim(self, place_m: Vector, goal_m: Vector) -> None:
        """Take a new waypoint: the line to it begins here."""
        self._start_m, self._goal_m = place_m.copy(), goal_m.copy()
        self._beam, self.wall_side = None, 0

    def direction(
        self, place_m: Vector, ranges_m: Sequence[float], yaw_rad: float, others_m: Sequence[Vector]
    ) -> Vector:
        """Return the direction to move in now: a unit vector, or zero where no direction is free.

        Args:
            place_m: (2,) the robot [m].
            ranges_m: The four ranges: front, left, back, right [m].
            yaw_rad: Where the first beam looks [rad].
            others_m: (2,) each, the other robots [m].
        """
        if any(distance(place_m, other_m) < self._table.robot_m for other_m in others_m):
            self.aim(place_m, self._goal_m)
            return avoidance_direction(place_m, self._goal_m, ranges_m, yaw_rad, others_m, self._table)
        is_free = [range_m >= self._table.wall_m for range_m in ranges_m]
        wanted = self._wanted_beams(place_m, yaw_rad)
        if self.wall_side and self._is_back_on_line(place_m) and any(is_free[beam] for beam in wanted):
            self.wall_side = 0
        if not self.wall_side:
            self._follow_line(place_m, yaw_rad, is_free, wanted)
        if self.wall_side:
            self._follow_wall(place_m, is_free, ranges_m)
        return np.zeros(2) if self._beam is None else beam_direction(self._beam, yaw_rad)

    def _bearing_rad(self, place_m: Vector) -> float:
        x_m, y_m = self._goal_m - place_m
        return elementary.atan2(y_m, x_m)

    # The beams that bracket the line, without the one that leads farther off it; the kept one first.
    def _wanted_beams(self, place_m: Vector, yaw_rad: float) -> list[int]:
        # Those that bracket the waypoint itself would change before a wall with every step to the side.
        has_passed = float(((place_m - self._goal_m) * (self._goal_m - self._start_m)).sum()) > 0.0
        bearing_rad = self._bearing_rad(place_m if has_passed else self._start_m)
        right, left = bracketing_beams(bearing_rad, yaw_rad)
        off_m = off_line_m(place_m, self._start_m, self._goal_m)
        wanted = [left] if off_m < -self._table.line_m else [right] if off_m > self._table.line_m else [right, left]
        return sorted(wanted, key=lambda beam: (beam != self._beam, _between_rad(beam, bearing_rad - yaw_rad)))

    def _is_back_on_line(self, place_m: Vector) -> bool:
        is_nearer = distance(place_m, self._goal_m) < self._met_wall_at_m - self._past_m
        return is_nearer and abs(off_line_m(place_m, self._start_m, self._goal_m)) <= self._table.line_m

    def _follow_line(self, place_m: Vector, yaw_rad: float, is_free: list[bool], wanted: list[int]) -> None:
        free = [beam for beam in wanted if is_free[beam]]
        if free:
            self._beam = free[0]
            return
        self._met_wall_at_m = distance(place_m, self._goal_m)
        self._seen_wall_m, self._turned_at_m = place_m.copy(), place_m.copy()
        self._beam, self.wall_side = _along_wall(wanted[0], self._bearing_rad(place_m) - yaw_rad, is_free)

    def _follow_wall(self, place_m: Vector, is_free: list[bool], ranges_m: Sequence[float]) -> None:
        assert self._beam is not None
        wall = (self._beam + self.wall_side) % N_BEAMS
        if not is_free[wall]:
            self._seen_wall_m = place_m.copy()
        elif self._has_passed_wall(place_m):
            self._seen_wall_m, self._turned_at_m, self._beam = None, place_m.copy(), wall
        if not is_free[self._beam]:
            turns = ((self._beam - self.wall_side) % N_BEAMS, (self._beam + 2) % N_BEAMS)
            self._beam = next((beam for beam in turns if is_free[beam]), int(np.argmax(ranges_m)))
            self._seen_wall_m = place_m.copy()

    # After a turn round an end the wall has to come into sight first, which takes as far as the wall was.
    def _has_passed_wall(self, place_m: Vector) -> bool:
        if self._seen_wall_m is None:
            return distance(place_m, self._turned_at_m) > self._table.wall_m + 2.0 * self._past_m
        return distance(place_m, self._seen_wall_m) > self._past_m


def _between_rad(beam: int, bearing_rad: float) -> float:
    return abs(math.remainder(beam * RIGHT_ANGLE_RAD - bearing_rad, 4.0 * RIGHT_ANGLE_RAD))


# The beam along a wall that blocks one, on the side nearer to the goal, and the side on which the wall then is.
def _along_wall(blocked: int, bearing_rad: float, is_free: list[bool]) -> tuple[int, int]:
    sides = sorted((1, -1), key=lambda turn: _between_rad((blocked + turn) % N_BEAMS, bearing_rad))
    for turn in sides:
        if is_free[(blocked + turn) % N_BEAMS]:
            return (blocked + turn) % N_BEAMS, -turn
    return (blocked + 2) % N_BEAMS, -sides[0]


def find_four_ranges(briefing: Briefing) -> RangeFinder:
    """Return the first range finder that looks front, left, back and right.

    Raises:
        MethodError: there is none.
    """
    for ranges in find_range_finders(briefing):
        if len(ranges.directions_body) == N_BEAMS and all(
            distance(direction[:2], beam_direction(beam, 0.0)) < 1e-3
            for beam, direction in enumerate(ranges.directions_body)
        ):
            return ranges
    raise MethodError(
        "sensors: expected range finders that look front, left, back and right for Sniffy Bug, was none. "
        "Add for example {model: four_range_finders, name: around}, without turning it."
    )
