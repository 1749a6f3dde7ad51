"""What one vehicle is doing: take off, go to waypoints, hold, land, ask the agent; a state machine over the control."""

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import replace
from typing import Literal

import numpy as np

from gslcosim.contract.messages import Command
from gslcosim.scenario.models import AgentSpec
from gslcosim.ticks import NS_PER_S, seconds_from_ticks, ticks_from_seconds
from gslcosim.world.abilities import Abilities
from gslcosim.world.avoidance import Avoidance
from gslcosim.world.legs import AT_REST, FlightPlanner, Leg, Motion, Planner, heading_of, legs_of, refusal_of_curves
from gslcosim.world.records import Setpoint
from gslcosim.world.refusals import refusal_of, refusal_of_ground
from gslcosim.world.rover_paths import RoverPlanner
from gslcosim.world.separation import LOOKS_AHEAD_S, Neighbour, meets_within, passing_velocity
from gslcosim.world.space import FlightSpace
from gslcosim.world.trajectory import AS_BEFORE, Heading, Trajectory, Vec3, fly_at, stay_at

Phase = Literal["on_ground", "taking_off", "flying", "holding", "failed", "landing", "driving"]

# When a vehicle counts as being at its waypoint, and how long after the end of its trajectory it may take.
ARRIVED_WITHIN_M = 0.15
ARRIVED_BELOW_M_S = 0.2
GIVE_UP_AFTER_S = 10.0
BACK_OFF_M = 0.1
# How long a vehicle may go out of the way of others on one leg, before it holds.
GIVES_WAY_FOR_S = 20.0
# A vehicle that lies on its side or back this long, and hardly moves, will not get up.
OVERTURNED_BELOW = 0.3
OVERTURNED_FOR_S = 1.0

# The middle of a vehicle and its sides, in radii.
_SIDES = np.array([(0, 0, 0), (1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1)], np.float64)
# What makes a command the same as the one before.
_GOAL_FIELDS = (
    "kind",
    "position_world_m",
    "velocity_world_m_s",
    "waypoints",
    "attitude",
    "rates",
    "drive",
    "yaw_rad",
    "faces_path",
)

OVERTURNED = "vehicle: expected to stand upright, was lying on its side or back; it cannot move any more."


class Mission:
    """The mission of one vehicle: which path or setpoint it follows, and when its agent is asked.

    A tick goes: `begin_tick` with the agent's command, physics along `trajectory` or at `setpoint`, `end_tick` with the
    true state. A command takes effect at the start of the tick.

    State: phase, trajectory, setpoint, the legs ahead, target or velocity, the tick until which it holds, a command
    kept for after take-off, the notice about a refused command (kept until the next command), whether the vehicle has
    left the ground, whether it lies overturned, and the true state at the end of the tick before.
    """

    def __init__(
        self,
        agent: AgentSpec,
        space: FlightSpace,
        abilities: Abilities,
        tick_ns: int,
        *,
        avoidance: Avoidance | None = None,
    ) -> None:
        self._agent = agent
        self._space = space
        self._abilities = abilities
        self._avoidance = avoidance
        self._tick_ns = tick_ns
        self._planner: Planner = (
            RoverPlanner(limits=abilities.limits, tick_ns=tick_ns, max_yaw_rate_rad_s=abilities.max_yaw_rate_rad_s)
            if abilities.has_wheels
            else FlightPlanner(limits=abilities.limits, tick_ns=tick_ns)
        )
        self._under_way: Phase = "driving" if abilities.has_wheels else "flying"
        self.start(AT_REST)

    def start(self, position_world_m: Vec3) -> None:
        """Return to the state at rest on the ground at tick 0."""
        self.trajectory: Trajectory = stay_at(position_world_m, 0)
        self.setpoint: Setpoint | None = None
        self.is_armed = False
        self.phase: Phase = "on_ground"
        self.target_world_m: Vec3 | None = None
        self.awaiting_command = self._agent.is_asked_every_tick
        self.notice: str | None = None
        self.has_taken_off = self._abilities.has_wheels
        self.is_overturned = False
        self._leg: Leg | None = None
        self._legs: deque[Leg] = deque()
        self._is_preparing = False
        self._prepares_since_tick = 0
        self._velocity_world_m_s: Vec3 | None = None
        self._evasion: Trajectory | None = None
        self._evades_until_tick = 0
        self._goal: Command | None = None
        self._goal_notice: str | None = None
        self._hold_until_tick = 0
        self._kept_command: Command | None = None
        self._lies_since_tick: int | None = None
        self._position_m, self._velocity_m_s, self._yaw_rad = position_world_m, AT_REST, 0.0

    @property
    def waypoint_world_m(self) -> Vec3 | None:
        """Where the vehicle is going; nothing when it holds."""
        return self.target_world_m if self.phase in ("taking_off", self._under_way, "landing") else None

    @property
    def planned_path_world_m(self) -> tuple[Vec3, ...]:
        """The bends ahead and the place they lead to, world frame [m]; empty unless they were planned."""
        if self._avoidance is None or self._leg is None or self.phase != self._under_way:
            return ()
        return tuple(leg.place_world_m for leg in self._legs_to_goal(self._leg))

    def begin_tick(self, tick: int, command: Command | None) -> None:
        """Leave the start at the first tick and obey a command; path or setpoint then hold for this tick.

        Args:
            tick: The tick that begins, >= 1.
            command: The agent's command that takes effect now, if there is one.
        """
        if tick == 1:
            self._leave_start()
        if command is None or self.phase == "failed":
            return
        self.notice = None
        if command.kind == "failed":
            self._fail(tick - 1)
        elif command.kind != "noop":
            self._obey(tick - 1, command)

    @property
    def gives_way(self) -> bool:
        """Whether the vehicle goes out of the way of others now, if it has to."""
        return self._agent.vehicle.separation_m > 0 and self.phase == "flying" and self.setpoint is None

    def keep_apart(self, tick: int, neighbours: Sequence[Neighbour]) -> None:
        """Go out of the way of others where that is needed, and back to the leg when it no longer is.

        Args:
            tick: The tick that ended; the path holds from its end on.
            neighbours: The others, as this vehicle sees them.
        """
        if not self.gives_way:
            return
        wanted_m_s, within_s = self._wanted(tick)
        if not meets_within(wanted_m_s, neighbours, within_s):
            if self._is_evading:
                self._go_back(tick)
        elif self._leg is not None and self._is_evading and tick >= self._evades_until_tick:
            self._hold(tick, self._agent.vehicle.hold_s, AS_BEFORE)
            self.notice = f"separation: expected a way past other vehicles within {GIVES_WAY_FOR_S:g} s; it holds."
        else:
            velocity_m_s = passing_velocity(wanted_m_s, self._velocity_m_s, neighbours, self._is_open)
            self._evasion = fly_at(self._motion(tick).state, velocity_m_s, self._abilities.limits, tick)
            self.trajectory = self._evasion

    def end_tick(
        self, tick: int, position_world_m: Vec3, velocity_world_m_s: Vec3, *, yaw_rad: float, uprightness: float
    ) -> None:
        """Notice arrivals and what goes wrong, begin the next leg, and decide whether the agent is asked.

        Args:
            tick: The tick that ends.
            position_world_m: True position, world frame [m].
            velocity_world_m_s: True velocity, world frame [m/s].
            yaw_rad: True heading [rad].
            uprightness: Cosine of the angle between the vehicle's z axis and the vertical.
        """
        self._position_m, self._velocity_m_s, self._yaw_rad = position_world_m, velocity_world_m_s, yaw_rad
        if not self.has_taken_off and self.trajectory.is_over(tick, self._tick_ns):
            self.has_taken_off = True
        self._check_overturned(tick, uprightness)
        if self._is_preparing:
            self._go_on(tick)
        elif self._velocity_world_m_s is not None or self.setpoint is not None:
            self._check_edge(tick)
        elif self.phase in ("taking_off", self._under_way, "landing") and not self._is_evading:
            self._check_arrival(tick, velocity_world_m_s)
        if self._legs and self.phase == "holding" and tick >= self._hold_until_tick:
            self._begin_leg(tick)
        self._decide_whether_to_ask(tick)

    def _decide_whether_to_ask(self, tick: int) -> None:
        if self._agent.is_asked_every_tick:
            self.awaiting_command = self.phase != "failed"
            return
        is_moving_on = self._velocity_world_m_s is not None or self.setpoint is not None
        is_free_to_ask = (self.phase in ("holding", "on_ground") and not self._legs) or is_moving_on
        self.awaiting_command = is_free_to_ask and tick >= self._hold_until_tick

    def _leave_start(self) -> None:
        self.is_armed = True
        if self._abilities.has_wheels:
            self.phase = "holding"
            self._hold_until_tick = self._ticks(self._agent.vehicle.hold_s)
            self.trajectory = replace(self.trajectory)
        else:
            self._take_off(0)

    def _take_off(self, tick: int) -> None:
        x_m, y_m, _ = self._position_m if self.has_taken_off else self.trajectory.end_world_m
        place_m = (x_m, y_m, self._agent.vehicle.search_height_m)
        self.is_armed = True
        self._legs.clear()
        self._legs.append(Leg(name="take_off", place_world_m=place_m, hold_s=self._agent.vehicle.hold_s))
        self._begin_leg(tick)
        self.phase = "taking_off"

    # ------------------------------------------------------------ commands

    def _obey(self, tick: int, command: Command) -> None:
        if self._is_repeated(command) and not self.is_overturned:
            self.notice = self._goal_notice
            return
        self.notice = self._refusal(tick, command)
        if self.notice is not None:
            self._hold(tick, self._agent.vehicle.hold_s, AS_BEFORE)
        elif command.kind in ("hold", "declare_source"):
            self._hold(tick, self._hold_s(command), heading_of(command))
        elif self.phase == "taking_off":
            self._kept_command = command
        elif self.phase == "on_ground" and command.kind not in ("attitude", "rates"):
            self._kept_command = command if command.kind != "take_off" else None
            self._goal = command if command.kind == "take_off" else None
            self._goal_notice = None
            self._take_off(tick)
        else:
            self._goal = command
            self._go(tick, command)
            self._goal_notice = self.notice

    def _go(self, tick: int, command: Command) -> None:
        if command.kind == "land":
            self._land(tick)
        elif command.kind == "velocity" and command.velocity_world_m_s is not None:
            self._cruise(tick, command.velocity_world_m_s, heading_of(command))
            self._hold_until_tick = tick + self._ticks(self._hold_s(command))
        elif setpoint := command.attitude or command.rates or command.drive:
            self._hand_over(tick, setpoint)
            self._hold_until_tick = tick + self._ticks(self._hold_s(command))
        else:
            self._set_out(tick, legs_of(command, self._hold_s(command)))

    @property
    def _is_evading(self) -> bool:
        return self._evasion is not None and self.trajectory is self._evasion

    # The velocity straight to where it is going, slower on the last metre, and how far ahead that counts.
    def _wanted(self, tick: int) -> tuple[Vec3, float]:
        if self._velocity_world_m_s is not None or self._leg is None:
            return self._velocity_world_m_s or AT_REST, LOOKS_AHEAD_S
        way_m = np.subtract(self._leg.place_world_m, self._motion(tick).state[0])
        distance_m = float(np.linalg.norm(way_m))
        if distance_m < ARRIVED_WITHIN_M:
            return AT_REST, 0.0
        u, v, w = (way_m * (self._abilities.limits.max_speed_m_s * min(1.0, distance_m) / distance_m)).tolist()
        return (u, v, w), min(LOOKS_AHEAD_S, distance_m / math.hypot(u, v, w))

    # A second ahead, as wide as the vehicle.
    def _is_open(self, velocity_m_s: Vec3) -> bool:
        if self._avoidance is not None:
            u, v, w = velocity_m_s
            x_m, y_m, z_m = self._position_m
            return self._avoidance.is_way_free(self._position_m, (x_m + u, y_m + v, z_m + w))
        ahead_m = np.multiply.outer((0.5, 1.0), velocity_m_s)[:, np.newaxis] + self._position_m
        return self._space.is_open((ahead_m + self._space.radius_m * _SIDES).reshape(-1, 3))

    def _go_back(self, tick: int) -> None:
        velocity_m_s, leg = self._velocity_world_m_s, self._leg
        if velocity_m_s is not None:
            self._velocity_world_m_s = None
            self._cruise(tick, velocity_m_s, AS_BEFORE)
        elif leg is not None and self._avoidance is None:
            self._follow_leg(tick, leg)
        elif leg is not None and self._avoidance is not None:
            ahead = [further for further in (leg, *self._legs) if not further.is_bend]
            until_tick, notice = self._evades_until_tick, self.notice
            self._set_out(tick, tuple(ahead))
            self._evades_until_tick, self.notice = until_tick, self.notice or notice

    def _set_out(self, tick: int, legs: tuple[Leg, ...]) -> None:
        if self._avoidance is not None:
            plan = self._avoidance.plan(legs, self._motion(tick).state)
            self.notice, legs = plan.notice, plan.legs
        if not legs:
            self._hold(tick, self._agent.vehicle.hold_s, AS_BEFORE)
            return
        self._legs = deque(legs)
        self._begin_leg(tick)

    # An agent that is asked at every tick says the same again and again; a velocity is asked for after its hold time.
    def _is_repeated(self, command: Command) -> bool:
        if self._goal is None or not self._agent.is_asked_every_tick:
            return False
        return all(getattr(command, name) == getattr(self._goal, name) for name in _GOAL_FIELDS)

    def _hold_s(self, command: Command) -> float:
        return self._agent.vehicle.hold_s if command.hold_s is None else command.hold_s

    def _refusal(self, tick: int, command: Command) -> str | None:
        if self.is_overturned:
            return OVERTURNED
        refusal = refusal_of(command, self._abilities, self._space, is_on_ground=self.phase == "on_ground")
        if refusal is not None:
            return refusal
        if command.kind == "land":
            return refusal_of_ground(self._position_m, self._space)
        if command.kind == "mission" and self._avoidance is None:
            return self._refusal_of_curves(tick, command)
        is_new_velocity = command.velocity_world_m_s != self._velocity_world_m_s
        if command.kind != "velocity" or self.phase in ("taking_off", "on_ground") or not is_new_velocity:
            return None
        path, is_preparing = self._planner.at_velocity(command.velocity_world_m_s or AT_REST, self._motion(tick), tick)
        return None if is_preparing else self._edge_ahead(tick, path)

    def _refusal_of_curves(self, tick: int, command: Command) -> str | None:
        state = self._motion(tick).state
        if self.phase in ("taking_off", "on_ground"):
            x_m, y_m, _ = self._position_m
            state = np.array([(x_m, y_m, self._agent.vehicle.search_height_m), AT_REST, AT_REST])
        legs = legs_of(command, self._hold_s(command))
        return refusal_of_curves(legs, state, self._abilities.limits, self._space, self._tick_ns)

    # ------------------------------------------------------------ ways to move

    def _motion(self, tick: int) -> Motion:
        state = self.trajectory.state_at(tick, self._tick_ns)
        if self.setpoint is not None:
            state = np.array([self._position_m, self._velocity_m_s, AT_REST])
        return Motion(state=state, yaw_rad=self._yaw_rad)

    def _begin_leg(self, tick: int) -> None:
        self._leg = self._legs.popleft()
        self._evades_until_tick = tick + self._ticks(GIVES_WAY_FOR_S)
        self._follow_leg(tick, self._leg)
        self._prepares_since_tick = tick

    def _follow_leg(self, tick: int, leg: Leg) -> None:
        self.trajectory, self._is_preparing = self._planner.along(leg, self._motion(tick), tick)
        self.setpoint = None
        self.target_world_m = self._legs_to_goal(leg)[-1].place_world_m
        self._velocity_world_m_s = None
        self.phase = self._under_way

    # Bends, then the leg that ends where the agent wants to be.
    def _legs_to_goal(self, leg: Leg) -> list[Leg]:
        legs = [leg, *self._legs]
        n_bends = next(i for i, ahead in enumerate(legs) if not ahead.is_bend)
        return legs[: n_bends + 1]

    def _cruise(self, tick: int, velocity_m_s: Vec3, heading: Heading) -> None:
        if velocity_m_s != self._velocity_world_m_s or self._is_preparing:
            path, self._is_preparing = self._planner.at_velocity(velocity_m_s, self._motion(tick), tick)
            self.trajectory = path if self._is_preparing else replace(path, heading=heading)
            self._prepares_since_tick = tick
        elif heading != AS_BEFORE:
            self.trajectory = replace(self.trajectory, heading=heading)
        self._forget_legs()
        self.setpoint = None
        self._velocity_world_m_s = velocity_m_s
        self.phase = self._under_way

    def _hand_over(self, tick: int, setpoint: Setpoint) -> None:
        self._forget_legs()
        self._velocity_world_m_s = None
        self._is_preparing = False
        self.is_armed = True
        self.has_taken_off = True
        self.setpoint = setpoint
        self.trajectory = stay_at(self._position_m, tick)
        self.phase = self._under_way

    def _land(self, tick: int) -> None:
        x_m, y_m, _ = self._motion(tick).state[0].tolist()
        height_m = self._space.support_height_m(self._position_m) + self._abilities.standing_height_m
        self._legs = deque([Leg(name="land", place_world_m=(x_m, y_m, height_m), hold_s=self._agent.vehicle.hold_s)])
        self._begin_leg(tick)
        self.phase = "landing"

    # A vehicle on wheels has stopped, or has turned: the same goal again, as long as that brings it further.
    def _go_on(self, tick: int) -> None:
        if not self.trajectory.is_over(tick, self._tick_ns):
            return
        if seconds_from_ticks(tick - self._prepares_since_tick, self._tick_ns) > 2 * GIVE_UP_AFTER_S:
            self._give_up(tick, "turn")
        elif self._velocity_world_m_s is not None:
            velocity_m_s, self._velocity_world_m_s = self._velocity_world_m_s, None
            since_tick = self._prepares_since_tick
            self._cruise(tick, velocity_m_s, AS_BEFORE)
            self._prepares_since_tick = since_tick
        elif self._leg is not None:
            self._follow_leg(tick, self._leg)

    # A take-off is always finished: just above the floor is no place to hold. Who stands goes on standing.
    def _hold(self, tick: int, hold_s: float, heading: Heading) -> None:
        self._goal = None
        if self.phase == "taking_off":
            self._kept_command = None
            return
        self._hold_until_tick = tick + self._ticks(hold_s)
        if self.phase == "on_ground":
            return
        self._stop(tick)
        self.phase = "holding"
        if heading != AS_BEFORE:
            self.trajectory = replace(self.trajectory, heading=heading, forgets_integral=False)

    # A stop under way is kept: planned anew at every tick it would never end.
    def _stop(self, tick: int) -> None:
        is_stopping = (
            self.target_world_m is None and self.trajectory.end_velocity_world_m_s == AT_REST and self.setpoint is None
        )
        motion = self._motion(tick)
        self._forget_legs()
        self._velocity_world_m_s = None
        self._is_preparing = False
        self.setpoint = None
        if not is_stopping:
            stop = fly_at(motion.state, AT_REST, self._abilities.limits, tick)
            heading = Heading(yaw_rad=self._yaw_rad) if self._abilities.has_wheels else AS_BEFORE
            self.trajectory = replace(stop, heading=heading)

    def _forget_legs(self) -> None:
        self._legs.clear()
        self._leg = None
        self.target_world_m = None

    def _fail(self, tick: int) -> None:
        if self.phase not in ("taking_off", "on_ground"):
            self._stop(tick)
        self._forget_legs()
        self.phase = "failed"

    # ------------------------------------------------------------ what happens

    # A stop that begins a tick later must still end in free space.
    def _edge_ahead(self, tick: int, trajectory: Trajectory) -> str | None:
        state = trajectory.state_at(tick + 1, self._tick_ns)
        x_m, y_m, z_m = fly_at(state, AT_REST, self._abilities.limits, tick).end_world_m
        u, v, w = state[1].tolist()
        return self._space.edge_ahead("velocity", (x_m, y_m, z_m), (u, v, w))

    # An agent that sets attitude or rates looks after itself; wheels are stopped.
    def _check_edge(self, tick: int) -> None:
        if self.setpoint is None:
            edge = self._edge_ahead(tick, self.trajectory)
        elif self._abilities.has_wheels:
            edge = self._edge_ahead_of_wheels()
        else:
            return
        if edge is not None:
            self._hold(tick, self._agent.vehicle.hold_s, AS_BEFORE)
            self.notice = edge

    # A stop takes 1.5 v/a, on average at half the speed; see `set_quartic_to_velocity_inplace`.
    def _edge_ahead_of_wheels(self) -> str | None:
        u, v, _ = self._velocity_m_s
        braking_s = 0.75 * math.hypot(u, v) / self._abilities.limits.max_acceleration_m_s2 + self._tick_ns / NS_PER_S
        x_m, y_m, z_m = self._position_m
        return self._space.edge_ahead("drive", (x_m + braking_s * u, y_m + braking_s * v, z_m), (u, v, 0.0))

    def _check_overturned(self, tick: int, uprightness: float) -> None:
        is_lying = uprightness < OVERTURNED_BELOW and math.hypot(*self._velocity_m_s) < ARRIVED_BELOW_M_S
        if not is_lying or self.phase == "failed":
            self._lies_since_tick = None
            return
        if self._lies_since_tick is None:
            self._lies_since_tick = tick
        if not self.is_overturned and tick - self._lies_since_tick >= self._ticks(OVERTURNED_FOR_S):
            self.is_overturned = True
            self.notice = OVERTURNED
            self._stand(tick)

    # Rotors or wheels stop, and the agent is asked; whoever has landed can take off again.
    def _stand(self, tick: int) -> None:
        self._forget_legs()
        self._velocity_world_m_s = None
        self._kept_command = None
        self._is_preparing = False
        self.setpoint = None
        self.trajectory = stay_at(self._position_m, tick, forgets_integral=True)
        self.is_armed = False
        self.phase = "on_ground"
        self._hold_until_tick = tick + self._ticks(self._agent.vehicle.hold_s)

    def _check_arrival(self, tick: int, velocity_m_s: Sequence[float]) -> None:
        if not self.trajectory.is_over(tick, self._tick_ns):
            return
        if self._leg is not None and self._leg.is_passed:
            self._pass(tick, self._leg)
            return
        distance_m = math.dist(self._position_m, self.trajectory.end_world_m)
        if distance_m > ARRIVED_WITHIN_M or math.hypot(*velocity_m_s) >= ARRIVED_BELOW_M_S:
            late_s = seconds_from_ticks(tick - self.trajectory.start_tick, self._tick_ns) - self.trajectory.duration_s
            if late_s < GIVE_UP_AFTER_S:
                return
            self._give_up(tick, "waypoint")
        self._arrive(tick)

    # After the last place that is passed it goes on as it goes there.
    def _pass(self, tick: int, leg: Leg) -> None:
        if self._legs:
            self._begin_leg(tick)
            return
        self._forget_legs()
        self._velocity_world_m_s = leg.velocity_world_m_s
        self._hold_until_tick = tick

    # A little back from where it got stuck, so that it no longer touches whatever is in the way.
    def _give_up(self, tick: int, what: str) -> None:
        end_m = self.trajectory.end_world_m
        distance_m = math.dist(self._position_m, end_m)
        back = BACK_OFF_M / distance_m if distance_m > ARRIVED_WITHIN_M else 0.0
        x_m, y_m, z_m = (p + back * (p - end) for p, end in zip(self._position_m, end_m, strict=True))
        is_free = self._space.refusal("back", (x_m, y_m, z_m)) is None
        self.trajectory = stay_at((x_m, y_m, z_m) if is_free else self._position_m, tick, forgets_integral=True)
        self.notice = (
            f"{what}: expected to arrive within {GIVE_UP_AFTER_S:g} s of the planned time, "
            f"was still {distance_m:.2f} m away; the vehicle holds there."
        )
        self._legs.clear()

    def _arrive(self, tick: int) -> None:
        kept, self._kept_command = self._kept_command, None
        leg, self._leg = self._leg, None
        if self.phase == "landing" and self.notice is None:
            self._stand(tick)
            return
        self.phase = "holding"
        self._hold_until_tick = tick + self._ticks(leg.hold_s if leg else 0.0)
        if leg is not None and self._abilities.has_wheels and leg.heading.yaw_rad is not None:
            self.trajectory = replace(self.trajectory, heading=leg.heading)
        if kept is not None:
            self._obey(tick, kept)

    def _ticks(self, duration_s: float) -> int:
        return ticks_from_seconds(duration_s, self._tick_ns)
