"""What an agent and its vehicle say to each other: commands obeyed, kept or refused, and when the agent is asked."""

from gslcosim.contract.messages import Command
from gslcosim.quantities import Vec3
from gslcosim.scenario.models.scenario import AgentSpec
from gslcosim.world.guidance.abilities import Abilities
from gslcosim.world.guidance.arrival import OVERTURNED
from gslcosim.world.guidance.avoidance import Avoidance
from gslcosim.world.guidance.conduct import Conduct, Phase
from gslcosim.world.guidance.refusals import refusal_from_here, refusal_of
from gslcosim.world.guidance.separation import Neighbours
from gslcosim.world.paths.legs import AT_REST, heading_of, legs_of
from gslcosim.world.paths.space import FlightSpace
from gslcosim.world.paths.trajectory import Trajectory
from gslcosim.world.physics.records import Setpoint

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


class Mission:
    """The mission of one vehicle: which path or setpoint it follows, and when its agent is asked.

    A tick goes: `begin_tick` with the agent's command, physics along `trajectory` or at `setpoint`, `end_tick` with the
    true state. A command takes effect at the start of the tick.

    State: what the vehicle does, see `Conduct`; a command kept for after take-off; the notice about a refused command,
    kept until the next command, and that about the command which is obeyed.
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
        self._avoids = avoidance is not None
        self._conduct = Conduct(agent.vehicle, space, abilities, tick_ns, avoidance=avoidance)
        self._course = self._conduct.course
        self.start(AT_REST)

    def start(self, position_world_m: Vec3) -> None:
        """Return to the state at rest on the ground at tick 0."""
        self._conduct.start(position_world_m)
        self.awaiting_command = self._agent.is_asked_every_tick
        self.notice: str | None = None
        self._goal_notice: str | None = None
        self._kept_command: Command | None = None

    @property
    def phase(self) -> Phase:
        """What the vehicle is doing."""
        return self._conduct.phase

    @property
    def is_armed(self) -> bool:
        """Whether rotors or wheels turn."""
        return self._conduct.is_armed

    @property
    def has_taken_off(self) -> bool:
        """Whether the vehicle has left its start; one on wheels always has."""
        return self._conduct.has_taken_off

    @property
    def trajectory(self) -> Trajectory:
        """The path to follow, unless there is a setpoint."""
        return self._course.trajectory

    @property
    def setpoint(self) -> Setpoint | None:
        """What to obey instead of the path."""
        return self._course.setpoint

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

    def begin_tick(self, tick: int, command: Command | None) -> None:
        """Leave the start at the first tick and obey a command; path or setpoint then hold for this tick.

        Args:
            tick: The tick that begins, >= 1.
            command: The agent's command that takes effect now, if there is one.
        """
        if tick == 1:
            self.notice = self._conduct.leave_start()
        if command is None or self.phase == "failed":
            return
        self.notice = None
        if command.kind == "failed":
            self._conduct.fail(tick - 1)
        elif command.kind != "noop":
            self._hear(tick - 1, command)

    def keep_apart(self, tick: int, neighbours: Neighbours) -> None:
        """Go out of the way of others where that is needed, and back to the leg when it no longer is.

        Args:
            tick: The tick that ended; the path holds from its end on.
            neighbours: All vehicles, as this one sees them.
        """
        if self.gives_way:
            self.notice = self._conduct.keep_apart(tick, neighbours) or self.notice

    def end_tick(
        self, tick: int, position_world_m: Vec3, velocity_world_m_s: Vec3, *, yaw_rad: float, uprightness: float
    ) -> None:
        """Notice what happened, obey a command kept for after take-off, and decide whether the agent is asked.

        Args:
            tick: The tick that ends.
            position_world_m: True position, world frame [m].
            velocity_world_m_s: True velocity, world frame [m/s].
            yaw_rad: True heading [rad].
            uprightness: Cosine of the angle between the vehicle's z axis and the vertical.
        """
        self._course.saw(position_world_m, velocity_world_m_s, yaw_rad)
        self.notice = self._conduct.end_tick(tick, uprightness) or self.notice
        if self._kept_command is not None and self.phase != "taking_off":
            kept, self._kept_command = self._kept_command, None
            if self.phase == "holding":
                self._hear(tick, kept)
        self._decide_whether_to_ask(tick)

    def _decide_whether_to_ask(self, tick: int) -> None:
        if self._agent.is_asked_every_tick:
            self.awaiting_command = self.phase != "failed"
            return
        has_nothing_to_do = self.phase in ("holding", "on_ground") and not self._course.ahead
        is_over = tick >= self._conduct.hold_until_tick
        self.awaiting_command = (has_nothing_to_do or self._course.goes_on) and is_over

    def _hear(self, tick: int, command: Command) -> None:
        if self._is_said_again(command):
            self.notice = self._goal_notice
            return
        self.notice = self._refusal(tick, command)
        is_hold = command.kind in ("hold", "declare_source")
        if self.notice is not None:
            self._kept_command = None
            self._conduct.hold(tick, self._agent.vehicle.hold_s)
        elif is_hold:
            self._kept_command = None
            self._conduct.hold(tick, self._hold_s(command), heading_of(command))
        elif self.phase == "taking_off":
            self._kept_command = command
        elif self.phase == "on_ground" and command.kind not in ("attitude", "rates"):
            self._rise_for(tick, command)
        else:
            self._obey(tick, command)

    def _rise_for(self, tick: int, command: Command) -> None:
        is_all = command.kind == "take_off"
        self.notice = self._conduct.take_off(tick)
        if self.phase == "taking_off":
            self._kept_command = None if is_all else command
            self._conduct.goal, self._goal_notice = command if is_all else None, self.notice

    def _obey(self, tick: int, command: Command) -> None:
        self._conduct.goal = command
        hold_s = self._hold_s(command)
        if command.kind == "land":
            self._conduct.land(tick)
        elif command.kind == "velocity" and command.velocity_world_m_s is not None:
            self._conduct.cruise(tick, command.velocity_world_m_s, heading_of(command), hold_s)
        elif setpoint := command.attitude or command.rates or command.drive:
            self._conduct.hand_over(tick, setpoint, hold_s)
        else:
            self.notice = self._conduct.set_out(tick, legs_of(command, hold_s))
        self._goal_notice = self.notice

    # An agent that is asked at every tick says the same again and again; a velocity is asked for after its hold time.
    def _is_said_again(self, command: Command) -> bool:
        goal = self._conduct.goal
        if goal is None or not self._agent.is_asked_every_tick or self._conduct.is_overturned:
            return False
        return all(getattr(command, name) == getattr(goal, name) for name in _GOAL_FIELDS)

    def _refusal(self, tick: int, command: Command) -> str | None:
        if self._conduct.is_overturned:
            return OVERTURNED
        refusal = refusal_of(command, self._abilities, self._space, is_on_ground=self.phase == "on_ground")
        if refusal is not None:
            return refusal
        rises_to_m = self._agent.vehicle.search_height_m if self.phase in ("taking_off", "on_ground") else None
        edges = self._conduct.edges
        return refusal_from_here(tick, command, self._course, edges, rises_to_m=rises_to_m, avoids=self._avoids)

    def _hold_s(self, command: Command) -> float:
        return self._agent.vehicle.hold_s if command.hold_s is None else command.hold_s
