"""Brakes before the room ends: whether a vehicle that keeps its velocity can still stop in free space."""

import math
from dataclasses import dataclass

from gslcosim.ticks import NS_PER_S
from gslcosim.world.abilities import Abilities
from gslcosim.world.course import Course
from gslcosim.world.legs import AT_REST
from gslcosim.world.space import FlightSpace
from gslcosim.world.trajectory import Limits, Trajectory, Vec3, fly_at


@dataclass(frozen=True, kw_only=True)
class Edges:
    """Looks at where a vehicle would come to rest if it began to brake a tick later."""

    space: FlightSpace
    abilities: Abilities
    tick_ns: int

    def ahead(self, tick: int, course: Course) -> str | None:
        """Return why the vehicle must brake now, or nothing.

        An agent that sets attitude or rates looks after itself; wheels are stopped.
        """
        if course.setpoint is None:
            return self.ahead_on(tick, course.trajectory)
        if self.abilities.has_wheels:
            return self._ahead_of_wheels(course.position_m, course.velocity_m_s)
        return None

    def ahead_on(self, tick: int, path: Trajectory) -> str | None:
        """Return why a vehicle on a path must brake now, or nothing."""
        state = path.state_at(tick + 1, self.tick_ns)
        x_m, y_m, z_m = fly_at(state, AT_REST, self._limits, tick).end_world_m
        u, v, w = state[1].tolist()
        return self.space.edge_ahead("velocity", (x_m, y_m, z_m), (u, v, w))

    # A stop takes 1.5 v/a, on average at half the speed; see `set_quartic_to_velocity_inplace`.
    def _ahead_of_wheels(self, position_m: Vec3, velocity_m_s: Vec3) -> str | None:
        u, v, _ = velocity_m_s
        braking_s = 0.75 * math.hypot(u, v) / self._limits.max_acceleration_m_s2 + self.tick_ns / NS_PER_S
        x_m, y_m, z_m = position_m
        return self.space.edge_ahead("drive", (x_m + braking_s * u, y_m + braking_s * v, z_m), (u, v, 0.0))

    @property
    def _limits(self) -> Limits:
        return self.abilities.limits
