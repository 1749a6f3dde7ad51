"""Tasks of an autopilot: an agent's command, parsed once, and refused where a vehicle cannot follow it."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from gslcosim.base.quantities import Vec3
from gslcosim.contract.messages import AttitudeSetpoint, Command, DriveSetpoint, RateSetpoint, Waypoint
from gslcosim.environment.vertical_clearance import is_descent_clear
from gslcosim_services.world.flight_space import FlightSpace
from gslcosim_services.world.leg_planners import AT_REST, Leg, find_curve_refusal, find_motion_refusal
from gslcosim_services.world.obstacle_avoidance import BrakingMonitor
from gslcosim_services.world.path_follower import PathFollower
from gslcosim_services.world.trajectory import UNCHANGED_HEADING, Heading, is_beyond_limit
from gslcosim_services.world.vehicle_records import Setpoint, VehicleCapabilities

# Tasks that differ only in their hold time are equal: the time counts from the start of a task.


@dataclass(frozen=True, kw_only=True)
class Noop:
    """Continue as before."""


@dataclass(frozen=True, kw_only=True)
class Abort:
    """Stop for good, after the loss of the agent."""


@dataclass(frozen=True, kw_only=True)
class Hold:
    """Stop and hold for a time [s] (absent: the scenario's), with a heading."""

    heading: Heading = UNCHANGED_HEADING
    hold_s: float | None = field(default=None, compare=False)


@dataclass(frozen=True, kw_only=True)
class GoTo:
    """Go along legs. A waypoint is one leg, and `hold_s` [s] is for its end; the legs of a mission have their own."""

    legs: tuple[Leg, ...]
    is_mission: bool
    hold_s: float | None = field(default=None, compare=False)

    def legs_with_hold(self, usual_s: float, *, is_fixed: bool = False) -> tuple[Leg, ...]:
        """Return the legs with their hold times.

        Args:
            usual_s: The vehicle's hold [s], where a waypoint has none of its own.
            is_fixed: The last leg ends with it in any case; one that is passed has no end to hold at.
        """
        if is_fixed and self.legs and not self.legs[-1].is_passed:
            return (*self.legs[:-1], replace(self.legs[-1], hold_s=usual_s))
        if self.is_mission:
            return self.legs
        hold_s = usual_s if self.hold_s is None else self.hold_s
        return tuple(replace(leg, hold_s=hold_s) for leg in self.legs)


@dataclass(frozen=True, kw_only=True)
class Cruise:
    """Set a velocity, world frame [m/s], and keep it; the agent is due after a time [s]."""

    velocity_world_m_s: Vec3
    heading: Heading
    hold_s: float | None = field(default=None, compare=False)


@dataclass(frozen=True, kw_only=True)
class DirectControl:
    """Follow a setpoint of the agent, which is due after a time [s]."""

    setpoint: Setpoint
    hold_s: float | None = field(default=None, compare=False)


@dataclass(frozen=True, kw_only=True)
class TakeOff:
    """Rise from where the vehicle has landed."""


@dataclass(frozen=True, kw_only=True)
class Land:
    """Descend to the surface below."""


Task = Noop | Abort | Hold | GoTo | Cruise | DirectControl | TakeOff | Land


def parse_command(command: Command) -> Task:
    """Return the task of a valid command."""
    heading = Heading(is_along_path=True) if command.faces_path else Heading(yaw_rad=command.yaw_rad)
    hold_s = command.hold_s
    match command.kind:
        case "noop":
            return Noop()
        case "failed":
            return Abort()
        case "hold" | "declare_source":
            return Hold(heading=heading, hold_s=hold_s)
        case "take_off":
            return TakeOff()
        case "land":
            return Land()
        case "waypoint":
            assert command.position_world_m is not None, "a Command has it with this kind"
            leg = Leg(name="waypoint", place_world_m=command.position_world_m, heading=heading)
            return GoTo(legs=(leg,), is_mission=False, hold_s=hold_s)
        case "mission":
            legs = (_parse_leg(i, point, heading) for i, point in enumerate(command.waypoints or ()))
            return GoTo(legs=tuple(legs), is_mission=True, hold_s=hold_s)
        case "velocity":
            assert command.velocity_world_m_s is not None, "a Command has it with this kind"
            return Cruise(velocity_world_m_s=command.velocity_world_m_s, heading=heading, hold_s=hold_s)
        case "attitude" | "rates" | "drive":
            setpoint = command.attitude or command.rates or command.drive
            assert setpoint is not None, "a Command has it with this kind"
            return DirectControl(setpoint=setpoint, hold_s=hold_s)


def _parse_leg(i: int, point: Waypoint, heading: Heading) -> Leg:
    return Leg(
        name=f"waypoints[{i}]",
        place_world_m=point.position_world_m,
        velocity_world_m_s=point.velocity_world_m_s,
        acceleration_world_m_s2=point.acceleration_world_m_s2,
        hold_s=point.hold_s,
        after_s=point.after_s,
        heading=heading if point.yaw_rad is None else Heading(yaw_rad=point.yaw_rad),
    )


def find_refusal(task: Task, abilities: VehicleCapabilities, space: FlightSpace, *, is_on_ground: bool) -> str | None:
    """Return why a vehicle cannot do a task, or nothing when it can.

    Args:
        task: Task of the agent.
        abilities: Abilities of the vehicle.
        space: Its flight space.
        is_on_ground: It stands with its rotors off.
    """
    match task:
        case GoTo(legs=legs):
            return _find_waypoint_refusal(legs, abilities, space)
        case Cruise(velocity_world_m_s=velocity_m_s):
            return _find_speed_refusal("velocity", velocity_m_s, abilities)
        case TakeOff():
            return _find_phase_refusal("take_off", abilities, is_on_ground=is_on_ground)
        case Land():
            return _find_phase_refusal("land", abilities, is_on_ground=is_on_ground)
        case DirectControl(setpoint=AttitudeSetpoint() as setpoint):
            return _find_setpoint_refusal("attitude", setpoint, abilities)
        case DirectControl(setpoint=RateSetpoint() as setpoint):
            return _find_setpoint_refusal("rates", setpoint, abilities)
        case DirectControl(setpoint=DriveSetpoint() as setpoint):
            return _find_drive_refusal(setpoint, abilities)
        case _:
            return None


def find_refusal_from_state(
    tick: int, task: Task, follower: PathFollower, edges: BrakingMonitor, *, rises_to_m: float | None, avoids: bool
) -> str | None:
    """Return why a vehicle cannot do a task from where it is and as it moves, or nothing.

    Args:
        tick: The tick that ended.
        task: A task that the vehicle could do somewhere.
        follower: Its path follower.
        edges: The space around it.
        rises_to_m: The height at which the task begins, after a take-off [m]; nothing in the air.
        avoids: Paths are planned, so that the commanded legs need not be free.
    """
    match task:
        case Land():
            return _find_ground_refusal(follower.position_m, edges.space, avoids=avoids)
        case GoTo(legs=legs, is_mission=True) if not avoids:
            state = follower.motion(tick).state
            if rises_to_m is not None:
                state = np.array([(*follower.position_m[:2], rises_to_m), AT_REST, AT_REST])
            return find_curve_refusal(legs, state, edges.abilities.limits, edges.space, edges.tick_ns)
        case Cruise(velocity_world_m_s=wanted_m_s) if rises_to_m is None and wanted_m_s != follower.kept_velocity_m_s:
            path, is_preparing = follower.planner.at_velocity(wanted_m_s, follower.motion(tick), tick)
            return None if is_preparing else edges.check_path(tick, path)
        case DirectControl(setpoint=DriveSetpoint(speed_m_s=speed_m_s)):
            return edges.check_drive_speed(tick, follower, speed_m_s)
        case _:
            return None


# Level ground as wide as the vehicle, and with avoidance nothing above it.
def _find_ground_refusal(position_world_m: Vec3, space: FlightSpace, *, avoids: bool) -> str | None:
    x_m, y_m, z_m = position_world_m
    corners = [(x_m + i * space.radius_m, y_m + j * space.radius_m, z_m) for i in (-1, 1) for j in (-1, 1)]
    heights_m = {space.support_height_m(corner) for corner in (position_world_m, *corners)}
    if max(heights_m) - min(heights_m) < 1e-6:
        if not avoids or is_descent_clear(space.room, space.radius_m, position_world_m, max(heights_m)):
            return None
        return f"land: expected a free way down from ({x_m:.2f}, {y_m:.2f}, {z_m:.2f}) m, was something solid in it."
    return (
        f"land: expected level ground within {space.radius_m:g} m of ({x_m:.2f}, {y_m:.2f}), "
        f"was {min(heights_m):g} to {max(heights_m):g} m high."
    )


def _find_waypoint_refusal(legs: Sequence[Leg], abilities: VehicleCapabilities, space: FlightSpace) -> str | None:
    for leg in legs:
        refusal = space.find_waypoint_refusal(leg.name, leg.place_world_m) or find_motion_refusal(leg, abilities.limits)
        if refusal is not None:
            return refusal
    return None


def _find_speed_refusal(name: str, velocity_m_s: tuple[float, ...], abilities: VehicleCapabilities) -> str | None:
    speed_m_s, most_m_s = math.sqrt(sum(v * v for v in velocity_m_s)), abilities.limits.max_speed_m_s
    if is_beyond_limit(speed_m_s, most_m_s):
        return f"{name}: expected at most {most_m_s:g} m/s, was {speed_m_s:g} m/s."
    return None


def _find_phase_refusal(kind: str, abilities: VehicleCapabilities, *, is_on_ground: bool) -> str | None:
    if abilities.has_wheels:
        return f"{kind}: expected a vehicle that flies, was a {abilities.name}."
    if kind == "take_off" and not is_on_ground:
        return "take_off: expected a vehicle that has landed, was in the air."
    if kind == "land" and is_on_ground:
        return "land: expected a vehicle in the air, was on the ground."
    return None


def _find_setpoint_refusal(
    name: str, setpoint: AttitudeSetpoint | RateSetpoint, abilities: VehicleCapabilities
) -> str | None:
    if not abilities.has_rotors:
        return f"{name}: expected a vehicle with rotors, was a {abilities.name}."
    if setpoint.thrust_n is not None and setpoint.thrust_n > abilities.max_thrust_n:
        return f"{name}.thrust_n: expected at most {abilities.max_thrust_n:.4g} N, was {setpoint.thrust_n:g} N."
    return _find_speed_refusal(f"{name}.climb_m_s", (setpoint.climb_m_s,), abilities)


def _find_drive_refusal(setpoint: DriveSetpoint, abilities: VehicleCapabilities) -> str | None:
    if not abilities.has_wheels:
        return f"drive: expected a vehicle on wheels, was a {abilities.name}."
    most_rad_s = abilities.max_yaw_rate_rad_s
    if abs(setpoint.yaw_rate_rad_s) > most_rad_s:
        return f"drive.yaw_rate_rad_s: expected at most {most_rad_s:g} rad/s, was {setpoint.yaw_rate_rad_s:g} rad/s."
    return _find_speed_refusal("drive.speed_m_s", (setpoint.speed_m_s,), abilities)
