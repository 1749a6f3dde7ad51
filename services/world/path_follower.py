"""Path follower of one vehicle: path, velocity or setpoint in effect, legs ahead, arrival, and overturning."""

from collections import deque
from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Literal

import numpy as np

from gslcosim.base.quantities import Vec3
from gslcosim.base.scalar_kernels import distance, norm3, scalar_kernel
from gslcosim.base.ticks import seconds_from_ticks, ticks_from_seconds
from gslcosim_services.world.flight_space import FlightSpace
from gslcosim_services.world.leg_planners import AT_REST, FlightPlanner, Leg, LegPlanner, MotionState, RoverPlanner
from gslcosim_services.world.trajectory import UNCHANGED_HEADING, Heading, Trajectory, plan_rest, plan_to_velocity
from gslcosim_services.world.vehicle_records import Setpoint, VehicleCapabilities

# Tolerances of an arrival at a waypoint, and the longest time for it after the end of the trajectory.
ARRIVAL_RADIUS_M = 0.15
ARRIVAL_SPEED_M_S = 0.2
ARRIVAL_TIMEOUT_S = 10.0
BACK_OFF_M = 0.1
# A vehicle that lies on its side or back this long, and hardly moves, will not get up.
OVERTURNED_COSINE = 0.3
OVERTURNED_AFTER_S = 1.0
OVERTURNED_NOTICE = "vehicle: expected to stand upright, was lying on its side or back; it cannot move any more."


class PathFollower:
    """Path follower of one vehicle, without tasks, phases and obstacles; see `autopilot`.

    State: the trajectory and the setpoint that counts instead of it; the leg under way, those ahead and the place they
    lead to, or else the velocity that is kept; whether the path only prepares for it, and since which tick; and the
    true position, velocity and heading at the end of the last tick.
    """

    def __init__(self, abilities: VehicleCapabilities, tick_ns: int, position_world_m: Vec3) -> None:
        """Rest at a place, world frame [m], at tick 0."""
        self._abilities = abilities
        self._tick_ns = tick_ns
        self.planner: LegPlanner = (
            RoverPlanner(limits=abilities.limits, tick_ns=tick_ns, max_yaw_rate_rad_s=abilities.max_yaw_rate_rad_s)
            if abilities.has_wheels
            else FlightPlanner(limits=abilities.limits, tick_ns=tick_ns)
        )
        self.trajectory: Trajectory = plan_rest(position_world_m, 0)
        self.setpoint: Setpoint | None = None
        self.leg: Leg | None = None
        self.ahead: deque[Leg] = deque()
        self.target_world_m: Vec3 | None = None
        self.kept_velocity_m_s: Vec3 | None = None
        self.is_preparing = False
        self.prepares_since_tick = 0
        self.position_m, self.velocity_m_s, self.yaw_rad = position_world_m, AT_REST, 0.0

    def update_state(self, position_world_m: Vec3, velocity_world_m_s: Vec3, yaw_rad: float) -> None:
        """Set the true position, world frame [m], velocity [m/s] and heading [rad] of the vehicle."""
        self.position_m, self.velocity_m_s, self.yaw_rad = position_world_m, velocity_world_m_s, yaw_rad

    @property
    def is_continuous(self) -> bool:
        """True where the motion has no end of its own: a velocity that is kept, or a setpoint."""
        return self.kept_velocity_m_s is not None or self.setpoint is not None

    @property
    def legs_to_goal(self) -> list[Leg]:
        """The bends ahead, then the leg that ends at the agent's goal; empty without a leg."""
        if self.leg is None:
            return []
        legs = [self.leg, *self.ahead]
        n_bends = next(i for i, leg in enumerate(legs) if not leg.is_bend)
        return legs[: n_bends + 1]

    def motion(self, tick: int) -> MotionState:
        """Return the motion at the end of a tick: that of the path, or under a setpoint the true one."""
        state = self.trajectory.state_at(tick, self._tick_ns)
        if self.setpoint is not None:
            state = np.array([self.position_m, self.velocity_m_s, AT_REST])
        return MotionState(state=state, yaw_rad=self.yaw_rad)

    def is_over(self, tick: int) -> bool:
        """Return whether the path has ended at the end of a tick."""
        return self.trajectory.is_over(tick, self._tick_ns)

    def late_s(self, tick: int) -> float:
        """Return the time since the end of the path at the end of a tick [s]; negative before."""
        return seconds_from_ticks(tick - self.trajectory.start_tick, self._tick_ns) - self.trajectory.duration_s

    def preparation_time_s(self, tick: int) -> float:
        """Return the time since which paths only prepare for the goal [s]."""
        return seconds_from_ticks(tick - self.prepares_since_tick, self._tick_ns)

    def plan(self, legs: Iterable[Leg]) -> None:
        """Have legs ahead, in place of those that were."""
        self.ahead = deque(legs)

    def end_leg(self) -> Leg | None:
        """Have no leg under way any more; return the one that was."""
        leg, self.leg = self.leg, None
        return leg

    def continue_at_velocity(self, velocity_m_s: Vec3) -> None:
        """Continue with the velocity [m/s] at which the last position was passed."""
        self.clear_legs()
        self.kept_velocity_m_s = velocity_m_s

    def divert(self, path: Trajectory) -> None:
        """Follow a path past other vehicles; leg or velocity remain the goal."""
        self.trajectory = path
        self.is_preparing = False

    def begin_leg(self, tick: int) -> None:
        """Follow the next of the legs ahead."""
        self.leg = self.ahead.popleft()
        self.follow_leg(tick)
        self.prepares_since_tick = tick

    def follow_leg(self, tick: int) -> None:
        """Take a path along the leg under way from where the vehicle is: at its beginning, or after a turn aside."""
        assert self.leg is not None
        if not self.is_preparing:
            self.prepares_since_tick = tick
        self.trajectory, self.is_preparing = self.planner.along(self.leg, self.motion(tick), tick)
        self.setpoint = None
        self.target_world_m = self.legs_to_goal[-1].place_world_m
        self.kept_velocity_m_s = None

    def cruise(self, tick: int, velocity_m_s: Vec3, heading: Heading) -> None:
        """Set a velocity, world frame [m/s], and keep it; a velocity kept already takes the heading alone."""
        if velocity_m_s != self.kept_velocity_m_s or self.is_preparing:
            path, self.is_preparing = self.planner.at_velocity(velocity_m_s, self.motion(tick), tick)
            self.trajectory = path if self.is_preparing else replace(path, heading=heading)
            self.prepares_since_tick = tick
        elif heading != UNCHANGED_HEADING:
            self.look(heading)
        self.clear_legs()
        self.setpoint = None
        self.kept_velocity_m_s = velocity_m_s

    def replan(self, tick: int) -> None:
        """Plan again for the same leg or velocity, after an evasion or its preparation."""
        if self.kept_velocity_m_s is not None:
            since_tick = self.prepares_since_tick
            velocity_m_s, self.kept_velocity_m_s = self.kept_velocity_m_s, None
            self.cruise(tick, velocity_m_s, UNCHANGED_HEADING)
            self.prepares_since_tick = since_tick
        elif self.leg is not None:
            self.follow_leg(tick)

    def follow_setpoint(self, tick: int, setpoint: Setpoint) -> None:
        """Follow a setpoint in place of a path."""
        self._forget_goal()
        self.setpoint = setpoint
        self.trajectory = plan_rest(self.position_m, tick)

    def stop(self, tick: int) -> None:
        """Come to rest as quickly as the limits allow.

        A stop under way is kept: planned again at every tick it would never end.
        """
        has_target, has_setpoint = self.target_world_m is not None, self.setpoint is not None
        is_stopping = is_stop_under_way(has_target, has_setpoint, self.trajectory.end_velocity_world_m_s)
        motion = self.motion(tick)
        self._forget_goal()
        if not is_stopping:
            stop = plan_to_velocity(motion.state, AT_REST, self._abilities.limits, tick)
            heading = Heading(yaw_rad=self.yaw_rad) if self._abilities.has_wheels else UNCHANGED_HEADING
            self.trajectory = replace(stop, heading=heading)

    def stand(self, tick: int) -> None:
        """Rest where the vehicle is, with nothing ahead."""
        self._forget_goal()
        self.trajectory = plan_rest(self.position_m, tick, forgets_integral=True)

    def stay(self, tick: int, place_world_m: Vec3) -> None:
        """Drop the goal and rest at a place, world frame [m]; the leg under way is still to be ended."""
        self.trajectory = plan_rest(place_world_m, tick, forgets_integral=True)
        self.ahead.clear()
        self.kept_velocity_m_s = None
        self.is_preparing = False

    def look(self, heading: Heading) -> None:
        """Change the heading alone."""
        self.trajectory = replace(self.trajectory, heading=heading, forgets_integral=False)

    def clear_legs(self) -> None:
        """Drop all legs; the path continues."""
        self.ahead.clear()
        self.leg = None
        self.target_world_m = None

    def _forget_goal(self) -> None:
        self.clear_legs()
        self.kept_velocity_m_s = None
        self.is_preparing = False
        self.setpoint = None


def check_arrival(tick: int, follower: PathFollower) -> Literal["under_way", "passed", "there", "late"]:
    """Return the progress of a vehicle on its leg at the end of a tick.

    It passes or reaches the end of its path, or has not come near it long after it should.
    """
    if not follower.is_over(tick):
        return "under_way"
    if follower.leg is not None and follower.leg.is_passed:
        return "passed"
    distance_m = distance(follower.position_m, follower.trajectory.end_world_m)
    if has_arrived(distance_m, norm3(*follower.velocity_m_s)):
        return "there"
    return "late" if is_too_late(follower.late_s(tick)) else "under_way"


@scalar_kernel
def is_stop_under_way(
    has_target: bool,  # noqa: FBT001 - a kernel
    has_setpoint: bool,  # noqa: FBT001
    end_velocity_m_s: Sequence[float],
) -> bool:
    """Return whether a vehicle comes to rest already: without a place or a setpoint, on a path (3,) to rest [m/s]."""
    is_to_rest = end_velocity_m_s[0] == 0.0 and end_velocity_m_s[1] == 0.0 and end_velocity_m_s[2] == 0.0
    return is_to_rest and not has_target and not has_setpoint


@scalar_kernel
def has_arrived(distance_m: float, speed_m_s: float) -> bool:
    """Return whether a vehicle is at the end of its path: near it [m], and slow [m/s]."""
    return distance_m <= ARRIVAL_RADIUS_M and speed_m_s < ARRIVAL_SPEED_M_S


@scalar_kernel
def is_too_late(late_s: float) -> bool:
    """Return whether a vehicle whose path has been over for a time [s] will not arrive any more."""
    return late_s >= ARRIVAL_TIMEOUT_S


@scalar_kernel
def back_off_frac(distance_m: float) -> float:
    """Return the retreat of a stuck vehicle from its goal, as a fraction of its distance from it [m]."""
    return BACK_OFF_M / distance_m if distance_m > ARRIVAL_RADIUS_M else 0.0


def back_off(tick: int, follower: PathFollower, space: FlightSpace) -> str:
    """Let a vehicle rest a little back from where it got stuck, clear of the obstacle.

    Args:
        tick: The tick that ended.
        follower: Its path follower; changed.
        space: Flight space of the vehicle.

    Returns:
        The notice for the agent.
    """
    end_m = follower.trajectory.end_world_m
    distance_m = distance(follower.position_m, end_m)
    back = back_off_frac(distance_m)
    x_m, y_m, z_m = (p + back * (p - end) for p, end in zip(follower.position_m, end_m, strict=True))
    is_free = space.refusal("back", (x_m, y_m, z_m)) is None
    follower.stay(tick, (x_m, y_m, z_m) if is_free else follower.position_m)
    return (
        f"waypoint: expected to arrive within {ARRIVAL_TIMEOUT_S:g} s of the planned time, "
        f"was still {distance_m:.2f} m away; the vehicle holds there."
    )


class OverturnDetector:
    """Detector of a vehicle that lies on its side or back and will not get up.

    State: the tick since which it lies, and whether it has been given up.
    """

    def __init__(self, tick_ns: int) -> None:
        self._patience_ticks = ticks_from_seconds(OVERTURNED_AFTER_S, tick_ns)
        self.is_overturned = False
        self._since_tick: int | None = None

    def detect_overturn(self, tick: int, uprightness: float, velocity_m_s: Vec3) -> bool:
        """Return whether the vehicle is found overturned at this tick.

        Args:
            tick: The tick that ended.
            uprightness: Cosine of the angle between the vehicle's z axis and the vertical.
            velocity_m_s: Its velocity [m/s].
        """
        if uprightness >= OVERTURNED_COSINE or norm3(*velocity_m_s) >= ARRIVAL_SPEED_M_S:
            self._since_tick = None
            return False
        if self._since_tick is None:
            self._since_tick = tick
        if self.is_overturned or tick - self._since_tick < self._patience_ticks:
            return False
        self.is_overturned = True
        return True
