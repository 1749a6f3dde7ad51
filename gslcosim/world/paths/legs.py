"""From what an agent asks for to the legs of a flight, and from a leg to the path that a vehicle follows."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from gslcosim.quantities import Vec3
from gslcosim.ticks import NS_PER_S
from gslcosim.world.paths.space import FlightSpace
from gslcosim.world.paths.trajectory import AS_BEFORE, Heading, Limits, Trajectory, fly_at, fly_through, fly_to
from gslcosim.world.paths.trajectory_kernels import allowed_aside_m, farthest_aside_m

AT_REST: Vec3 = (0.0, 0.0, 0.0)
# Shares of a path's duration at which it is looked at.
_LOOKS_AT = np.linspace(0.1, 1.0, 10).tolist()


@dataclass(frozen=True, kw_only=True)
class Leg:
    """The way to one place: to rest there, or to pass it with a velocity and an acceleration, world frame.

    `name` is what refusals call it; `hold_s` counts only where it rests; `after_s` is the least time for it;
    `is_bend` says that it is only on the way to where the agent sent the vehicle.
    """

    name: str
    place_world_m: Vec3
    velocity_world_m_s: Vec3 = AT_REST
    acceleration_world_m_s2: Vec3 = AT_REST
    hold_s: float = 0.0
    after_s: float | None = None
    heading: Heading = AS_BEFORE
    is_bend: bool = False

    @property
    def is_passed(self) -> bool:
        """Whether the vehicle does not stop at its end."""
        return any(self.velocity_world_m_s)

    @property
    def end(self) -> NDArray[np.float64]:
        """(3, 3) rows position [m], velocity [m/s], acceleration [m/s^2] at its end; world frame."""
        return np.array([self.place_world_m, self.velocity_world_m_s, self.acceleration_world_m_s2])


def refusal_of_motion(leg: Leg, limits: Limits) -> str | None:
    """Return why a leg's end cannot be passed as it says, or nothing."""
    for name, vector, most, unit in (
        ("velocity", leg.velocity_world_m_s, limits.max_speed_m_s, "m/s"),
        ("acceleration", leg.acceleration_world_m_s2, limits.max_acceleration_m_s2, "m/s^2"),
    ):
        size = math.hypot(*vector)
        if size > most * (1 + 1e-9):
            return f"{leg.name}.{name}: expected at most {most:g} {unit}, was {size:g} {unit}."
    if leg.hold_s and leg.is_passed:
        return f"{leg.name}.hold_s: expected 0 where the vehicle passes with a velocity, was {leg.hold_s:g} s."
    return None


def refusal_of_curves(
    legs: Sequence[Leg], state: NDArray[np.float64], limits: Limits, space: FlightSpace, tick_ns: int
) -> str | None:
    """Return why legs that begin or end in motion cannot be flown, or nothing: their paths leave the straight line.

    Args:
        legs: The legs, one after the other.
        state: (3, 3) rows position [m], velocity [m/s], acceleration [m/s^2] at their start; world frame.
        limits: Speed and acceleration kept to.
        space: Where the vehicle may be sent.
        tick_ns: Length of a tick [ns].
    """
    for leg in legs:
        path = plan_leg(leg, state, limits, 0, tick_ns)
        if leg.is_passed or np.any(state[1]):
            for share in _LOOKS_AT:
                x_m, y_m, z_m = path.state_after(share * path.duration_s)[0].tolist()
                refusal = space.refusal(f"{leg.name}: path to it", (x_m, y_m, z_m))
                if refusal is not None:
                    return refusal
        state = leg.end
    return None


@dataclass(frozen=True, kw_only=True)
class Motion:
    """How a vehicle moves at the end of a tick: its reference as (3, 3) state, and its true heading [rad]."""

    state: NDArray[np.float64]
    yaw_rad: float


class Planner(Protocol):
    """Plans paths of one kind of vehicle; a path that only prepares is followed by another plan to the same end."""

    def along(self, leg: Leg, motion: Motion, tick: int) -> tuple[Trajectory, bool]:
        """Return the path along a leg, and whether it only prepares for it."""
        ...

    def at_velocity(self, velocity_world_m_s: Vec3, motion: Motion, tick: int) -> tuple[Trajectory, bool]:
        """Return the path to a velocity, and whether it only prepares for it."""
        ...


@dataclass(frozen=True, kw_only=True)
class FlightPlanner:
    """Plans for vehicles that can accelerate in any direction."""

    limits: Limits
    tick_ns: int

    def along(self, leg: Leg, motion: Motion, tick: int) -> tuple[Trajectory, bool]:
        """Return the path along a leg, or the stop that has to come before it where it would swing out."""
        path = plan_leg(leg, motion.state, self.limits, tick, self.tick_ns)
        if swings_out(leg, path, motion.state, self.limits):
            return replace(fly_at(motion.state, AT_REST, self.limits, tick), heading=leg.heading), True
        return replace(path, heading=leg.heading), False

    def at_velocity(self, velocity_world_m_s: Vec3, motion: Motion, tick: int) -> tuple[Trajectory, bool]:
        """Return the path to a velocity; nothing has to be prepared."""
        return fly_at(motion.state, velocity_world_m_s, self.limits, tick), False


def plan_leg(leg: Leg, state: NDArray[np.float64], limits: Limits, tick: int, tick_ns: int) -> Trajectory:
    """Return the quickest path along a leg; a leg that is passed takes whole ticks."""
    if not leg.is_passed and leg.after_s is None:
        return fly_to(state, leg.place_world_m, limits, tick)
    step_s = tick_ns / NS_PER_S if leg.is_passed else 0.0
    return fly_through(state, leg.end, limits, tick, least_s=leg.after_s or 0.0, step_s=step_s)


def swings_out(leg: Leg, path: Trajectory, state: NDArray[np.float64], limits: Limits) -> bool:
    """Return whether a path to rest goes so far aside that the vehicle had better stop first.

    A quintic that begins in motion the wrong way goes on that way for a good part of its duration: on a long leg it
    would leave the straight line by metres, where braking takes 0.75 v^2 / a. Legs that are passed or have their time
    are flown as they are said.

    Args:
        leg: The leg.
        path: Its path from a state.
        state: (3, 3) rows position [m], velocity [m/s], acceleration [m/s^2]; world frame.
        limits: Speed and acceleration kept to.

    Held by:
        tests/unit/world/guidance/test_mission.py
    """
    speed_m_s = float(np.linalg.norm(state[1]))
    if leg.is_passed or leg.after_s is not None or speed_m_s == 0.0:
        return False
    aside_m = farthest_aside_m(path.coefficients, path.duration_s, np.array(leg.place_world_m))
    return bool(aside_m > allowed_aside_m(speed_m_s, limits.max_acceleration_m_s2))


def rehearse_legs() -> None:
    """Look once at a made-up path, so that no kernel is compiled or loaded while simulated time passes."""
    allowed_aside_m(1.0, 1.0)
    farthest_aside_m(np.zeros((3, 6)), 1.0, np.zeros(3))
