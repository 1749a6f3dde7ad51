"""Tasks of an autopilot: an agent's command, parsed once."""

from dataclasses import dataclass, field, replace

from gslcosim.base.quantities import Vec3
from gslcosim.contract.messages import Command, Waypoint
from gslcosim_services.world.paths.leg_planners import Leg
from gslcosim_services.world.paths.trajectory import UNCHANGED_HEADING, Heading
from gslcosim_services.world.physics.vehicle_records import Setpoint

# Tasks that differ only in how long to hold are the same: the time counts from when a task is taken up.


@dataclass(frozen=True, kw_only=True)
class Noop:
    """Continue as before."""


@dataclass(frozen=True, kw_only=True)
class Abort:
    """Stop for good: the agent is gone."""


@dataclass(frozen=True, kw_only=True)
class Hold:
    """Stop and hold for a time [s] (absent: as the scenario says), looking somewhere."""

    heading: Heading = UNCHANGED_HEADING
    hold_s: float | None = field(default=None, compare=False)


@dataclass(frozen=True, kw_only=True)
class GoTo:
    """Go along legs. A waypoint is one leg, and `hold_s` [s] is for its end; the legs of a mission have their own."""

    legs: tuple[Leg, ...]
    is_mission: bool
    hold_s: float | None = field(default=None, compare=False)

    def legs_with_hold(self, usual_s: float) -> tuple[Leg, ...]:
        """Return the legs with their hold times [s]: `usual_s` where a waypoint has none of its own."""
        if self.is_mission:
            return self.legs
        hold_s = usual_s if self.hold_s is None else self.hold_s
        return tuple(replace(leg, hold_s=hold_s) for leg in self.legs)


@dataclass(frozen=True, kw_only=True)
class Cruise:
    """Take a velocity, world frame [m/s], and keep it; the agent is asked after a time [s]."""

    velocity_world_m_s: Vec3
    heading: Heading
    hold_s: float | None = field(default=None, compare=False)


@dataclass(frozen=True, kw_only=True)
class DirectControl:
    """Follow a setpoint of the agent; it is asked after a time [s]."""

    setpoint: Setpoint
    hold_s: float | None = field(default=None, compare=False)


@dataclass(frozen=True, kw_only=True)
class TakeOff:
    """Rise from where the vehicle has landed."""


@dataclass(frozen=True, kw_only=True)
class Land:
    """Come down to what is below."""


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
