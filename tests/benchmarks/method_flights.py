"""Runs of agent objects through a scripted room, for timing: no processes, no physics, the same for every method.

The room is 15 x 15 x 8 m with a map of 75 x 75 cells, a box in its middle, a wind that turns a little, and a patchy
plume. Vehicles fly straight at 1 m/s and hold; they observe at 10 Hz, all of them in turn, and hear each other.
"""

import base64
import math
import sys
import time
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "kit"))

from briefings import PLUME, briefing, observation

from gslcosim.agent_kit import Agent
from gslcosim.base.quantities import ESTIMATE_QUANTITY
from gslcosim.contract.messages import (
    Briefing,
    CameraImage,
    Command,
    KnownMap,
    Observation,
    RadioReception,
    Reading,
    SensorDescription,
)
from gslcosim.contract.record import NumericArray
from gslcosim.methods.card import CAMERA_QUANTITY, RANGE_QUANTITY, WIND_QUANTITY, MethodCard

Place = tuple[float, float, float]

ROOM_M: Place = (15.0, 15.0, 8.0)
MAP_CELL_M = 0.2
BOX_MIN_M, BOX_MAX_M = (6.6, 6.0), (8.4, 7.6)
SOURCE_M: Place = (2.5, 7.0, 2.0)
HEIGHT_M = 2.0
TICK_S = 0.1
SPEED_M_S, HOLD_S = 1.0, 2.0
# A mission over many places is one decision: of what is observed on the way no more than a minute counts.
COUNTED_TICKS = 600
MODEL_OF_KIND = {
    "gas": "pid", "gas_ppm": "pid", "gas_ohm": "tgs2600", "wind": "anemometer", "range": "four_range_finders",
    "camera": "camera",
}  # fmt: skip
# A grey picture of 8 x 8 pixels.
PICTURE = CameraImage(
    encoding="png",
    width_px=8,
    height_px=8,
    focal_px=6.0,
    centre_px=(4.0, 4.0),
    position_body_m=(0.1, 0.0, 0.0),
    quaternion_body_wxyz=(0.5, -0.5, 0.5, -0.5),
    taken_tick=0,
    data=base64.b64decode(
        "iVBORw0KGgoAAAANSUhEUgAAAAgAAAAICAIAAABLbSncAAAAFElEQVR4nGNsaGhgwAaYsIoOWgkAMBcBkGHHl6YAAAAASUVORK5CYII="
    ),
)


def map_of_room(*, is_3d: bool) -> KnownMap:
    """Return what is known of the room: 75 x 75 cells at the height of search, or 75 x 75 x 40."""
    shape = tuple(round(side_m / MAP_CELL_M) for side_m in ROOM_M)
    occupied = np.zeros(shape if is_3d else shape[:2], np.uint8)
    i0, j0, i1, j1 = (round(value / MAP_CELL_M) for value in (*BOX_MIN_M, *BOX_MAX_M))
    occupied[i0:i1, j0:j1] = 1
    return KnownMap(
        origin_m=(0.0, 0.0, 0.0 if is_3d else HEIGHT_M),
        cell_m=MAP_CELL_M,
        occupied=NumericArray.from_array(occupied),
        height_m=None if is_3d else HEIGHT_M,
    )


def robots_of(card: MethodCard) -> int:
    """Return how many robots fly: five where the method allows it, else as near to that as it does."""
    least, most = card.robots if isinstance(card.robots, tuple) else (card.robots, card.robots)
    return min(max(5, least), most)


def briefing_of(card: MethodCard, name: str, members: tuple[str, ...], seed: int) -> Briefing:
    """Return the briefing of a robot that has and knows all that its method needs.

    Several instruments of a kind sit to the left and right of the nose.
    """
    needs = card.needs
    sensors = [
        (MODEL_OF_KIND[kind], f"{kind}_{i}", (0.1, 0.25 - 0.5 * i if n > 1 else 0.0, 0.0))
        for kind, n in needs.sensors.items()
        for i in range(n)
    ]
    return briefing(
        sensors=sensors, name=name, seed=seed, size_m=ROOM_M, members=members if needs.radio else (), hold_s=HOLD_S,
        known_map=map_of_room(is_3d=card.dimensions == 3) if "map" in needs.knows else None,
        plume=PLUME if "plume" in needs.knows else None,
        known_sources=(SOURCE_M,) if "source" in needs.knows else (),
        time_limit_s=10_000.0, search_height_m=HEIGHT_M,
    )  # fmt: skip


class Air:
    """Wind from -x that turns slowly, and a plume with pauses; equal seeds give equal air."""

    def __init__(self, seed: int) -> None:
        self._rng = np.random.default_rng(seed)
        self._is_whiff = True

    def pass_tick(self) -> None:
        """Whiffs and pauses last for about a second."""
        if self._rng.random() < TICK_S:
            self._is_whiff = not self._is_whiff

    def upwind_rad(self, time_s: float) -> float:
        """Return where the wind comes from."""
        return math.pi + 0.3 * math.sin(time_s / 20.0) + 0.05 * float(self._rng.standard_normal())

    def ppm(self, place_m: Place) -> float:
        """Return the mixing ratio at a place."""
        along_m = place_m[0] - SOURCE_M[0]
        if along_m < 0.0 or not self._is_whiff:
            return 0.0
        width_m = 0.2 + 0.15 * along_m
        across = math.dist(place_m[1:], SOURCE_M[1:]) / width_m
        return 5.0 / (1.0 + along_m) * math.exp(-0.5 * across * across)


@dataclass
class Vehicle:
    """A robot and its agent: where it is, what it still flies to, and until when it holds [s]."""

    name: str
    agent: Agent
    sensors: tuple[SensorDescription, ...]
    position_m: Place
    targets_m: deque[Place] = field(default_factory=deque)
    velocity_m_s: Place = (0.0, 0.0, 0.0)
    until_s: float = 0.0
    hold_s: float = 0.0
    notice: str | None = None
    heard: list[RadioReception] = field(default_factory=list)
    spent_s: deque[float] = field(default_factory=lambda: deque(maxlen=COUNTED_TICKS))
    decided_s: float = 0.0
    n_belief_cells: int = 0

    def move(self, time_s: float) -> None:
        """Go on by a tick: along its velocity, to its next place, or not at all."""
        if any(self.velocity_m_s) and time_s < self.until_s:
            self._go([x + v * TICK_S for x, v in zip(self.position_m, self.velocity_m_s, strict=True)])
        elif self.targets_m:
            length_m = math.dist(self.targets_m[0], self.position_m)
            share = min(1.0, SPEED_M_S * TICK_S / length_m) if length_m > 0.0 else 1.0
            self._go([x + share * (end - x) for x, end in zip(self.position_m, self.targets_m[0], strict=True)])
            if share == 1.0:
                self.targets_m.popleft()
                self.until_s = time_s + (0.0 if self.targets_m else self.hold_s)

    @property
    def status(self) -> str:
        """What it does, in the words of an observation."""
        return "flying" if self.targets_m or any(self.velocity_m_s) else "holding"

    def is_asked(self, time_s: float) -> bool:
        """Whether it has done what it was asked to."""
        return not self.targets_m and time_s >= self.until_s - 1e-9

    def obey(self, command: Command, time_s: float) -> None:
        """Do what the agent says; places outside the room or in the box are refused."""
        self.notice, self.velocity_m_s = None, (0.0, 0.0, 0.0)
        self.hold_s = HOLD_S if command.hold_s is None else command.hold_s
        self.until_s = time_s + TICK_S
        if command.belief is not None:
            self.n_belief_cells = command.belief.probability.to_array().size
        if command.kind == "waypoint" and command.position_world_m is not None:
            self._set_out([command.position_world_m])
        elif command.kind == "mission":
            self._set_out([place.position_world_m for place in command.waypoints])
        elif command.kind == "velocity" and command.velocity_world_m_s is not None:
            self.velocity_m_s, self.until_s = command.velocity_world_m_s, time_s + max(self.hold_s, TICK_S)
        elif command.kind == "hold":
            self.until_s = time_s + max(self.hold_s, TICK_S)

    def _set_out(self, places_m: list[Place]) -> None:
        if all(is_free(place_m) for place_m in places_m):
            self.targets_m.extend(places_m)
        else:
            self.notice = "waypoint: expected a place in free air, was within an obstacle or outside of the room."

    def _go(self, place_m: list[float]) -> None:
        x_m, y_m, z_m = (min(max(x, 0.3), side - 0.3) for x, side in zip(place_m, ROOM_M, strict=True))
        self.position_m = (x_m, y_m, z_m)


def is_free(place_m: Place) -> bool:
    """Return whether a place is inside the room and outside the box."""
    in_room = all(0.2 <= x <= side - 0.2 for x, side in zip(place_m, ROOM_M, strict=True))
    return in_room and not all(low <= x <= high for x, low, high in zip(place_m, BOX_MIN_M, BOX_MAX_M))


def clock_s() -> float:
    """Return what asking the clock takes three times in a row, as around an observation: the least of many [s]."""
    least = math.inf
    for _ in range(200):
        began = time.thread_time()
        time.thread_time()
        least = min(least, time.thread_time() - began)
    return least


class Flight:
    """A method's robots in the scripted room; iterating yields what each decision took."""

    def __init__(self, agent_type: type[Agent], card: MethodCard, *, seed: int = 1) -> None:
        names = tuple(f"robot_{i}" for i in range(robots_of(card)))
        self._air = Air(seed)
        self._clock_s = clock_s()
        self.vehicles = []
        for i, name in enumerate(names):
            told = briefing_of(card, name, names, seed + i)
            place_m = (12.5, 2.5 + 2.0 * i, HEIGHT_M)
            self.vehicles.append(Vehicle(name=name, agent=agent_type(told), sensors=told.sensors, position_m=place_m))

    def decisions_s(self, *, max_time_s: float = 5000.0) -> Iterator[tuple[float, float]]:
        """Yield the processor time of each decision with the observations since the one before it, and alone [s]."""
        for tick in range(1, round(max_time_s / TICK_S)):
            self._air.pass_tick()
            sent: list[tuple[Vehicle, Command]] = []
            for vehicle in self.vehicles:
                vehicle.move(tick * TICK_S)
                command = self._ask(vehicle, tick)
                if command is not None:
                    yield sum(vehicle.spent_s), vehicle.decided_s
                    vehicle.spent_s.clear()
                    vehicle.obey(command, tick * TICK_S)
                    sent.append((vehicle, command))
            self._deliver(sent, tick)

    def _ask(self, vehicle: Vehicle, tick: int) -> Command | None:
        observation = self._observation(vehicle, tick)
        vehicle.heard.clear()
        began = time.thread_time()
        vehicle.agent.observe(observation)
        observed = time.thread_time()
        command = vehicle.agent.decide(observation) if observation.awaiting_command else None
        ended = time.thread_time()
        vehicle.spent_s.append(max(0.0, ended - began - self._clock_s))
        vehicle.decided_s = ended - observed
        return command

    def _deliver(self, sent: list[tuple[Vehicle, Command]], tick: int) -> None:
        for sender, command in sent:
            for message in command.outgoing:
                for vehicle in self.vehicles:
                    if vehicle is not sender and message.to in ("all", vehicle.name):
                        vehicle.heard.append(
                            RadioReception(
                                sender=sender.name, channel=message.channel, text=message.text, sent_tick=tick
                            )
                        )

    def _observation(self, vehicle: Vehicle, tick: int) -> Observation:
        time_s = tick * TICK_S
        return observation(
            tick=tick, name=vehicle.name, position_m=vehicle.position_m, velocity_m_s=vehicle.velocity_m_s,
            asked=vehicle.is_asked(time_s), notice=vehicle.notice, status=vehicle.status,
        ).model_copy(
            update={
                "readings": tuple(self._reading(each, vehicle, time_s) for each in vehicle.sensors),
                "incoming": tuple(vehicle.heard),
            }
        )  # fmt: skip

    def _reading(self, described: SensorDescription, vehicle: Vehicle, time_s: float) -> Reading:
        x_m, y_m, z_m = (a + b for a, b in zip(vehicle.position_m, described.mount_body_m, strict=True))
        ppm = self._air.ppm((x_m, y_m, z_m))
        values = {
            "mixing_ratio": (ppm,),
            ESTIMATE_QUANTITY: (ppm,),
            "resistance": (50_000.0 / (1.0 + ppm),),
            WIND_QUANTITY: (0.5, self._air.upwind_rad(time_s)),
            RANGE_QUANTITY: (ROOM_M[0] - x_m, ROOM_M[1] - y_m, x_m, y_m),
            CAMERA_QUANTITY: (),
        }[described.quantity]
        is_picture = described.quantity == CAMERA_QUANTITY
        return Reading(
            sensor=described.name,
            quantity=described.quantity,
            unit=described.unit,
            values=values,
            image=PICTURE if is_picture else None,
        )
