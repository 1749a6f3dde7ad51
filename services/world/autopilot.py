"""Autopilot of one vehicle: accepts, defers or refuses commands, and carries them out phase by phase."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from gslcosim.base.quantities import Vec3
from gslcosim.base.ticks import ticks_from_seconds
from gslcosim.contract.messages import Command, DriveSetpoint
from gslcosim.environment.vertical_clearance import clear_height_m, is_climb_sufficient
from gslcosim.scenario.models.scenario import AgentSpec, VehicleSpec
from gslcosim_services.world import task_order
from gslcosim_services.world.flight_space import FlightSpace
from gslcosim_services.world.leg_planners import Leg
from gslcosim_services.world.obstacle_avoidance import BrakingMonitor, ObstacleAvoidance
from gslcosim_services.world.path_follower import (
    OVERTURNED_NOTICE,
    OverturnDetector,
    PathFollower,
    back_off,
    check_arrival,
)
from gslcosim_services.world.separation import MAX_EVASION_S, Evasion, Neighbours
from gslcosim_services.world.task_order import find_answer, find_deferred_answer, find_watch, is_command_due
from gslcosim_services.world.tasks import (
    Abort,
    Cruise,
    DirectControl,
    GoTo,
    Hold,
    Land,
    Noop,
    TakeOff,
    Task,
    find_refusal,
    find_refusal_from_state,
    parse_command,
)
from gslcosim_services.world.trajectory import UNCHANGED_HEADING, Heading, Trajectory
from gslcosim_services.world.vehicle_records import Setpoint, VehicleCapabilities

STANDING_TOLERANCE_M = 0.05
# Longest stop and turn of a vehicle on wheels before it gives up.
MAX_TURN_S = 20.0

Phase = Literal["on_ground", "taking_off", "flying", "holding", "failed", "landing", "driving"]

# An agent in free mode that has not answered may have missed the question [s].
REQUEST_PERIOD_S = 30.0


class FlightStateMachine:
    """State machine of one vehicle's phases. Methods return a notice for the agent where something goes wrong.

    State: phase, path follower, the task under way (none once it stops), the tick until which it holds, whether its
    rotors or wheels turn, whether it has left the ground, and whether it lies overturned.
    """

    def __init__(
        self,
        vehicle: VehicleSpec,
        space: FlightSpace,
        abilities: VehicleCapabilities,
        tick_ns: int,
        position_world_m: Vec3,
        *,
        avoidance: ObstacleAvoidance | None,
    ) -> None:
        """Rest on the ground at a place, world frame [m], at tick 0."""
        self._vehicle = vehicle
        self._space = space
        self._abilities = abilities
        self._avoidance = avoidance
        self._tick_ns = tick_ns
        self.follower = PathFollower(abilities, tick_ns, position_world_m)
        self.edges = BrakingMonitor(space=space, abilities=abilities, tick_ns=tick_ns, avoidance=avoidance)
        self._evasion = Evasion(self.follower, space, abilities.limits, tick_ns, avoidance=avoidance)
        self._overturn_detector = OverturnDetector(tick_ns)
        self.under_way: Phase = "driving" if abilities.has_wheels else "flying"
        self.phase: Phase = "on_ground"
        self.goal: Task | None = None
        self.is_armed = False
        self.has_taken_off = abilities.has_wheels
        self.hold_until_tick = 0

    @property
    def is_overturned(self) -> bool:
        """True once the vehicle lies on its side or back for good."""
        return self._overturn_detector.is_overturned

    @property
    def yields(self) -> bool:
        """True while the vehicle yields to others where that is needed."""
        return self._vehicle.separation_m > 0 and self.phase == "flying" and self.follower.setpoint is None

    def set_goal(self, goal: Task | None) -> None:
        """Set the task that the following calls carry out."""
        self.goal = goal

    def leave_start(self) -> str | None:
        """Take off at the first tick; on wheels only turn them on."""
        if not self._abilities.has_wheels:
            return self.take_off(0)
        self.is_armed = True
        self.phase = "holding"
        self.hold_for(0, self._vehicle.hold_s)
        self.follower.look(UNCHANGED_HEADING)
        return None

    def take_off(self, tick: int) -> str | None:
        """Rise to the height of search; with avoidance only as far as nothing is in the way."""
        place_m = self.follower.position_m if self.has_taken_off else self.follower.trajectory.end_world_m
        wanted_m = self._vehicle.search_height_m
        to_m = wanted_m
        if self._avoidance is not None:
            to_m = clear_height_m(self._space.room, self._space.radius_m, place_m, wanted_m)
        found = f"take_off: expected a free way to a height of {wanted_m:g} m, was free as far as {to_m:.2f} m"
        if not is_climb_sufficient(place_m[2], to_m, wanted_m):
            if self._stands_at(place_m):
                self.hold(tick, self._vehicle.hold_s)
                return f"{found}; the vehicle stays."
            to_m = max(to_m, place_m[2])
        self.is_armed = True
        self._begin(tick, [self._change_of_height("take_off", (place_m[0], place_m[1], to_m))])
        self.phase = "taking_off"
        return None if to_m == wanted_m else f"{found}; goes there."

    def land(self, tick: int) -> None:
        """Descend to the surface below."""
        x_m, y_m, _ = self.follower.motion(tick).state[0].tolist()
        height_m = self._space.support_height_m(self.follower.position_m) + self._abilities.standing_height_m
        self._begin(tick, [self._change_of_height("land", (x_m, y_m, height_m))])
        self.phase = "landing"

    def follow_legs(self, tick: int, legs: Sequence[Leg], *, is_return: bool = False) -> str | None:
        """Follow legs, around obstacles; where there is no path the vehicle holds.

        Args:
            tick: The tick that ended.
            legs: The legs, one after the other.
            is_return: These are the legs from before the vehicle made way for others.
        """
        notice = None
        if self._avoidance is not None:
            plan = self._avoidance.plan(legs, self.follower.motion(tick).state)
            notice, legs = plan.notice, plan.legs
        if legs:
            self._begin(tick, legs, is_new=not is_return)
        else:
            self.hold(tick, self._vehicle.hold_s)
        return notice

    def cruise(self, tick: int, velocity_m_s: Vec3, heading: Heading, for_s: float) -> None:
        """Set a velocity and keep it; the agent is due after a time [s]."""
        self.follower.cruise(tick, velocity_m_s, heading)
        self.hold_for(tick, for_s)
        self.phase = self.under_way

    def follow_setpoint(self, tick: int, setpoint: Setpoint, for_s: float) -> None:
        """Follow a setpoint of the agent, which is due after a time [s]."""
        self.is_armed = self.has_taken_off = True
        self.follower.follow_setpoint(tick, setpoint)
        self.hold_for(tick, for_s)
        self.phase = self.under_way

    def hold(self, tick: int, hold_s: float, heading: Heading = UNCHANGED_HEADING) -> None:
        """Stop and hold.

        A take-off is always finished: just above the floor is no place to hold. A vehicle on the ground stays there.
        """
        self.goal = None
        if self.phase == "taking_off":
            return
        self.hold_for(tick, hold_s)
        if self.phase == "on_ground":
            return
        self.follower.stop(tick)
        self.phase = "holding"
        if heading != UNCHANGED_HEADING:
            self.follower.look(heading)

    def hold_for(self, tick: int, hold_s: float) -> None:
        """Make the agent due after a time [s]."""
        self.hold_until_tick = tick + ticks_from_seconds(hold_s, self._tick_ns)

    def fail(self, tick: int) -> None:
        """Stop for good."""
        if self.phase not in ("taking_off", "on_ground"):
            self.follower.stop(tick)
        self.follower.clear_legs()
        self.phase = "failed"

    def avoid_neighbours(self, tick: int, neighbours: Neighbours) -> str | None:
        """Avoid other vehicles where that is needed, and return to the path when it no longer is."""
        wanted_m_s = self._evasion.conflicting_velocity_m_s(tick, neighbours)
        if wanted_m_s is None:
            return self._return_to_path(tick) if self._evasion.is_under_way else None
        if self._evasion.is_too_long(tick):
            self.hold(tick, self._vehicle.hold_s)
            return f"separation: expected a way past other vehicles within {MAX_EVASION_S:g} s; it holds."
        self._evasion.evade(tick, wanted_m_s, neighbours)
        return None

    def end_tick(self, tick: int, uprightness: float) -> str | None:
        """Detect arrivals and faults, and start the next leg; the path follower has the true state already."""
        self.has_taken_off = self.has_taken_off or self.follower.is_over(tick)
        notice = self._check_overturn(tick, uprightness)
        goes_to_place = self.phase in ("taking_off", self.under_way, "landing") and not self._evasion.is_under_way
        match find_watch(self.follower.is_preparing, self.follower.is_continuous, goes_to_place):
            case task_order.PREPARATION:
                notice = self._prepare(tick) or notice
            case task_order.EDGE:
                notice = self._brake_before_edge(tick) or notice
            case task_order.ARRIVAL:
                notice = self._notice_arrival(tick) or notice
            case _:
                pass
        if self.follower.ahead and self.phase == "holding" and tick >= self.hold_until_tick:
            self._begin_leg(tick)
        return notice

    def _begin(self, tick: int, legs: Sequence[Leg], *, is_new: bool = True) -> None:
        self.follower.plan(legs)
        self._begin_leg(tick, is_new=is_new)

    def _begin_leg(self, tick: int, *, is_new: bool = True) -> None:
        self._evasion.begin_leg(tick, is_new=is_new)
        self.follower.begin_leg(tick)
        self.phase = self.under_way

    def _stands_at(self, place_m: Vec3) -> bool:
        above_m = place_m[2] - self._space.support_height_m(place_m)
        return above_m <= self._abilities.standing_height_m + STANDING_TOLERANCE_M

    def _change_of_height(self, name: str, place_m: Vec3) -> Leg:
        return Leg(name=name, place_world_m=place_m, hold_s=self._vehicle.hold_s)

    # A planned path needs a planned return: the straight line of before may no longer be free.
    def _return_to_path(self, tick: int) -> str | None:
        if self._avoidance is None or self.follower.kept_velocity_m_s is not None or self.follower.leg is None:
            self.follower.replan(tick)
            return None
        legs = [leg for leg in (self.follower.leg, *self.follower.ahead) if not leg.is_bend]
        return self.follow_legs(tick, legs, is_return=True)

    def _check_overturn(self, tick: int, uprightness: float) -> str | None:
        if self.phase == "failed" or not self._overturn_detector.detect_overturn(
            tick, uprightness, self.follower.velocity_m_s
        ):
            return None
        self._stand(tick)
        return OVERTURNED_NOTICE

    # A vehicle on wheels has stopped, or has turned: the same goal again, as long as that brings it further.
    def _prepare(self, tick: int) -> str | None:
        if not self.follower.is_over(tick):
            return None
        if self.follower.preparation_time_s(tick) > MAX_TURN_S:
            self.follower.stay(tick, self.follower.position_m)
            self._arrive(tick)
            return f"turn: expected to look where it goes within {MAX_TURN_S:g} s, did not; the vehicle holds."
        self.follower.replan(tick)
        return None

    def _brake_before_edge(self, tick: int) -> str | None:
        edge = self.edges.ahead(tick, self.follower)
        if edge is not None:
            self.hold(tick, self._vehicle.hold_s)
        return edge

    def _notice_arrival(self, tick: int) -> str | None:
        match check_arrival(tick, self.follower):
            case "passed":
                self._pass(tick)
            case "there" if self.phase == "landing":
                self._stand(tick)
            case "there":
                self._arrive(tick)
            case "late":
                notice = back_off(tick, self.follower, self._space)
                self._arrive(tick)
                return notice
        return None

    # After the last place that is passed the vehicle keeps its velocity there.
    def _pass(self, tick: int) -> None:
        leg = self.follower.leg
        if self.follower.ahead:
            self._begin_leg(tick)
        elif leg is not None:
            self.follower.continue_at_velocity(leg.velocity_world_m_s)
            self.hold_until_tick = tick

    def _arrive(self, tick: int) -> None:
        leg = self.follower.end_leg()
        self.phase = "holding"
        self.hold_for(tick, leg.hold_s if leg else 0.0)
        if leg is not None and self._abilities.has_wheels and leg.heading.yaw_rad is not None:
            self.follower.look(leg.heading)

    # Rotors or wheels stop, and the agent is due; a landed vehicle can take off again.
    def _stand(self, tick: int) -> None:
        self.follower.stand(tick)
        self.is_armed = False
        self.phase = "on_ground"
        self.hold_for(tick, self._vehicle.hold_s)


@dataclass(frozen=True, kw_only=True)
class Reference:
    """Reference of a vehicle's control: a setpoint where there is one, otherwise a path; and its arming.

    Two references that are not one object differ.
    """

    trajectory: Trajectory
    setpoint: Setpoint | None
    is_armed: bool


class Autopilot:
    """Autopilot of one vehicle: turns commands into a reference, and decides at which ticks the agent is due.

    A tick goes: `begin_tick` with the agent's command, physics along the reference, `end_tick` with the true state. A
    command takes effect at the start of the tick. Each of these returns the reference that holds from then on.

    State: the vehicle's `Conduct`; a task kept for after take-off; the notice about a refused command,
    kept until the next command, and that about the task under way; the last reference.
    """

    def __init__(
        self,
        agent: AgentSpec,
        space: FlightSpace,
        abilities: VehicleCapabilities,
        tick_ns: int,
        position_world_m: Vec3,
        *,
        avoidance: ObstacleAvoidance | None = None,
    ) -> None:
        """Rest on the ground at a place, world frame [m], at tick 0."""
        self._agent = agent
        self._space = space
        self._abilities = abilities
        self._avoids = avoidance is not None
        self._state_machine = FlightStateMachine(
            agent.vehicle, space, abilities, tick_ns, position_world_m, avoidance=avoidance
        )
        self._path_follower = self._state_machine.follower
        self.awaiting_command = self._is_asked_every_tick = agent.is_asked_every_tick
        self._quiet_until_tick = 0
        self._quiet_ticks = ticks_from_seconds(REQUEST_PERIOD_S, tick_ns)
        self.notice: str | None = None
        self._goal_notice: str | None = None
        self._pending_task: Task | None = None
        self._reference = Reference(trajectory=self._path_follower.trajectory, setpoint=None, is_armed=False)

    @property
    def phase(self) -> Phase:
        """Phase that the vehicle is in."""
        return self._state_machine.phase

    @property
    def has_taken_off(self) -> bool:
        """True once the vehicle has left its start; always for one on wheels."""
        return self._state_machine.has_taken_off

    @property
    def reference(self) -> Reference:
        """Reference that the vehicle's control follows now."""
        follower, known, is_armed = self._path_follower, self._reference, self._state_machine.is_armed
        is_same_path = follower.trajectory is known.trajectory and follower.setpoint is known.setpoint
        if not (is_same_path and is_armed == known.is_armed):
            self._reference = Reference(trajectory=follower.trajectory, setpoint=follower.setpoint, is_armed=is_armed)
        return self._reference

    @property
    def waypoint_world_m(self) -> Vec3 | None:
        """Position that the vehicle is going to; none while it holds."""
        is_going = self.phase in ("taking_off", self._state_machine.under_way, "landing")
        return self._path_follower.target_world_m if is_going else None

    @property
    def planned_path_world_m(self) -> tuple[Vec3, ...]:
        """The bends ahead and the place they lead to, world frame [m]; empty unless they were planned."""
        if not self._avoids or self.phase != self._state_machine.under_way:
            return ()
        return tuple(leg.place_world_m for leg in self._path_follower.legs_to_goal)

    @property
    def yields(self) -> bool:
        """True while the vehicle yields to others where that is needed."""
        return self._state_machine.yields

    def begin_tick(self, tick: int, command: Command | None) -> Reference:
        """Leave the start at the first tick and obey a command; return the reference for this tick.

        Args:
            tick: The tick that begins, >= 1.
            command: The agent's command that takes effect now, if there is one.
        """
        if tick == 1:
            self.notice = self._state_machine.leave_start()
        if command is not None and self.phase != "failed":
            self._obey(tick - 1, parse_command(command))
        return self.reference

    def avoid_neighbours(self, tick: int, neighbours: Neighbours) -> Reference:
        """Avoid other vehicles where that is needed, and return to the leg when it no longer is.

        Args:
            tick: The tick that ended; the path holds from its end on.
            neighbours: All vehicles, as this one sees them.
        """
        if self.yields:
            self.notice = self._state_machine.avoid_neighbours(tick, neighbours) or self.notice
        return self.reference

    def end_tick(
        self, tick: int, position_world_m: Vec3, velocity_world_m_s: Vec3, *, yaw_rad: float, uprightness: float
    ) -> Reference:
        """Update the state, start a pending task after take-off, and decide whether the agent is due.

        Args:
            tick: The tick that ends.
            position_world_m: True position, world frame [m].
            velocity_world_m_s: True velocity, world frame [m/s].
            yaw_rad: True heading [rad].
            uprightness: Cosine of the angle between the vehicle's z axis and the vertical.
        """
        self._path_follower.update_state(position_world_m, velocity_world_m_s, yaw_rad)
        self.notice = self._state_machine.end_tick(tick, uprightness) or self.notice
        if (deferred := self._pending_task) is not None:
            answer = find_deferred_answer(self.phase == "taking_off", self.phase == "holding")
            if answer != task_order.DEFER:
                self._pending_task = None
            if answer == task_order.ACCEPT:
                self._receive_task(tick, deferred)
        self._decide_whether_to_ask(tick)
        return self.reference

    def _decide_whether_to_ask(self, tick: int) -> None:
        is_idle = self.phase in ("holding", "on_ground") and not self._path_follower.ahead
        self.awaiting_command = is_command_due(
            self._is_asked_every_tick,
            self.phase == "failed",
            is_idle,
            self._path_follower.is_continuous,
            tick,
            self._state_machine.hold_until_tick,
        )
        if self.awaiting_command and self._agent.is_free:
            self._ask_once(tick)

    # Time passes with or without an answer, and the agent need not receive the same request at every tick.
    def _ask_once(self, tick: int) -> None:
        self.awaiting_command = tick >= self._quiet_until_tick
        if self.awaiting_command:
            self._quiet_until_tick = tick + self._quiet_ticks

    def _obey(self, tick: int, task: Task) -> None:
        self.notice = None
        match task:
            case Noop():
                return
            case Abort():
                self._state_machine.fail(tick)
            case _:
                self._quiet_until_tick = 0
                self._receive_task(tick, task)

    def _receive_task(self, tick: int, task: Task) -> None:
        if self._is_repeated(task):
            self.notice = self._goal_notice
            return
        self.notice = self._refusal(tick, task)
        has_to_rise = self.phase == "on_ground" and not _is_controlled_by_agent(task)
        is_hold, is_taking_off = isinstance(task, Hold), self.phase == "taking_off"
        match find_answer(self.notice is not None, is_hold, is_taking_off, has_to_rise):
            case task_order.REFUSE:
                self._pending_task = None
                self._state_machine.hold(tick, self._usual_hold_s)
            case task_order.STOP:
                assert isinstance(task, Hold)
                self._pending_task = None
                self._state_machine.hold(tick, self._hold_s(task.hold_s), task.heading)
            case task_order.DEFER:
                self._pending_task = task
            case task_order.RISE:
                self._rise_for(tick, task)
            case _:
                self._begin(tick, task)

    def _rise_for(self, tick: int, task: Task) -> None:
        is_all = isinstance(task, TakeOff)
        self.notice = self._state_machine.take_off(tick)
        if self.phase == "taking_off":
            self._pending_task = None if is_all else task
            self._state_machine.set_goal(task if is_all else None)
            self._goal_notice = self.notice

    def _begin(self, tick: int, task: Task) -> None:
        self._state_machine.set_goal(task)
        match task:
            case Land():
                self._state_machine.land(tick)
            case Cruise():
                hold_s = self._hold_s(task.hold_s)
                self._state_machine.cruise(tick, task.velocity_world_m_s, task.heading, hold_s)
            case DirectControl():
                self._state_machine.follow_setpoint(tick, task.setpoint, self._hold_s(task.hold_s))
            case GoTo():
                legs = task.legs_with_hold(self._usual_hold_s, is_fixed=self._agent.vehicle.hold_rule == "fixed")
                self.notice = self._state_machine.follow_legs(tick, legs)
            case _:
                raise AssertionError(f"expected a task to begin, was {task}")
        self._goal_notice = self.notice

    # An agent that is due at every tick repeats its command; a velocity makes it due after its hold time.
    def _is_repeated(self, task: Task) -> bool:
        if self._agent.mode_name == "on_request" or self._state_machine.is_overturned:
            return False
        return task == self._state_machine.goal

    def _refusal(self, tick: int, task: Task) -> str | None:
        if self._state_machine.is_overturned:
            return OVERTURNED_NOTICE
        refusal = find_refusal(task, self._abilities, self._space, is_on_ground=self.phase == "on_ground")
        if refusal is not None:
            return refusal
        rises_to_m = self._agent.vehicle.search_height_m if self.phase in ("taking_off", "on_ground") else None
        edges = self._state_machine.edges
        return find_refusal_from_state(
            tick, task, self._path_follower, edges, rises_to_m=rises_to_m, avoids=self._avoids
        )

    @property
    def _usual_hold_s(self) -> float:
        return self._agent.vehicle.hold_s

    def _hold_s(self, hold_s: float | None) -> float:
        return self._usual_hold_s if hold_s is None else hold_s


# An agent that sets attitude or rates takes off by itself.
def _is_controlled_by_agent(task: Task) -> bool:
    return isinstance(task, DirectControl) and not isinstance(task.setpoint, DriveSetpoint)
