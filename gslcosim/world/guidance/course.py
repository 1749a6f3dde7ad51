"""What a vehicle follows: a path along legs, a path at a velocity, or a setpoint of its agent; and the legs ahead."""

from collections import deque
from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from gslcosim.quantities import Vec3
from gslcosim.ticks import seconds_from_ticks
from gslcosim.world.guidance.abilities import Abilities
from gslcosim.world.paths.legs import AT_REST, FlightPlanner, Leg, Motion, Planner
from gslcosim.world.paths.rover_paths import RoverPlanner
from gslcosim.world.paths.trajectory import AS_BEFORE, Heading, Trajectory, fly_at, stay_at
from gslcosim.world.physics.records import Setpoint


class Course:
    """The course of one vehicle. It knows nothing of tasks, phases and obstacles; see `conduct`.

    State: the trajectory and the setpoint that counts instead of it; the leg under way, those ahead and the place they
    lead to, or else the velocity that is kept; whether the path only prepares for it, and since which tick; and the
    true position, velocity and heading at the end of the last tick.
    """

    def __init__(self, abilities: Abilities, tick_ns: int, position_world_m: Vec3) -> None:
        """Rest at a place, world frame [m], at tick 0."""
        self._abilities = abilities
        self._tick_ns = tick_ns
        self.planner: Planner = (
            RoverPlanner(limits=abilities.limits, tick_ns=tick_ns, max_yaw_rate_rad_s=abilities.max_yaw_rate_rad_s)
            if abilities.has_wheels
            else FlightPlanner(limits=abilities.limits, tick_ns=tick_ns)
        )
        self.trajectory: Trajectory = stay_at(position_world_m, 0)
        self.setpoint: Setpoint | None = None
        self.leg: Leg | None = None
        self.ahead: deque[Leg] = deque()
        self.target_world_m: Vec3 | None = None
        self.kept_velocity_m_s: Vec3 | None = None
        self.is_preparing = False
        self.prepares_since_tick = 0
        self.position_m, self.velocity_m_s, self.yaw_rad = position_world_m, AT_REST, 0.0

    def saw(self, position_world_m: Vec3, velocity_world_m_s: Vec3, yaw_rad: float) -> None:
        """Take note of where the vehicle truly is, world frame [m], how it moves [m/s] and looks [rad]."""
        self.position_m, self.velocity_m_s, self.yaw_rad = position_world_m, velocity_world_m_s, yaw_rad

    @property
    def goes_on(self) -> bool:
        """Whether it ends nowhere by itself: a velocity that is kept, or a setpoint."""
        return self.kept_velocity_m_s is not None or self.setpoint is not None

    @property
    def legs_to_goal(self) -> list[Leg]:
        """The bends ahead, then the leg that ends where the agent wants to be; empty without a leg."""
        if self.leg is None:
            return []
        legs = [self.leg, *self.ahead]
        n_bends = next(i for i, leg in enumerate(legs) if not leg.is_bend)
        return legs[: n_bends + 1]

    def motion(self, tick: int) -> Motion:
        """Return how the vehicle moves at the end of a tick: as its path says, with a setpoint as it truly does."""
        state = self.trajectory.state_at(tick, self._tick_ns)
        if self.setpoint is not None:
            state = np.array([self.position_m, self.velocity_m_s, AT_REST])
        return Motion(state=state, yaw_rad=self.yaw_rad)

    def is_over(self, tick: int) -> bool:
        """Return whether the path has ended at the end of a tick."""
        return self.trajectory.is_over(tick, self._tick_ns)

    def late_s(self, tick: int) -> float:
        """Return for how long the path has been over at the end of a tick [s]; negative before."""
        return seconds_from_ticks(tick - self.trajectory.start_tick, self._tick_ns) - self.trajectory.duration_s

    def prepares_for_s(self, tick: int) -> float:
        """Return since when paths only prepare for what is wanted [s]."""
        return seconds_from_ticks(tick - self.prepares_since_tick, self._tick_ns)

    def plan(self, legs: Iterable[Leg]) -> None:
        """Have legs ahead, in place of those that were."""
        self.ahead = deque(legs)

    def end_leg(self) -> Leg | None:
        """Have no leg under way any more; return the one that was."""
        leg, self.leg = self.leg, None
        return leg

    def pass_on(self, velocity_m_s: Vec3) -> None:
        """Go on with the velocity [m/s] at which the last place was passed."""
        self.forget_legs()
        self.kept_velocity_m_s = velocity_m_s

    def go_aside(self, path: Trajectory) -> None:
        """Take a path out of the way of others; leg or velocity are still wanted."""
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
        """Take a velocity, world frame [m/s], and keep it; what is kept already only takes the heading."""
        if velocity_m_s != self.kept_velocity_m_s or self.is_preparing:
            path, self.is_preparing = self.planner.at_velocity(velocity_m_s, self.motion(tick), tick)
            self.trajectory = path if self.is_preparing else replace(path, heading=heading)
            self.prepares_since_tick = tick
        elif heading != AS_BEFORE:
            self.look(heading)
        self.forget_legs()
        self.setpoint = None
        self.kept_velocity_m_s = velocity_m_s

    def take_again(self, tick: int) -> None:
        """Plan anew for the same leg or velocity, after an evasion or what prepared for it."""
        if self.kept_velocity_m_s is not None:
            since_tick = self.prepares_since_tick
            velocity_m_s, self.kept_velocity_m_s = self.kept_velocity_m_s, None
            self.cruise(tick, velocity_m_s, AS_BEFORE)
            self.prepares_since_tick = since_tick
        elif self.leg is not None:
            self.follow_leg(tick)

    def hand_over(self, tick: int, setpoint: Setpoint) -> None:
        """Obey a setpoint instead of a path."""
        self._forget_goal()
        self.setpoint = setpoint
        self.trajectory = stay_at(self.position_m, tick)

    def stop(self, tick: int) -> None:
        """Come to rest as quickly as the limits allow.

        A stop under way is kept: planned anew at every tick it would never end.
        """
        is_stopping = (
            self.target_world_m is None and self.trajectory.end_velocity_world_m_s == AT_REST and self.setpoint is None
        )
        motion = self.motion(tick)
        self._forget_goal()
        if not is_stopping:
            stop = fly_at(motion.state, AT_REST, self._abilities.limits, tick)
            heading = Heading(yaw_rad=self.yaw_rad) if self._abilities.has_wheels else AS_BEFORE
            self.trajectory = replace(stop, heading=heading)

    def stand(self, tick: int) -> None:
        """Rest where the vehicle is, with nothing ahead."""
        self._forget_goal()
        self.trajectory = stay_at(self.position_m, tick, forgets_integral=True)

    def stay(self, tick: int, place_world_m: Vec3) -> None:
        """Give up what was wanted and rest at a place, world frame [m]; the leg under way is still to be ended."""
        self.trajectory = stay_at(place_world_m, tick, forgets_integral=True)
        self.ahead.clear()
        self.kept_velocity_m_s = None
        self.is_preparing = False

    def look(self, heading: Heading) -> None:
        """Change only where the vehicle looks."""
        self.trajectory = replace(self.trajectory, heading=heading, forgets_integral=False)

    def forget_legs(self) -> None:
        """Have no legs any more; the path goes on."""
        self.ahead.clear()
        self.leg = None
        self.target_world_m = None

    def _forget_goal(self) -> None:
        self.forget_legs()
        self.kept_velocity_m_s = None
        self.is_preparing = False
        self.setpoint = None
