"""Obstacle avoidance: detours around solids as legs that keep clear, and braking before edges and obstacles."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from gslcosim.base import elementary
from gslcosim.base.quantities import Vec3
from gslcosim.base.scalar_kernels import distance, norm2, norm3
from gslcosim.base.ticks import NS_PER_S
from gslcosim_services.world.flight_space import FlightSpace, RoutePlanner
from gslcosim_services.world.leg_planners import AT_REST, Leg, deviates_from_line, plan_leg
from gslcosim_services.world.path_follower import PathFollower
from gslcosim_services.world.trajectory import Limits, Trajectory, plan_to_velocity, to_vec3
from gslcosim_services.world.vehicle_records import VehicleCapabilities

# Fractions of the speed that a corner's legs allow; the first that keeps clear is taken, else the vehicle stops.
_CORNER_SPEED_FRACTIONS = (1.0, 0.5, 0.25)
# Corners sharper than this are stopped at [rad].
_MAX_PASSED_TURN_RAD = 2.0
_MIN_MOVING_SPEED_M_S = 1e-3
# Number of moved places of a mission that are reported one by one.
_MAX_NOTICES = 3
# Nearer than this two places are the same [m].
_MIN_DISTANCE_M = 1e-6


@dataclass(frozen=True, kw_only=True)
class DetourPlan:
    """Legs to follow; with a notice about a moved place. Without legs the notice gives the reason for no way."""

    legs: tuple[Leg, ...] = ()
    notice: str | None = None


class _NoRouteError(Exception):
    """There is no way to a place; the text is for the agent. Never leaves this module."""


@dataclass(frozen=True, kw_only=True)
class ObstacleAvoidance:
    """Plans the legs of one vehicle around obstacles.

    A leg whose path keeps clear stays as it is. Otherwise it is split at bends, which a vehicle in the air passes
    without a stop where the curve keeps clear; on wheels it stops and turns.
    """

    routes: RoutePlanner
    limits: Limits
    tick_ns: int
    has_wheels: bool

    def plan(self, legs: Sequence[Leg], state: NDArray[np.float64]) -> DetourPlan:
        """Return the legs that keep clear, or why there are none.

        Args:
            legs: Legs of the agent's command.
            state: (3, 3) rows position [m], velocity [m/s], acceleration [m/s^2] from which they begin; world frame.
        """
        planned: list[Leg] = []
        notices: list[str] = []
        try:
            for leg in legs:
                moved, notice = self._moved(leg, to_vec3(state[0]))
                notices += [notice] if notice else []
                planned += self._legs_to(moved, state)
                state = planned[-1].end
        except _NoRouteError as reason:
            return DetourPlan(notice=str(reason))
        n_more = len(notices) - _MAX_NOTICES
        if n_more > 0:
            notices[_MAX_NOTICES:] = [f"{n_more} more places are moved."]
        return DetourPlan(legs=tuple(planned), notice=" ".join(notices) or None)

    def is_line_clear(self, a_m: Vec3, b_m: Vec3) -> bool:
        """Return whether the straight way between two places, world frame [m], keeps clear."""
        return self.routes.free.sees(a_m, b_m)

    def find_stop_refusal(self, name: str, state: NDArray[np.float64], stop: Trajectory) -> str | None:
        """Return why a vehicle must brake now that would come to rest on a path, or nothing while that keeps clear.

        A vehicle that is too near to an obstacle already may move to the nearest free place, and nowhere else.

        Args:
            name: Reason for the stop, for the text.
            state: (3, 3) rows position [m], velocity [m/s], acceleration [m/s^2] where it would begin to brake.
            stop: The path on which it would come to rest.
        """
        here_m = self.routes.level(to_vec3(state[0]))
        if not _is_moving(state) or (self._is_clear(stop) if self.routes.is_free(here_m) else self._leaves(state)):
            return None
        return (
            f"{name}: expected a stop at least {self.routes.clearance_m:.2f} m from obstacles, "
            f"was heading for {_format_point(stop.end_world_m)} m."
        )

    def _leaves(self, state: NDArray[np.float64]) -> bool:
        here_m = self.routes.level(to_vec3(state[0]))
        free_m = self.routes.nearest_free_m(here_m)
        return free_m is not None and sum(((np.subtract(free_m, here_m)) * state[1]).tolist()) > 0.0

    # A place that is too near to something becomes the nearest one outside that the vehicle can reach.
    def _moved(self, leg: Leg, from_m: Vec3) -> tuple[Leg, str | None]:
        place_m = self.routes.level(leg.place_world_m)
        if self.routes.is_free(place_m):
            return replace(leg, place_world_m=place_m), None
        outside_m = self.routes.nearest_reachable_m(place_m, from_m)
        if outside_m is None:
            raise _NoRouteError(
                f"{leg.name}: expected a place that can be reached, was {_format_point(place_m)} m; none is near."
            )
        return replace(leg, place_world_m=outside_m), (
            f"{leg.name}: expected a place at least {self.routes.clearance_m:.2f} m from obstacles, "
            f"was {_format_point(place_m)} m; goes to {_format_point(outside_m)} m instead."
        )

    def _legs_to(self, leg: Leg, state: NDArray[np.float64]) -> list[Leg]:
        if self._is_direct(leg, state) and not (self.has_wheels and _is_moving(state)):
            return [leg]
        before = self._stopped(leg, state)
        start_m = before[-1].place_world_m if before else to_vec3(state[0])
        points_m = self.routes.route_m(start_m, leg.place_world_m)
        if points_m is None:
            place = f"was {_format_point(leg.place_world_m)} m without a way to it"
            raise _NoRouteError(f"{leg.name}: expected a place that can be reached, {place}; the vehicle holds.")
        return before + self._along(leg, points_m)

    # A moving vehicle comes to rest first: the way around begins there.
    def _stopped(self, leg: Leg, state: NDArray[np.float64]) -> list[Leg]:
        if not _is_moving(state):
            return []
        stop_m = plan_to_velocity(state, AT_REST, self.limits, 0).end_world_m
        return [_bend_leg(leg, self.routes.level(stop_m))]

    def _along(self, leg: Leg, points_m: list[Vec3]) -> list[Leg]:
        legs: list[Leg] = []
        state, left_s = np.array([points_m[0], AT_REST, AT_REST]), leg.after_s
        for i, place_m in enumerate(points_m[1:-1], start=1):
            bend = self._corner(_bend_leg(leg, place_m), state, points_m[i - 1], points_m[i + 1])
            path, state = self._path(bend, state), bend.end
            left_s = None if left_s is None else max(0.0, left_s - path.duration_s)
            legs.append(bend)
        last = replace(leg, after_s=left_s)
        if leg.is_passed and not self._is_clear(self._path(last, state)):
            found = f"was passed at {norm3(*leg.velocity_world_m_s):g} m/s"
            raise _NoRouteError(
                f"{leg.name}: expected a way that keeps clear of obstacles, {found}; the vehicle holds."
            )
        return [*legs, last]

    # From a corner that is passed the vehicle must still be able to stop at the next one.
    def _corner(self, bend: Leg, state: NDArray[np.float64], before_m: Vec3, after_m: Vec3) -> Leg:
        into, out_of = (_direction(a, b) for a, b in pairwise((before_m, bend.place_world_m, after_m)))
        turn_rad = elementary.acos(min(max(sum((into * out_of).tolist()), -1.0), 1.0))
        if self.has_wheels or turn_rad > _MAX_PASSED_TURN_RAD:
            return bend
        shortest_m = min(distance(before_m, bend.place_world_m), distance(bend.place_world_m, after_m))
        most_m_s = min(self.limits.max_speed_m_s, math.sqrt(self.limits.max_acceleration_m_s2 * shortest_m))
        tangent = _direction((0.0, 0.0, 0.0), to_vec3(into + out_of))
        for share in _CORNER_SPEED_FRACTIONS:
            passed = replace(bend, velocity_world_m_s=to_vec3(0.999 * share * most_m_s * tangent))
            onward = replace(bend, place_world_m=after_m)
            if self._is_direct(passed, state) and self._is_direct(onward, passed.end):
                return passed
        return bend

    def _path(self, leg: Leg, state: NDArray[np.float64]) -> Trajectory:
        return plan_leg(leg, state, self.limits, 0, self.tick_ns)

    def _is_direct(self, leg: Leg, state: NDArray[np.float64]) -> bool:
        path = self._path(leg, state)
        return self._is_clear(path) and not deviates_from_line(leg, path, state, self.limits)

    def _is_clear(self, path: Trajectory) -> bool:
        speed_m_s = self.limits.max_speed_m_s
        return self.routes.free.holds_curve(path.coefficients, path.duration_s, max_speed_m_s=speed_m_s)


def _bend_leg(leg: Leg, place_m: Vec3) -> Leg:
    return Leg(name=leg.name, place_world_m=place_m, heading=leg.heading, is_bend=True)


def _is_moving(state: NDArray[np.float64]) -> bool:
    return norm3(*state[1].tolist()) > _MIN_MOVING_SPEED_M_S


def _direction(a_m: Vec3, b_m: Vec3) -> NDArray[np.float64]:
    step_m = np.subtract(b_m, a_m)
    return step_m / max(_MIN_DISTANCE_M, distance(a_m, b_m))


def _format_point(place_m: Vec3) -> str:
    return "(" + ", ".join(f"{value:.4g}" for value in place_m) + ")"


@dataclass(frozen=True, kw_only=True)
class BrakingMonitor:
    """Braking monitor: checks where a vehicle would come to rest if it began to brake a tick later.

    It brakes before the room ends and before it would stop in a solid; with avoidance also before it would come too
    near to one.
    """

    space: FlightSpace
    abilities: VehicleCapabilities
    tick_ns: int
    avoidance: ObstacleAvoidance | None

    def ahead(self, tick: int, follower: PathFollower) -> str | None:
        """Return why the vehicle must brake now, or nothing.

        An agent that sets attitude or rates is responsible for obstacles; wheels are stopped.
        """
        if follower.setpoint is None:
            return self.check_path(tick, follower.trajectory)
        if self.abilities.has_wheels:
            return self._ahead_of_wheels(tick, follower.position_m, follower.velocity_m_s)
        return None

    def check_path(self, tick: int, path: Trajectory) -> str | None:
        """Return why a vehicle on a path must brake now, or nothing."""
        state = path.state_at(tick + 1, self.tick_ns)
        stop = plan_to_velocity(state, AT_REST, self._limits, tick)
        edge = self.space.find_edge_ahead("velocity", stop.end_world_m, to_vec3(state[1]))
        if edge is not None or self.avoidance is None:
            return edge
        return self.avoidance.find_stop_refusal("velocity", state, stop)

    def check_drive_speed(self, tick: int, follower: PathFollower, speed_m_s: float) -> str | None:
        """Return why wheels cannot reach a speed [m/s] from their present turn, or nothing."""
        direction = (elementary.cos(follower.yaw_rad), elementary.sin(follower.yaw_rad))
        now_m_s = follower.velocity_m_s[0] * direction[0] + follower.velocity_m_s[1] * direction[1]
        change_m_s = self._limits.max_acceleration_m_s2 * self.tick_ns / NS_PER_S
        next_m_s = min(max(speed_m_s, now_m_s - change_m_s), now_m_s + change_m_s)
        velocity_m_s = (next_m_s * direction[0], next_m_s * direction[1], 0.0)
        return self._ahead_of_wheels(tick, follower.position_m, velocity_m_s)

    # The braking begins from the wheels' present motion, which is in no path.
    def _ahead_of_wheels(self, tick: int, position_m: Vec3, velocity_m_s: Vec3) -> str | None:
        u, v, _ = velocity_m_s
        # A stop takes 1.5 v/a, on average at half the speed; see `set_quartic_to_velocity_inplace`.
        braking_s = 0.75 * norm2(u, v) / self._limits.max_acceleration_m_s2 + self.tick_ns / NS_PER_S
        x_m, y_m, z_m = position_m
        edge = self.space.find_edge_ahead("drive", (x_m + braking_s * u, y_m + braking_s * v, z_m), (u, v, 0.0))
        if edge is not None or self.avoidance is None:
            return edge
        tick_s = self.tick_ns / NS_PER_S
        state = np.array([(x_m + tick_s * u, y_m + tick_s * v, z_m), (u, v, 0.0), AT_REST])
        return self.avoidance.find_stop_refusal("drive", state, plan_to_velocity(state, AT_REST, self._limits, tick))

    @property
    def _limits(self) -> Limits:
        return self.abilities.limits
