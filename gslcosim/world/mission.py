"""What one vehicle is doing: take off, fly to waypoints, hold, ask the agent; the state machine above the control."""

import math
from collections.abc import Sequence
from typing import Literal

from gslcosim.contract.messages import Command
from gslcosim.scenario.models import AgentSpec
from gslcosim.ticks import seconds_from_ticks, ticks_from_seconds
from gslcosim.world.space import FlightSpace
from gslcosim.world.trajectory import Limits, Trajectory, Vec3, fly_at, fly_to, stay_at

Phase = Literal["on_ground", "taking_off", "flying", "holding", "failed"]

# When a vehicle counts as being at its waypoint, and how long after the end of its trajectory it may take.
ARRIVED_WITHIN_M = 0.15
ARRIVED_BELOW_M_S = 0.2
GIVE_UP_AFTER_S = 10.0
BACK_OFF_M = 0.1

_AT_REST: Vec3 = (0.0, 0.0, 0.0)


class Mission:
    """The mission of one vehicle: which trajectory it follows, and when its agent is asked.

    A tick goes: `begin_tick` with the agent's command, physics along `trajectory`, `end_tick` with the true state.
    A command takes effect at the start of the tick.

    State: phase, trajectory, target or velocity, the tick until which it holds, a command kept for after take-off, the
    notice about a refused command (kept until the next command), and whether the vehicle has left the ground.
    """

    def __init__(self, agent: AgentSpec, space: FlightSpace, tick_ns: int) -> None:
        self._agent = agent
        self._space = space
        self._tick_ns = tick_ns
        vehicle = agent.vehicle
        self._limits = Limits(max_speed_m_s=vehicle.max_speed_m_s, max_acceleration_m_s2=vehicle.max_acceleration_m_s2)
        self.start(_AT_REST)

    def start(self, position_world_m: Vec3) -> None:
        """Return to the state at rest on the ground at tick 0."""
        self.trajectory: Trajectory = stay_at(position_world_m, 0)
        self.phase: Phase = "on_ground"
        self.target_world_m: Vec3 | None = None
        self._velocity_world_m_s: Vec3 | None = None
        self.awaiting_command = self._agent.is_asked_every_tick
        self.notice: str | None = None
        self.has_taken_off = False
        self._is_asked = False
        self._hold_ticks = 0
        self._hold_until_tick = 0
        self._kept_command: Command | None = None

    @property
    def waypoint_world_m(self) -> Vec3 | None:
        """Where the vehicle is going; nothing when it holds."""
        return self.target_world_m if self.phase in ("taking_off", "flying") else None

    def begin_tick(self, tick: int, command: Command | None) -> None:
        """Take off at the first tick and obey a command; the trajectory then holds for this tick.

        Args:
            tick: The tick that begins, >= 1.
            command: The agent's command that takes effect now, if there is one.
        """
        if self.phase == "on_ground":
            self._take_off(tick - 1)
        self._is_asked = False
        if command is None or self.phase == "failed":
            return
        self.notice = None
        if command.kind == "failed":
            self._fail(tick - 1)
        elif command.kind != "noop":
            self._obey(tick - 1, command)

    def end_tick(self, tick: int, position_world_m: Vec3, velocity_world_m_s: Vec3) -> None:
        """Notice an arrival and decide whether the agent is asked.

        Args:
            tick: The tick that ends.
            position_world_m: True position, world frame [m].
            velocity_world_m_s: True velocity, world frame [m/s].
        """
        if not self.has_taken_off and self.trajectory.is_over(tick, self._tick_ns):
            self.has_taken_off = True
        if self._velocity_world_m_s is not None:
            self._check_edge(tick)
        elif self.phase in ("taking_off", "flying"):
            self._check_arrival(tick, position_world_m, velocity_world_m_s)
        if self._agent.is_asked_every_tick:
            self.awaiting_command = self.phase != "failed"
            return
        is_free_to_ask = self.phase == "holding" or self._velocity_world_m_s is not None
        self.awaiting_command = is_free_to_ask and tick >= self._hold_until_tick
        self._is_asked = self.awaiting_command

    def _take_off(self, tick: int) -> None:
        x_m, y_m, _ = self.trajectory.end_world_m
        self._fly_to(tick, (x_m, y_m, self._agent.vehicle.search_height_m), self._agent.vehicle.hold_s)
        self.phase = "taking_off"

    def _obey(self, tick: int, command: Command) -> None:
        hold_s = self._agent.vehicle.hold_s if command.hold_s is None else command.hold_s
        if command.kind not in ("waypoint", "velocity"):
            self._hold(tick, hold_s)
            return
        self.notice = self._refusal(tick, command)
        if self.notice is not None:
            self._hold(tick, self._agent.vehicle.hold_s)
        elif self.phase == "taking_off":
            self._kept_command = command
        elif command.position_world_m is not None and command.kind == "waypoint":
            is_repeated = self._agent.is_asked_every_tick and command.position_world_m == self.target_world_m
            if not is_repeated:
                self._fly_to(tick, command.position_world_m, hold_s)
        elif command.velocity_world_m_s is not None:
            self._cruise(tick, command.velocity_world_m_s, hold_s)

    def _refusal(self, tick: int, command: Command) -> str | None:
        if command.kind == "waypoint" and command.position_world_m is not None:
            return self._space.refusal("waypoint", command.position_world_m)
        velocity_m_s = command.velocity_world_m_s or _AT_REST
        speed_m_s, most_m_s = math.hypot(*velocity_m_s), self._limits.max_speed_m_s
        if speed_m_s > most_m_s * (1 + 1e-9):
            return f"velocity: expected at most {most_m_s:g} m/s, was {speed_m_s:g} m/s."
        if self.phase == "taking_off" or velocity_m_s == self._velocity_world_m_s:
            return None
        return self._edge_ahead(tick, self._cruise_from(tick, velocity_m_s))

    def _fly_to(self, tick: int, waypoint_m: Vec3, hold_s: float) -> None:
        self.trajectory = fly_to(self.trajectory.state_at(tick, self._tick_ns), waypoint_m, self._limits, tick)
        self.target_world_m = waypoint_m
        self._velocity_world_m_s = None
        self.phase = "flying"
        self._hold_ticks = ticks_from_seconds(hold_s, self._tick_ns)

    def _cruise(self, tick: int, velocity_m_s: Vec3, hold_s: float) -> None:
        if velocity_m_s != self._velocity_world_m_s:
            self.trajectory = self._cruise_from(tick, velocity_m_s)
        self.target_world_m = None
        self._velocity_world_m_s = velocity_m_s
        self.phase = "flying"
        self._hold_until_tick = tick + ticks_from_seconds(hold_s, self._tick_ns)

    def _cruise_from(self, tick: int, velocity_m_s: Vec3) -> Trajectory:
        return fly_at(self.trajectory.state_at(tick, self._tick_ns), velocity_m_s, self._limits, tick)

    # A stop that begins a tick later must still end in free space.
    def _edge_ahead(self, tick: int, trajectory: Trajectory) -> str | None:
        state = trajectory.state_at(tick + 1, self._tick_ns)
        x_m, y_m, z_m = fly_at(state, _AT_REST, self._limits, tick).end_world_m
        u, v, w = state[1].tolist()
        return self._space.edge_ahead("velocity", (x_m, y_m, z_m), (u, v, w))

    def _check_edge(self, tick: int) -> None:
        edge = self._edge_ahead(tick, self.trajectory)
        if edge is not None:
            self._hold(tick, self._agent.vehicle.hold_s)
            self.notice = edge

    # A take-off is always finished: just above the floor is no place to hold.
    def _hold(self, tick: int, hold_s: float) -> None:
        if self.phase == "taking_off":
            self._kept_command = None
            return
        self._stop(tick)
        self.phase = "holding"
        self._hold_until_tick = tick + ticks_from_seconds(hold_s, self._tick_ns)

    # A stop under way is kept: planned anew at every tick it would never end.
    def _stop(self, tick: int) -> None:
        is_stopping = self.target_world_m is None and self.trajectory.end_velocity_world_m_s == _AT_REST
        self.target_world_m = None
        self._velocity_world_m_s = None
        if not is_stopping:
            self.trajectory = self._cruise_from(tick, _AT_REST)

    def _fail(self, tick: int) -> None:
        if self.phase != "taking_off":
            self._stop(tick)
        self.target_world_m = None
        self.phase = "failed"

    def _check_arrival(self, tick: int, position_m: Vec3, velocity_m_s: Sequence[float]) -> None:
        if not self.trajectory.is_over(tick, self._tick_ns):
            return
        end_m = self.trajectory.end_world_m
        distance_m = math.dist(position_m, end_m)
        if distance_m > ARRIVED_WITHIN_M or math.hypot(*velocity_m_s) >= ARRIVED_BELOW_M_S:
            late_s = seconds_from_ticks(tick - self.trajectory.start_tick, self._tick_ns) - self.trajectory.duration_s
            if late_s < GIVE_UP_AFTER_S:
                return
            self._give_up(tick, position_m, distance_m)
        self._arrive(tick)

    # A little back from where it got stuck, so that it no longer touches whatever is in the way.
    def _give_up(self, tick: int, position_m: Vec3, distance_m: float) -> None:
        back = BACK_OFF_M / distance_m if distance_m > ARRIVED_WITHIN_M else 0.0
        x_m, y_m, z_m = (p + back * (p - end) for p, end in zip(position_m, self.trajectory.end_world_m, strict=True))
        is_free = self._space.refusal("back", (x_m, y_m, z_m)) is None
        self.trajectory = stay_at((x_m, y_m, z_m) if is_free else position_m, tick, forgets_integral=True)
        self.notice = (
            f"waypoint: expected to arrive within {GIVE_UP_AFTER_S:g} s of the planned time, "
            f"was still {distance_m:.2f} m away; the vehicle holds there."
        )

    def _arrive(self, tick: int) -> None:
        kept, self._kept_command = self._kept_command, None
        self.phase = "holding"
        self._hold_until_tick = tick + self._hold_ticks
        if kept is not None:
            self._obey(tick, kept)
