"""Paths of vehicles on wheels: they stop, turn on the spot, and drive on."""

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gslcosim.quantities import Vec3
from gslcosim.world.paths.legs import AT_REST, Leg, Motion, plan_leg, swings_out
from gslcosim.world.paths.trajectory import Heading, Limits, Trajectory, fly_at, stay_at

# A standing vehicle turns on the spot before it drives off in a direction further from its nose than this [rad]; one
# that drives stops for that only beyond the other.
TURN_FROM_RAD = 0.1
STOP_FROM_RAD = 1.0
# What a turn takes longer than its angle at full rate: speeding up, slowing down and settling [s].
TURN_SETTLES_S = 1.2
# Nearer than this it is there already [m].
_THERE_M = 0.02
_STANDS_BELOW_M_S = 0.01


@dataclass(frozen=True, kw_only=True)
class RoverPlanner:
    """Plans for vehicles that go where they look; heights of places and velocities are left out."""

    limits: Limits
    tick_ns: int
    max_yaw_rate_rad_s: float

    def along(self, leg: Leg, motion: Motion, tick: int) -> tuple[Trajectory, bool]:
        """Return the path along a leg, or the stop or turn that has to come before it."""
        leg = _on_ground(leg, float(motion.state[0, 2]))
        if math.dist(leg.place_world_m, motion.state[0]) < _THERE_M and not leg.is_passed:
            return self._stop(motion, tick), False
        path = plan_leg(leg, motion.state, self.limits, tick, self.tick_ns)
        if swings_out(leg, path, motion.state, self.limits):
            return self._stop(motion, tick), True
        return self._prepared(path, motion, tick)

    def at_velocity(self, velocity_world_m_s: Vec3, motion: Motion, tick: int) -> tuple[Trajectory, bool]:
        """Return the path to a velocity, or the stop or turn that has to come before it."""
        u, v, _ = velocity_world_m_s
        path = fly_at(motion.state, (u, v, 0.0), self.limits, tick)
        return (path, False) if (u, v) == (0.0, 0.0) else self._prepared(path, motion, tick)

    def _prepared(self, path: Trajectory, motion: Motion, tick: int) -> tuple[Trajectory, bool]:
        direction_rad = _first_direction_rad(path)
        off_rad = abs(math.remainder(direction_rad - motion.yaw_rad, 2 * math.pi))
        is_standing = math.hypot(*motion.state[1]) < _STANDS_BELOW_M_S
        if off_rad <= (TURN_FROM_RAD if is_standing else STOP_FROM_RAD):
            return path, False
        if not is_standing:
            return self._stop(motion, tick), True
        duration_s = off_rad / self.max_yaw_rate_rad_s + TURN_SETTLES_S
        x_m, y_m, z_m = motion.state[0].tolist()
        turn = stay_at((x_m, y_m, z_m), tick, duration_s=duration_s)
        return replace(turn, heading=Heading(yaw_rad=direction_rad)), True

    def _stop(self, motion: Motion, tick: int) -> Trajectory:
        return fly_at(motion.state, AT_REST, self.limits, tick)


def _on_ground(leg: Leg, height_m: float) -> Leg:
    x_m, y_m, _ = leg.place_world_m
    u, v, _ = leg.velocity_world_m_s
    a, b, _ = leg.acceleration_world_m_s2
    return replace(
        leg,
        place_world_m=(x_m, y_m, height_m),
        velocity_world_m_s=(u, v, 0.0),
        acceleration_world_m_s2=(a, b, 0.0),
    )


# At the very start a path from rest has no direction yet.
def _first_direction_rad(path: Trajectory) -> float:
    velocity: NDArray[np.float64] = path.state_after(0.05 * path.duration_s)[1]
    return math.atan2(float(velocity[1]), float(velocity[0]))
