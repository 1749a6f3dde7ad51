"""Brakes in time: whether a vehicle that keeps its velocity can still stop in free space."""

import math
from dataclasses import dataclass

import numpy as np

from gslcosim.quantities import Vec3
from gslcosim.ticks import NS_PER_S
from gslcosim.world.guidance.abilities import Abilities
from gslcosim.world.guidance.avoidance import Avoidance
from gslcosim.world.guidance.course import Course
from gslcosim.world.paths.legs import AT_REST
from gslcosim.world.paths.space import FlightSpace
from gslcosim.world.paths.trajectory import Limits, Trajectory, fly_at


@dataclass(frozen=True, kw_only=True)
class Edges:
    """Looks at where a vehicle would come to rest if it began to brake a tick later.

    It brakes before the room ends and before it would stop in a solid; with avoidance also before it would come too
    near to one.
    """

    space: FlightSpace
    abilities: Abilities
    tick_ns: int
    avoidance: Avoidance | None

    def ahead(self, tick: int, course: Course) -> str | None:
        """Return why the vehicle must brake now, or nothing.

        An agent that sets attitude or rates looks after itself; wheels are stopped.
        """
        if course.setpoint is None:
            return self.ahead_on(tick, course.trajectory)
        if self.abilities.has_wheels:
            return self._ahead_of_wheels(tick, course.position_m, course.velocity_m_s)
        return None

    def ahead_on(self, tick: int, path: Trajectory) -> str | None:
        """Return why a vehicle on a path must brake now, or nothing."""
        state = path.state_at(tick + 1, self.tick_ns)
        stop = fly_at(state, AT_REST, self._limits, tick)
        u, v, w = state[1].tolist()
        edge = self.space.edge_ahead("velocity", stop.end_world_m, (u, v, w))
        if edge is not None or self.avoidance is None:
            return edge
        return self.avoidance.refusal_of_stop("velocity", state, stop)

    def ahead_of_drive(self, tick: int, course: Course, speed_m_s: float) -> str | None:
        """Return why wheels cannot take a speed [m/s] from how they turn now, or nothing."""
        direction = (math.cos(course.yaw_rad), math.sin(course.yaw_rad))
        now_m_s = course.velocity_m_s[0] * direction[0] + course.velocity_m_s[1] * direction[1]
        change_m_s = self._limits.max_acceleration_m_s2 * self.tick_ns / NS_PER_S
        next_m_s = min(max(speed_m_s, now_m_s - change_m_s), now_m_s + change_m_s)
        velocity_m_s = (next_m_s * direction[0], next_m_s * direction[1], 0.0)
        return self._ahead_of_wheels(tick, course.position_m, velocity_m_s)

    # The braking begins from what the wheels do, which no path says.
    def _ahead_of_wheels(self, tick: int, position_m: Vec3, velocity_m_s: Vec3) -> str | None:
        u, v, _ = velocity_m_s
        # A stop takes 1.5 v/a, on average at half the speed; see `set_quartic_to_velocity_inplace`.
        braking_s = 0.75 * math.hypot(u, v) / self._limits.max_acceleration_m_s2 + self.tick_ns / NS_PER_S
        x_m, y_m, z_m = position_m
        edge = self.space.edge_ahead("drive", (x_m + braking_s * u, y_m + braking_s * v, z_m), (u, v, 0.0))
        if edge is not None or self.avoidance is None:
            return edge
        tick_s = self.tick_ns / NS_PER_S
        state = np.array([(x_m + tick_s * u, y_m + tick_s * v, z_m), (u, v, 0.0), AT_REST])
        return self.avoidance.refusal_of_stop("drive", state, fly_at(state, AT_REST, self._limits, tick))

    @property
    def _limits(self) -> Limits:
        return self.abilities.limits
