"""What an agent and its vehicle say to each other: commands obeyed, kept or refused, and when the agent is asked."""

from dataclasses import dataclass

from gslcosim.contract.messages import Command, DriveSetpoint
from gslcosim.quantities import Vec3
from gslcosim.scenario.models.scenario import AgentSpec
from gslcosim.ticks import ticks_from_seconds
from gslcosim.world.guidance.abilities import Abilities
from gslcosim.world.guidance.arrival import OVERTURNED
from gslcosim.world.guidance.avoidance import Avoidance
from gslcosim.world.guidance.conduct import Conduct, Phase
from gslcosim.world.guidance.refusals import refusal_from_here, refusal_of
from gslcosim.world.guidance.separation import Neighbours
from gslcosim.world.guidance.tasks import Cruise, GiveUp, GoOn, GoTo, HandOver, Hold, Land, TakeOff, Task, parse
from gslcosim.world.paths.space import FlightSpace
from gslcosim.world.paths.trajectory import Trajectory
from gslcosim.world.physics.records import Setpoint

# An agent in free mode that has not answered may have missed the question [s].
ASK_AGAIN_S = 30.0


@dataclass(frozen=True, kw_only=True)
class Reference:
    """What a vehicle's control follows: a setpoint where there is one, otherwise a path; and whether it is armed.

    Two references that are not one object differ.
    """

    trajectory: Trajectory
    setpoint: Setpoint | None
    is_armed: bool


class Guide:
    """The guide of one vehicle: turns commands into a reference, and decides when the agent is asked.

    A tick goes: `begin_tick` with the agent's command, physics along the reference, `end_tick` with the true state. A
    command takes effect at the start of the tick. Each of these returns the reference that holds from then on.

    State: what the vehicle does, see `Conduct`; a task kept for after take-off; the notice about a refused command,
    kept until the next command, and that about the task under way; the last reference.
    """

    def __init__(
        self,
        agent: AgentSpec,
        space: FlightSpace,
        abilities: Abilities,
        tick_ns: int,
        position_world_m: Vec3,
        *,
        avoidance: Avoidance | None = None,
    ) -> None:
        """Rest on the ground at a place, world frame [m], at tick 0."""
        self._agent = agent
        self._space = space
        self._abilities = abilities
        self._avoids = avoidance is not None
        self._conduct = Conduct(agent.vehicle, space, abilities, tick_ns, position_world_m, avoidance=avoidance)
        self._course = self._conduct.course
        self.awaiting_command = agent.is_asked_every_tick
        self._quiet_until_tick = 0
        self._quiet_ticks = ticks_from_seconds(ASK_AGAIN_S, tick_ns)
        self.notice: str | None = None
        self._goal_notice: str | None = None
        self._kept_task: Task | None = None
        self._reference = Reference(trajectory=self._course.trajectory, setpoint=None, is_armed=False)

    @property
    def phase(self) -> Phase:
        """What the vehicle is doing."""
        return self._conduct.phase

    @property
    def has_taken_off(self) -> bool:
        """Whether the vehicle has left its start; one on wheels always has."""
        return self._conduct.has_taken_off

    @property
    def reference(self) -> Reference:
        """What the vehicle's control follows now."""
        course, known, is_armed = self._course, self._reference, self._conduct.is_armed
        is_same_course = course.trajectory is known.trajectory and course.setpoint is known.setpoint
        if not (is_same_course and is_armed == known.is_armed):
            self._reference = Reference(trajectory=course.trajectory, setpoint=course.setpoint, is_armed=is_armed)
        return self._reference

    @property
    def waypoint_world_m(self) -> Vec3 | None:
        """Where the vehicle is going; nothing when it holds."""
        is_going = self.phase in ("taking_off", self._conduct.under_way, "landing")
        return self._course.target_world_m if is_going else None

    @property
    def planned_path_world_m(self) -> tuple[Vec3, ...]:
        """The bends ahead and the place they lead to, world frame [m]; empty unless they were planned."""
        if not self._avoids or self.phase != self._conduct.under_way:
            return ()
        return tuple(leg.place_world_m for leg in self._course.legs_to_goal)

    @property
    def gives_way(self) -> bool:
        """Whether the vehicle goes out of the way of others now, if it has to."""
        return self._conduct.gives_way

    def begin_tick(self, tick: int, command: Command | None) -> Reference:
        """Leave the start at the first tick and obey a command; return the reference for this tick.

        Args:
            tick: The tick that begins, >= 1.
            command: The agent's command that takes effect now, if there is one.
        """
        if tick == 1:
            self.notice = self._conduct.leave_start()
        if command is not None and self.phase != "failed":
            self._obey(tick - 1, parse(command))
        return self.reference

    def keep_apart(self, tick: int, neighbours: Neighbours) -> Reference:
        """Go out of the way of others where that is needed, and back to the leg when it no longer is.

        Args:
            tick: The tick that ended; the path holds from its end on.
            neighbours: All vehicles, as this one sees them.
        """
        if self.gives_way:
            self.notice = self._conduct.keep_apart(tick, neighbours) or self.notice
        return self.reference

    def end_tick(
        self, tick: int, position_world_m: Vec3, velocity_world_m_s: Vec3, *, yaw_rad: float, uprightness: float
    ) -> Reference:
        """Notice what happened, begin a task kept for after take-off, and decide whether the agent is asked.

        Args:
            tick: The tick that ends.
            position_world_m: True position, world frame [m].
            velocity_world_m_s: True velocity, world frame [m/s].
            yaw_rad: True heading [rad].
            uprightness: Cosine of the angle between the vehicle's z axis and the vertical.
        """
        self._course.saw(position_world_m, velocity_world_m_s, yaw_rad)
        self.notice = self._conduct.end_tick(tick, uprightness) or self.notice
        if self._kept_task is not None and self.phase != "taking_off":
            kept, self._kept_task = self._kept_task, None
            if self.phase == "holding":
                self._hear(tick, kept)
        self._decide_whether_to_ask(tick)
        return self.reference

    def _decide_whether_to_ask(self, tick: int) -> None:
        if self._agent.is_asked_every_tick:
            self.awaiting_command = self.phase != "failed"
            return
        has_nothing_to_do = self.phase in ("holding", "on_ground") and not self._course.ahead
        is_over = tick >= self._conduct.hold_until_tick
        self.awaiting_command = (has_nothing_to_do or self._course.goes_on) and is_over
        if self._agent.is_free and self.awaiting_command:
            self._ask_once(tick)

    # Time goes on whether the agent answers or not, and it need not hear the same question at every tick.
    def _ask_once(self, tick: int) -> None:
        self.awaiting_command = tick >= self._quiet_until_tick
        if self.awaiting_command:
            self._quiet_until_tick = tick + self._quiet_ticks

    def _obey(self, tick: int, task: Task) -> None:
        self.notice = None
        match task:
            case GoOn():
                return
            case GiveUp():
                self._conduct.fail(tick)
            case _:
                self._quiet_until_tick = 0
                self._hear(tick, task)

    def _hear(self, tick: int, task: Task) -> None:
        if self._is_said_again(task):
            self.notice = self._goal_notice
            return
        self.notice = self._refusal(tick, task)
        if self.notice is not None:
            self._kept_task = None
            self._conduct.hold(tick, self._usual_hold_s)
        elif isinstance(task, Hold):
            self._kept_task = None
            self._conduct.hold(tick, self._hold_s(task.hold_s), task.heading)
        elif self.phase == "taking_off":
            self._kept_task = task
        elif self.phase == "on_ground" and not _is_flown_by_agent(task):
            self._rise_for(tick, task)
        else:
            self._begin(tick, task)

    def _rise_for(self, tick: int, task: Task) -> None:
        is_all = isinstance(task, TakeOff)
        self.notice = self._conduct.take_off(tick)
        if self.phase == "taking_off":
            self._kept_task = None if is_all else task
            self._conduct.aim_at(task if is_all else None)
            self._goal_notice = self.notice

    def _begin(self, tick: int, task: Task) -> None:
        self._conduct.aim_at(task)
        match task:
            case Land():
                self._conduct.land(tick)
            case Cruise():
                hold_s = self._hold_s(task.hold_s)
                self._conduct.cruise(tick, task.velocity_world_m_s, task.heading, hold_s)
            case HandOver():
                self._conduct.hand_over(tick, task.setpoint, self._hold_s(task.hold_s))
            case GoTo():
                self.notice = self._conduct.set_out(tick, task.legs_with_hold(self._usual_hold_s))
            case _:
                raise AssertionError(f"expected a task to begin, was {task}")
        self._goal_notice = self.notice

    # An agent that may speak at every tick says the same again and again; a velocity is asked for after its hold time.
    def _is_said_again(self, task: Task) -> bool:
        if self._agent.mode_name == "on_request" or self._conduct.is_overturned:
            return False
        return task == self._conduct.goal

    def _refusal(self, tick: int, task: Task) -> str | None:
        if self._conduct.is_overturned:
            return OVERTURNED
        refusal = refusal_of(task, self._abilities, self._space, is_on_ground=self.phase == "on_ground")
        if refusal is not None:
            return refusal
        rises_to_m = self._agent.vehicle.search_height_m if self.phase in ("taking_off", "on_ground") else None
        edges = self._conduct.edges
        return refusal_from_here(tick, task, self._course, edges, rises_to_m=rises_to_m, avoids=self._avoids)

    @property
    def _usual_hold_s(self) -> float:
        return self._agent.vehicle.hold_s

    def _hold_s(self, hold_s: float | None) -> float:
        return self._usual_hold_s if hold_s is None else hold_s


# An agent that sets attitude or rates takes off by itself.
def _is_flown_by_agent(task: Task) -> bool:
    return isinstance(task, HandOver) and not isinstance(task.setpoint, DriveSetpoint)
