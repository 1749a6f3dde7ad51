"""Legs of a path and the planners that turn them into trajectories, for vehicles in the air and on wheels."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from gslcosim.base import elementary
from gslcosim.base.quantities import Vec3
from gslcosim.base.scalar_kernels import distance, norm3
from gslcosim.base.ticks import NS_PER_S
from gslcosim_services.world.flight_space import FlightSpace
from gslcosim_services.world.trajectory import (
    UNCHANGED_HEADING,
    Heading,
    Limits,
    Trajectory,
    deviates_too_far,
    is_beyond_limit,
    plan_rest,
    plan_to_point,
    plan_to_state,
    plan_to_velocity,
    polynomial_position,
    polynomial_state,
    to_vec3,
)

AT_REST: Vec3 = (0.0, 0.0, 0.0)
# Fractions of a path's duration at which it is sampled.
_CHECKED_FRACTIONS = np.linspace(0.1, 1.0, 10).tolist()

# A standing vehicle turns on the spot before it drives off in a direction further from its nose than this [rad]; one
# that drives stops for that only beyond the other.
MIN_TURN_RAD = 0.1
MIN_STOP_TURN_RAD = 1.0
# Time of a turn beyond its angle at full rate: speeding up, slowing down and settling [s].
TURN_SETTLING_S = 1.2
# Nearer than this it is there already [m].
_GOAL_TOLERANCE_M = 0.02
_STANDSTILL_SPEED_M_S = 0.01


@dataclass(frozen=True, kw_only=True)
class Leg:
    """The way to one place: to rest there, or to pass it with a velocity and an acceleration, world frame.

    `name` is the leg's name in refusals; `hold_s` counts only where it rests; `after_s` is the least time for it;
    `is_bend` marks a bend on the way to the agent's goal.
    """

    name: str
    place_world_m: Vec3
    velocity_world_m_s: Vec3 = AT_REST
    acceleration_world_m_s2: Vec3 = AT_REST
    hold_s: float = 0.0
    after_s: float | None = None
    heading: Heading = UNCHANGED_HEADING
    is_bend: bool = False

    @property
    def is_passed(self) -> bool:
        """True where the vehicle does not stop at the leg's end."""
        return any(self.velocity_world_m_s)

    @property
    def end(self) -> NDArray[np.float64]:
        """(3, 3) rows position [m], velocity [m/s], acceleration [m/s^2] at its end; world frame."""
        return np.array([self.place_world_m, self.velocity_world_m_s, self.acceleration_world_m_s2])


def find_motion_refusal(leg: Leg, limits: Limits) -> str | None:
    """Return why a leg's end cannot be passed at its velocity, or nothing."""
    for name, vector, most, unit in (
        ("velocity", leg.velocity_world_m_s, limits.max_speed_m_s, "m/s"),
        ("acceleration", leg.acceleration_world_m_s2, limits.max_acceleration_m_s2, "m/s^2"),
    ):
        size = math.sqrt(sum(part * part for part in vector))
        if is_beyond_limit(size, most):
            return f"{leg.name}.{name}: expected at most {most:g} {unit}, was {size:g} {unit}."
    if leg.hold_s and leg.is_passed:
        return f"{leg.name}.hold_s: expected 0 where the vehicle passes with a velocity, was {leg.hold_s:g} s."
    return None


def find_curve_refusal(
    legs: Sequence[Leg], state: NDArray[np.float64], limits: Limits, space: FlightSpace, tick_ns: int
) -> str | None:
    """Return why legs that begin or end in motion are refused, or nothing: their paths leave the straight line.

    Args:
        legs: The legs, one after the other.
        state: (3, 3) rows position [m], velocity [m/s], acceleration [m/s^2] at their start; world frame.
        limits: Speed and acceleration kept to.
        space: Flight space of the vehicle.
        tick_ns: Length of a tick [ns].
    """
    for leg in legs:
        path = plan_leg(leg, state, limits, 0, tick_ns)
        if leg.is_passed or np.any(state[1]):
            for share in _CHECKED_FRACTIONS:
                place_m = to_vec3(path.state_after(share * path.duration_s)[0])
                refusal = space.refusal(f"{leg.name}: path to it", place_m)
                if refusal is not None:
                    return refusal
        state = leg.end
    return None


@dataclass(frozen=True, kw_only=True)
class MotionState:
    """Motion of a vehicle at the end of a tick: its reference as (3, 3) state, and its true heading [rad]."""

    state: NDArray[np.float64]
    yaw_rad: float


class LegPlanner(Protocol):
    """Plans paths of one kind of vehicle; a path that only prepares is followed by another plan to the same end."""

    def along(self, leg: Leg, motion: MotionState, tick: int) -> tuple[Trajectory, bool]:
        """Return the path along a leg, and whether it only prepares for it."""
        ...

    def at_velocity(self, velocity_world_m_s: Vec3, motion: MotionState, tick: int) -> tuple[Trajectory, bool]:
        """Return the path to a velocity, and whether it only prepares for it."""
        ...


@dataclass(frozen=True, kw_only=True)
class FlightPlanner:
    """Plans for vehicles that can accelerate in any direction."""

    limits: Limits
    tick_ns: int

    def along(self, leg: Leg, motion: MotionState, tick: int) -> tuple[Trajectory, bool]:
        """Return the path along a leg, or the stop that has to come before it where it would swing out."""
        path = plan_leg(leg, motion.state, self.limits, tick, self.tick_ns)
        if deviates_from_line(leg, path, motion.state, self.limits):
            return replace(plan_to_velocity(motion.state, AT_REST, self.limits, tick), heading=leg.heading), True
        return replace(path, heading=leg.heading), False

    def at_velocity(self, velocity_world_m_s: Vec3, motion: MotionState, tick: int) -> tuple[Trajectory, bool]:
        """Return the path to a velocity; nothing has to be prepared."""
        return plan_to_velocity(motion.state, velocity_world_m_s, self.limits, tick), False


def plan_leg(leg: Leg, state: NDArray[np.float64], limits: Limits, tick: int, tick_ns: int) -> Trajectory:
    """Return the quickest path along a leg; a leg that is passed takes whole ticks."""
    if not leg.is_passed and leg.after_s is None:
        return plan_to_point(state, leg.place_world_m, limits, tick)
    step_s = tick_ns / NS_PER_S if leg.is_passed else 0.0
    return plan_to_state(state, leg.end, limits, tick, least_s=leg.after_s or 0.0, step_s=step_s)


def deviates_from_line(leg: Leg, path: Trajectory, state: NDArray[np.float64], limits: Limits) -> bool:
    """Return whether a path to rest leaves the straight line so far that the vehicle had better stop first.

    A quintic that begins in motion the wrong way continues that way for a good part of its duration: on a long leg it
    would leave the straight line by metres, where braking takes 0.75 v^2 / a. Legs that are passed or have their time
    keep to the command.

    Args:
        path: Its path from a state.
        state: (3, 3) rows position [m], velocity [m/s], acceleration [m/s^2]; world frame.
        limits: Speed and acceleration kept to.

    Held by:
        tests/unit/services/world/test_mission.py
    """
    if leg.is_passed or leg.after_s is not None:
        return False
    place_m = np.array(leg.place_world_m)
    return bool(deviates_too_far(path.coefficients, path.duration_s, place_m, state[1], limits.max_acceleration_m_s2))


def warm_up_leg_planning() -> None:
    """Plan an invented path once, so that no kernel is compiled or loaded while simulated time passes."""
    deviates_too_far(np.zeros((3, 6)), 1.0, np.zeros(3), np.ones(3), 1.0)
    polynomial_position(np.zeros((3, 6)), 1.0)
    polynomial_state(np.zeros((3, 6)), 1.0)
    elementary.acos(1.0)


@dataclass(frozen=True, kw_only=True)
class RoverPlanner:
    """Plans for vehicles that move along their heading; heights of places and velocities are left out."""

    limits: Limits
    tick_ns: int
    max_yaw_rate_rad_s: float

    def along(self, leg: Leg, motion: MotionState, tick: int) -> tuple[Trajectory, bool]:
        """Return the path along a leg, or the stop or turn that has to come before it."""
        leg = _on_ground(leg, float(motion.state[0, 2]))
        if distance(leg.place_world_m, motion.state[0]) < _GOAL_TOLERANCE_M and not leg.is_passed:
            return self._stop(motion, tick), False
        path = plan_leg(leg, motion.state, self.limits, tick, self.tick_ns)
        if deviates_from_line(leg, path, motion.state, self.limits):
            return self._stop(motion, tick), True
        return self._prepared(path, motion, tick)

    def at_velocity(self, velocity_world_m_s: Vec3, motion: MotionState, tick: int) -> tuple[Trajectory, bool]:
        """Return the path to a velocity, or the stop or turn that has to come before it."""
        u, v, _ = velocity_world_m_s
        path = plan_to_velocity(motion.state, (u, v, 0.0), self.limits, tick)
        return (path, False) if (u, v) == (0.0, 0.0) else self._prepared(path, motion, tick)

    def _prepared(self, path: Trajectory, motion: MotionState, tick: int) -> tuple[Trajectory, bool]:
        # At the very start a path from rest has no direction yet.
        velocity: NDArray[np.float64] = path.state_after(0.05 * path.duration_s)[1]
        direction_rad = elementary.atan2(float(velocity[1]), float(velocity[0]))
        off_rad = abs(math.remainder(direction_rad - motion.yaw_rad, 2 * math.pi))
        is_standing = norm3(*motion.state[1]) < _STANDSTILL_SPEED_M_S
        if off_rad <= (MIN_TURN_RAD if is_standing else MIN_STOP_TURN_RAD):
            return path, False
        if not is_standing:
            return self._stop(motion, tick), True
        duration_s = off_rad / self.max_yaw_rate_rad_s + TURN_SETTLING_S
        turn = plan_rest(to_vec3(motion.state[0]), tick, duration_s=duration_s)
        return replace(turn, heading=Heading(yaw_rad=direction_rad)), True

    def _stop(self, motion: MotionState, tick: int) -> Trajectory:
        return plan_to_velocity(motion.state, AT_REST, self.limits, tick)


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
