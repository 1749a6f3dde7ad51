"""A swarm of real agents in a toy world: point robots at a given speed, a field that does not change, a radio.

Everything is in one plane. Rectangles (x0, y0, x1, y1) are solid: legs and velocities end before them, and are counted.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from briefings import briefing

from gslcosim.agent_kit import Agent, Briefing, Command, Observation, RadioReception, Reading
from gslcosim.contract.messages import ChannelDescription

TICK_S = 0.1
SPEED_M_S = 1.0
HEIGHT_M = 1.0
LIMIT_M = 4.0
SENSORS = (("pid", "nose"), ("anemometer", "vane"), ("four_range_finders", "around"))
Rectangle = tuple[float, float, float, float]


def hill(x_m: float, y_m: float, width_m: float = 3.0, ppm: float = 100.0) -> Callable[[float, float], float]:
    """A static Gaussian field with its top at a place."""
    return lambda x, y: ppm * math.exp(-((x - x_m) ** 2 + (y - y_m) ** 2) / (2.0 * width_m**2))


@dataclass
class Robot:
    agent: Agent
    name: str
    place_m: np.ndarray
    status: str = "holding"
    target_m: np.ndarray | None = None
    velocity_m_s: np.ndarray = field(default_factory=lambda: np.zeros(2))
    hold_until_s: float = 0.0
    notice: str | None = None
    incoming: list[RadioReception] = field(default_factory=list)
    commands: list[Command] = field(default_factory=list)
    track_m: list[tuple[float, float]] = field(default_factory=list)
    n_blocked: int = 0
    hold_s: float = 0.0


class ToySwarm:
    def __init__(
        self,
        agent_type: Callable[[Briefing], Agent],
        starts_m: Sequence[tuple[float, float]],
        gas: Callable[[float, float], float],
        *,
        size_m: tuple[float, float] = (15.0, 15.0),
        solid: Sequence[Rectangle] = (),
        seed: int = 1,
        parameters: Mapping[str, object] | None = None,
        wind_m_s: tuple[float, float] = (0.5, 0.0),
        loss_frac: float = 0.0,
        hold_s: float = 0.5,
        speed_m_s: float = SPEED_M_S,
    ) -> None:
        names = [f"robot_{i + 1}" for i in range(len(starts_m))]
        channel = ChannelDescription(name="radio", members=tuple(names), range_m=None, delay_ticks=1, max_bytes=64)
        self.gas, self.size_m, self.solid, self.wind_m_s = gas, size_m, tuple(solid), wind_m_s
        self.loss_frac, self.speed_m_s = loss_frac, speed_m_s
        self.rng = np.random.default_rng(seed)
        self.tick = 0
        self.robots = [
            Robot(
                agent_type(
                    briefing(
                        name=name, sensors=SENSORS, seed=100 * seed + i, size_m=(*size_m, 3.0), parameters=parameters,
                        channels=(channel,), search_height_m=HEIGHT_M, hold_s=hold_s,
                    )
                ),
                name,
                np.array(start_m, dtype=np.float64),
                hold_s=hold_s,
            )
            for i, (name, start_m) in enumerate(zip(names, starts_m))
        ]  # fmt: skip

    @property
    def time_s(self) -> float:
        return self.tick * TICK_S

    @property
    def declarations(self):
        return [
            command.declaration
            for robot in self.robots
            for command in robot.commands
            if command.declaration is not None
        ]

    def fly(self, until_s: float, stop: Callable[["ToySwarm"], bool] = lambda swarm: False) -> bool:
        """Fly until a time; return whether the condition to stop came before."""
        while self.time_s < until_s:
            self.step()
            if stop(self):
                return True
        return False

    def step(self) -> None:
        self.tick += 1
        for robot in self.robots:
            self._move(robot)
        sent: list[tuple[str, str]] = []
        for robot in self.robots:
            observation = self._observation(robot)
            robot.incoming, robot.notice = [], None
            robot.agent.observe(observation)
            if observation.awaiting_command:
                command = robot.agent.decide(observation)
                robot.commands.append(command)
                self._take(robot, command)
                sent += [(robot.name, message.text) for message in command.outgoing]
        for sender, text in sent:
            assert len(text.encode()) <= 64
            for robot in self.robots:
                if robot.name != sender and self.rng.random() >= self.loss_frac:
                    robot.incoming.append(
                        RadioReception(sender=sender, channel="radio", text=text, sent_tick=self.tick)
                    )

    def ranges_m(self, place_m: np.ndarray) -> list[float]:
        """Distances to the room and to what is solid: front (+x), left, back, right."""
        return [self._range_m(place_m, *direction) for direction in ((1, 0), (0, 1), (-1, 0), (0, -1))]

    def _range_m(self, place_m: np.ndarray, dx: int, dy: int) -> float:
        axis, sign = (0, dx) if dx else (1, dy)
        at, across = place_m[axis], place_m[1 - axis]
        nearest = self.size_m[axis] - at if sign > 0 else at
        for rectangle in self.solid:
            low, high = rectangle[axis], rectangle[2 + axis]
            if rectangle[1 - axis] <= across <= rectangle[3 - axis]:
                gap = low - at if sign > 0 else at - high
                if gap >= 0:
                    nearest = min(nearest, gap)
        return min(nearest, LIMIT_M)

    def is_free(self, place_m: Sequence[float]) -> bool:
        inside = all(0.05 <= x <= side - 0.05 for x, side in zip(place_m, self.size_m))
        return inside and not any(x0 <= place_m[0] <= x1 and y0 <= place_m[1] <= y1 for x0, y0, x1, y1 in self.solid)

    def _move(self, robot: Robot) -> None:
        if robot.status == "flying" and robot.target_m is not None:
            way_m = robot.target_m - robot.place_m
            distance_m, step_m = float(np.hypot(*way_m)), self.speed_m_s * TICK_S
            goal_m = robot.target_m if distance_m <= step_m else robot.place_m + way_m * step_m / distance_m
        else:
            goal_m = robot.place_m + robot.velocity_m_s * TICK_S
        if self.is_free(goal_m):
            robot.place_m = np.array(goal_m)
        else:
            robot.n_blocked += 1
            robot.target_m = None if robot.target_m is None else robot.place_m.copy()
            robot.velocity_m_s = np.zeros(2)
        if robot.status == "flying" and robot.target_m is not None and np.array_equal(robot.place_m, robot.target_m):
            robot.status, robot.target_m, robot.hold_until_s = "holding", None, self.time_s + robot.hold_s
        robot.track_m.append((float(robot.place_m[0]), float(robot.place_m[1])))

    def _take(self, robot: Robot, command: Command) -> None:
        robot.velocity_m_s, robot.target_m = np.zeros(2), None
        hold_s = 0.5 if command.hold_s is None else command.hold_s
        if command.kind == "waypoint":
            assert command.position_world_m is not None
            if self.is_free(command.position_world_m[:2]):
                robot.status, robot.target_m = "flying", np.array(command.position_world_m[:2])
                robot.hold_s = hold_s
                return
            robot.notice = "in something solid"
        elif command.kind == "velocity":
            assert command.velocity_world_m_s is not None
            robot.velocity_m_s = np.array(command.velocity_world_m_s[:2])
            assert np.hypot(*robot.velocity_m_s) <= self.speed_m_s + 1e-9
        robot.status = "flying" if command.kind == "velocity" else "holding"
        robot.hold_until_s = self.time_s + hold_s

    def _observation(self, robot: Robot) -> Observation:
        x_m, y_m = map(float, robot.place_m)
        wind_m_s, upwind_rad = math.hypot(*self.wind_m_s), math.atan2(-self.wind_m_s[1], -self.wind_m_s[0])
        values = {"nose": (self.gas(x_m, y_m),), "vane": (wind_m_s, upwind_rad), "around": self.ranges_m(robot.place_m)}
        return Observation(
            tick=self.tick,
            agent=robot.name,
            time_s=self.time_s,
            position_world_m=(x_m, y_m, HEIGHT_M),
            yaw_rad=0.0,
            velocity_world_m_s=(0.0, 0.0, 0.0),
            status=robot.status,
            awaiting_command=robot.target_m is None and self.time_s >= robot.hold_until_s - 1e-9,
            readings=tuple(
                Reading(sensor=name, quantity="any", unit="any", values=tuple(value)) for name, value in values.items()
            ),
            notice=robot.notice,
            incoming=tuple(robot.incoming),
        )
