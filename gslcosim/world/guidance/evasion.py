"""Out of the way of others, and back: what a vehicle on its course does to keep apart; the rule is in `separation`."""

import math

import numpy as np

from gslcosim.quantities import Vec3
from gslcosim.ticks import ticks_from_seconds
from gslcosim.world.guidance.arrival import ARRIVED_WITHIN_M
from gslcosim.world.guidance.avoidance import Avoidance
from gslcosim.world.guidance.course import Course
from gslcosim.world.guidance.separation import LOOKS_AHEAD_S, Neighbours, meets_within, passing_velocity
from gslcosim.world.paths.legs import AT_REST
from gslcosim.world.paths.space import FlightSpace
from gslcosim.world.paths.trajectory import Limits, Trajectory, fly_at

# How long a vehicle may go out of the way of others on one leg, before it holds.
GIVES_WAY_FOR_S = 20.0
# The middle of a vehicle and its sides, in radii.
_SIDES = np.array([(0, 0, 0), (1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1)], np.float64)


class Evasion:
    """Lets one vehicle go out of the way of others.

    State: the path on which it last did so, and the tick from which on it no longer does so on this leg.
    """

    def __init__(
        self, course: Course, space: FlightSpace, limits: Limits, tick_ns: int, *, avoidance: Avoidance | None
    ) -> None:
        self._course = course
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
        self._until_tick = tick + ticks_from_seconds(GIVES_WAY_FOR_S, self._tick_ns)

    @property
    def is_under_way(self) -> bool:
        """Whether the vehicle is off its course."""
        return self._path is not None and self._course.trajectory is self._path

    def is_too_long(self, tick: int) -> bool:
        """Return whether the vehicle has gone out of the way for too long on this leg."""
        return self._course.leg is not None and self.is_under_way and tick >= self._until_tick

    def needed_m_s(self, tick: int, neighbours: Neighbours) -> Vec3 | None:
        """Return the velocity wanted that would bring the vehicle too near to another one; nothing when none would."""
        wanted_m_s, within_s = self._wanted(tick)
        return wanted_m_s if meets_within(wanted_m_s, neighbours, within_s) else None

    def evade(self, tick: int, wanted_m_s: Vec3, neighbours: Neighbours) -> None:
        """Take a velocity that passes the others, as near as possible to the one wanted."""
        velocity_m_s = passing_velocity(wanted_m_s, neighbours, self._is_open)
        self._path = fly_at(self._course.motion(tick).state, velocity_m_s, self._limits, tick)
        self._course.go_aside(self._path)

    # The velocity straight to where it is going, slower on the last metre, and how far ahead that counts.
    def _wanted(self, tick: int) -> tuple[Vec3, float]:
        kept_m_s, leg = self._course.kept_velocity_m_s, self._course.leg
        if kept_m_s is not None or leg is None:
            return kept_m_s or AT_REST, LOOKS_AHEAD_S
        here_m = self._course.motion(tick).state[0].tolist()
        distance_m = math.dist(leg.place_world_m, here_m)
        if distance_m < ARRIVED_WITHIN_M:
            return AT_REST, 0.0
        share_s = self._limits.max_speed_m_s * min(1.0, distance_m) / distance_m
        u, v, w = (share_s * (there - here) for there, here in zip(leg.place_world_m, here_m, strict=True))
        return (u, v, w), min(LOOKS_AHEAD_S, distance_m / math.hypot(u, v, w))

    # A second ahead, as wide as the vehicle.
    def _is_open(self, velocity_m_s: Vec3) -> bool:
        position_m = self._course.position_m
        if self._avoidance is not None:
            u, v, w = velocity_m_s
            x_m, y_m, z_m = position_m
            return self._avoidance.is_way_free(position_m, (x_m + u, y_m + v, z_m + w))
        ahead_m = np.multiply.outer((0.5, 1.0), velocity_m_s)[:, np.newaxis] + position_m
        return self._space.is_open((ahead_m + self._space.radius_m * _SIDES).reshape(-1, 3))
