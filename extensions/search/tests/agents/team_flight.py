"""Whole teams in flight without a run: straight legs at one speed, an analytic plume, and a radio that may lose texts.

Vehicles are points, asked when they hold, as in the mode `on_request`; who is lost is silent from then on.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
from briefings import briefing, observation

from gslcosim.agent_kit import Agent, Command, Observation, RadioReception


def plume(source=(3.0, 5.0), wind_m_s=(0.5, 0.0), width_m=0.35, growth=0.12, peak_ppm=20.0):
    """Return c(x, y): a Gaussian across the wind that widens with the way, and fades upwind of the source."""
    speed = math.hypot(*wind_m_s)
    along = (wind_m_s[0] / speed, wind_m_s[1] / speed)

    def ppm(x_m: float, y_m: float) -> float:
        dx, dy = x_m - source[0], y_m - source[1]
        s, n = dx * along[0] + dy * along[1], dy * along[0] - dx * along[1]
        sigma = width_m + growth * max(s, 0.0)
        upwind = math.exp(-0.5 * (min(s, 0.0) / width_m) ** 2)
        return peak_ppm * (width_m / sigma) * math.exp(-0.5 * (n / sigma) ** 2) * upwind

    return ppm


@dataclass
class Vehicle:
    name: str
    agent: Agent
    position_m: tuple[float, float, float]
    target_m: tuple[float, float, float] | None = None
    velocity_m_s: tuple[float, float, float] = (0.0, 0.0, 0.0)
    hold_s: float = 0.0
    rest_s: float = 0.0
    n_blocked: int = 0
    notice: str | None = None
    track_m: list[tuple[float, float]] = field(default_factory=list)
    commands: list[Command] = field(default_factory=list)

    @property
    def place_m(self) -> np.ndarray:
        return np.array(self.position_m[:2])

    @property
    def is_flying(self) -> bool:
        return self.target_m is not None or any(self.velocity_m_s)


class TeamFlight:
    """A team of agents of one kind on the channel `radio`; `lost_at_s` is when whose vehicle ends."""

    tick_s = 0.2
    max_bytes = 1024
    sensors = (("pid", "nose"), ("anemometer", "vane"))

    def __init__(
        self,
        kind: Callable[..., Agent],
        starts_m: Mapping[str, tuple[float, float]],
        *,
        gas: Callable[[float, float], float],
        wind_m_s=(0.5, 0.0),
        loss_frac: float = 0.0,
        seed: int = 1,
        height_m: float = 2.0,
        speed_m_s: float = 1.0,
        lost_at_s: Mapping[str, float] | None = None,
        refuses: Callable[[float, float], bool] = lambda _x, _y: False,
        **changes,
    ) -> None:
        self.gas, self.wind_m_s, self.height_m, self.speed_m_s = gas, wind_m_s, height_m, speed_m_s
        self.lost_at_s, self.refuses = dict(lost_at_s or {}), refuses
        self.loss_frac, self.rng = loss_frac, np.random.default_rng(seed)
        names = tuple(sorted(starts_m))
        self.briefings = {
            name: briefing(
                name=name, members=names, seed=seed * 100 + i, tick_ns=round(self.tick_s * 1e9),
                search_height_m=height_m, sensors=self.sensors, **changes,
            )
            for i, name in enumerate(names)
        }  # fmt: skip
        self.size_m = self.briefings[names[0]].bounds.max_m
        self.vehicles = {
            name: Vehicle(name, kind(self.briefings[name]), (*starts_m[name], height_m)) for name in names
        }  # fmt: skip
        self.air: dict[str, list[RadioReception]] = {name: [] for name in names}
        self.tick = 0
        self.declared: list[tuple[str, Command]] = []

    @property
    def time_s(self) -> float:
        return self.tick * self.tick_s

    def fly(self, time_s: float, until: Callable[["TeamFlight"], bool] = lambda _: False) -> float:
        """Fly until the time is over or a condition holds; return the time that has passed [s]."""
        while self.time_s < time_s and not until(self):
            self.step()
        return self.time_s

    def places_m(self):
        return np.array([vehicle.position_m[:2] for vehicle in self.flying().values()])

    def nearest_m(self, place_m) -> float:
        return float(np.hypot(*(self.places_m() - np.asarray(place_m)).T).min())

    def flying(self) -> dict[str, Vehicle]:
        now_s = self.time_s
        return {n: v for n, v in self.vehicles.items() if now_s < self.lost_at_s.get(n, math.inf)}

    def step(self) -> None:
        self.tick += 1
        incoming, self.air = self.air, {name: [] for name in self.vehicles}
        for name, vehicle in self.flying().items():
            self.move(vehicle)
            asked = vehicle.target_m is None and vehicle.rest_s <= 1e-9
            observation = self.observed(name, vehicle, incoming[name], asked=asked)
            vehicle.agent.observe(observation)
            if asked:
                self.take(name, vehicle, vehicle.agent.decide(observation))

    def readings(self, vehicle) -> dict[str, object]:
        x, y, _ = vehicle.position_m
        speed, upwind = math.hypot(*self.wind_m_s), math.atan2(-self.wind_m_s[1], -self.wind_m_s[0])
        return {"nose": self.gas(x, y), "vane": (speed, upwind)}

    def observed(self, name, vehicle, incoming, *, asked) -> Observation:
        return observation(
            tick=self.tick, time_s=self.time_s, name=name, position_m=vehicle.position_m,
            velocity_m_s=vehicle.velocity_m_s, readings=self.readings(vehicle), asked=asked, notice=vehicle.notice,
            status="flying" if vehicle.is_flying else "holding", incoming=tuple(incoming),
        )  # fmt: skip

    def take(self, name, vehicle, command) -> None:
        assert command.tick == self.tick
        vehicle.commands.append(command)
        vehicle.notice, vehicle.velocity_m_s = None, (0.0, 0.0, 0.0)
        hold_s = self.briefings[name].hold_s if command.hold_s is None else command.hold_s
        vehicle.rest_s = vehicle.hold_s = hold_s
        if command.kind == "waypoint":
            self.go(vehicle, command.position_world_m)
        elif command.kind == "velocity":
            vehicle.velocity_m_s = command.velocity_world_m_s
        elif command.kind == "declare_source":
            self.declared.append((name, command))
        for message in command.outgoing:
            assert len(message.text.encode()) <= self.max_bytes
            for other in self.vehicles:
                if other != name and message.to in ("all", other) and self.rng.random() >= self.loss_frac:
                    reception = RadioReception(
                        sender=name, channel=message.channel, text=message.text, sent_tick=self.tick
                    )
                    self.air[other].append(reception)

    def go(self, vehicle, target_m) -> None:
        inside = all(0.0 <= x <= size for x, size in zip(target_m, self.size_m))
        if not inside or self.refuses(target_m[0], target_m[1]):
            vehicle.notice = "the waypoint is not in free air"
            return
        vehicle.target_m = target_m

    def move(self, vehicle) -> None:
        vehicle.track_m.append(vehicle.position_m[:2])
        if vehicle.target_m is None:
            vehicle.rest_s -= self.tick_s
            moved = (x + v * self.tick_s for x, v in zip(vehicle.position_m, vehicle.velocity_m_s))
            vehicle.position_m = tuple(min(max(x, 0.0), size) for x, size in zip(moved, self.size_m))
            return
        away = math.dist(vehicle.position_m, vehicle.target_m)
        share = min(1.0, self.speed_m_s * self.tick_s / away) if away > 0.0 else 1.0
        vehicle.position_m = tuple(a + share * (b - a) for a, b in zip(vehicle.position_m, vehicle.target_m))
        if share >= 1.0:
            vehicle.target_m, vehicle.rest_s = None, vehicle.hold_s
