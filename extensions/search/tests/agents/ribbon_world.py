"""A plume on paper and a vehicle on rails: an agent flies through a scripted ribbon of gas, without a simulation."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field

from briefings import briefing, observation

from gslcosim.agent_kit import Agent, Briefing, Command, Observation

TICK_S = 0.1
FOUND_M = 1.0


@dataclass(frozen=True, kw_only=True)
class Ribbon:
    """Gas in a ribbon downwind (+x) of a source that winds like a wave carried by the wind, in blobs if wanted.

    Its half width grows as half_m + spread * distance, and so does its half depth about `height_m` where one is given;
    the mixing ratio, `ppm` at the source, falls as the width grows where it `fades`;
    blobs of `blob_m` with gaps of `gap_m` drift with the wind.
    """

    source_m: tuple[float, float] = (2.0, 5.0)
    wind_m_s: float = 0.5
    ppm: float = 2.0
    half_m: float = 0.15
    spread: float = 0.05
    wave_m: float = 0.0
    wave_length_m: float = 8.0
    blob_m: float = 1.0
    gap_m: float = 0.0
    height_m: float | None = None
    fades: bool = False
    has_gas: bool = True

    def gas_ppm(self, x_m: float, y_m: float, z_m: float, time_s: float) -> float:
        along_m = x_m - self.source_m[0]
        half_m = self.half_m + self.spread * along_m
        if not self.has_gas or along_m < 0.0:
            return 0.0
        if self.height_m is not None and abs(z_m - self.height_m) > half_m:
            return 0.0
        drift_m = along_m - self.wind_m_s * time_s
        if self.gap_m and drift_m % (self.blob_m + self.gap_m) > self.blob_m:
            return 0.0
        # At the source the wave is pinned.
        wave_m = self.wave_m * min(1.0, along_m / 3.0) * math.sin(math.tau * drift_m / self.wave_length_m)
        ppm = self.ppm * self.half_m / half_m if self.fades else self.ppm
        return ppm if abs(y_m - self.source_m[1] - wave_m) <= half_m else 0.0


@dataclass(frozen=True, kw_only=True)
class Cloud:
    """Gas in still air: bursts around a source, rarer and weaker with the distance, at random by place and time."""

    source_m: tuple[float, float] = (2.0, 5.0)
    wind_m_s: float = 0.0
    ppm: float = 10.0
    half_m: float = 1.0

    def gas_ppm(self, x_m: float, y_m: float, z_m: float, time_s: float) -> float:
        near = 1.0 / (1.0 + (math.hypot(x_m - self.source_m[0], y_m - self.source_m[1]) / self.half_m) ** 2)
        # A number in [0, 1) that a change of a second or a decimetre makes again.
        chance = math.modf(
            abs(math.sin(12.9898 * round(time_s) + 78.233 * round(10 * x_m) + round(10 * y_m))) * 43758.5
        )
        return self.ppm * near * (0.5 + chance[0]) if chance[0] < 0.2 + 0.8 * near else 0.0


@dataclass
class Mox:
    """Ohms of a first-order sensor with the figures of a TGS2600 in ethanol."""

    ratio: float = 1.0

    def ohm(self, ppm: float) -> float:
        target = min(1.0, 0.6796 * ppm**-0.3196) if ppm > 0.0 else 1.0
        tau_s = 4.8 if target < self.ratio else 18.75
        self.ratio += (1.0 - math.exp(-TICK_S / tau_s)) * (target - self.ratio)
        return 50_000.0 * self.ratio


def estimate_ppm(ohm: float) -> float:
    ratio = ohm / 50_000.0
    return 0.0 if ratio >= 1.0 - 1e-9 else (ratio / 0.6796) ** (-1.0 / 0.3196)


@dataclass
class Flight:
    """How a flight went: whether and when the source was met, where it was at each tick, what was declared."""

    found_s: float | None = None
    track_m: list[tuple[float, float, float]] = field(default_factory=list)
    commands: list[Command] = field(default_factory=list)

    @property
    def length_m(self) -> float:
        return sum(math.dist(a, b) for a, b in zip(self.track_m, self.track_m[1:]))


class Rails:
    """A vehicle that goes straight to waypoints at `speed_m_s` and holds there, or keeps a commanded velocity."""

    def __init__(self, agent_briefing: Briefing, start_m: tuple[float, float, float], speed_m_s: float) -> None:
        self.briefing, self.speed_m_s = agent_briefing, speed_m_s
        self.position_m, self.yaw_rad, self.velocity_m_s = start_m, 0.0, (0.0, 0.0, 0.0)
        self.target_m: tuple[float, float, float] | None = None
        self.hold_s, self.notice = agent_briefing.hold_s, None

    @property
    def is_asked(self) -> bool:
        return self.target_m is None and self.hold_s <= 1e-9

    def obey(self, command: Command, refuses: Callable[[tuple[float, float, float]], bool]) -> None:
        self.notice = None
        self.hold_s = self.briefing.hold_s if command.hold_s is None else command.hold_s
        self.yaw_rad = self.yaw_rad if command.yaw_rad is None else command.yaw_rad
        if command.kind == "waypoint":
            assert command.position_world_m is not None
            self.velocity_m_s = (0.0, 0.0, 0.0)
            if refuses(command.position_world_m):
                self.notice = "waypoint: in an obstacle"
            else:
                self.target_m = command.position_world_m
        elif command.kind == "velocity":
            assert command.velocity_world_m_s is not None
            self.velocity_m_s = command.velocity_world_m_s
            self.hold_s = max(self.hold_s, TICK_S)

    def move(self) -> None:
        if self.target_m is not None:
            left_m = math.dist(self.position_m, self.target_m)
            part = min(1.0, self.speed_m_s * TICK_S / left_m) if left_m else 1.0
            self.position_m = tuple(a + part * (b - a) for a, b in zip(self.position_m, self.target_m))
            self.target_m = None if part == 1.0 else self.target_m
            return
        self.hold_s -= TICK_S
        low_m, high_m = self.briefing.bounds.min_m, self.briefing.bounds.max_m
        moved = (a + v * TICK_S for a, v in zip(self.position_m, self.velocity_m_s))
        self.position_m = tuple(max(low, min(high, x)) for x, low, high in zip(moved, low_m, high_m))


def fly(
    agent_type: type[Agent],
    plume: Ribbon | Cloud,
    *,
    nose: str = "pid",
    start_m: tuple[float, float, float] = (16.0, 5.0, 2.0),
    size_m: tuple[float, float, float] = (20.0, 10.0, 4.0),
    mounts_m: tuple[tuple[float, float, float], ...] = ((0.0, 0.0, 0.0),),
    has_vane: bool = True,
    seed: int = 1,
    limit_s: float = 200.0,
    hold_s: float = 1.0,
    parameters: dict | None = None,
    refuses: Callable[[tuple[float, float, float]], bool] = lambda place: False,
    found_m: float = FOUND_M,
    **changes: object,
) -> Flight:
    """Fly an agent until it is near the source in the plane, or time is up."""
    names = [f"nose{i}" for i in range(len(mounts_m))]
    sensors = [(nose, name, mount) for name, mount in zip(names, mounts_m)]
    agent_briefing = briefing(
        sensors=[*sensors, *([("anemometer", "vane")] if has_vane else [])], size_m=size_m, seed=seed, hold_s=hold_s,
        parameters=parameters, time_limit_s=limit_s, **changes,
    )  # fmt: skip
    agent, rails, flight = agent_type(agent_briefing), Rails(agent_briefing, start_m, 1.0), Flight()
    elements = [Mox() for _ in names]
    for tick in range(1, round(limit_s / TICK_S)):
        seen = _observation(tick, rails, plume, nose, mounts_m, elements, has_vane=has_vane)
        agent.observe(seen)
        flight.track_m.append(rails.position_m)
        if math.dist(rails.position_m[:2], plume.source_m) < found_m:
            flight.found_s = seen.time_s
            break
        if seen.awaiting_command:
            flight.commands.append(agent.decide(seen))
            rails.obey(flight.commands[-1], refuses)
        rails.move()
    return flight


def _observation(tick, rails, plume, nose, mounts_m, elements, *, has_vane) -> Observation:
    time_s, (x_m, y_m, z_m), yaw = tick * TICK_S, rails.position_m, rails.yaw_rad
    readings: dict[str, object] = {}
    for i, (mount_m, element) in enumerate(zip(mounts_m, elements)):
        nose_x_m = x_m + math.cos(yaw) * mount_m[0] - math.sin(yaw) * mount_m[1]
        nose_y_m = y_m + math.sin(yaw) * mount_m[0] + math.cos(yaw) * mount_m[1]
        ppm = plume.gas_ppm(nose_x_m, nose_y_m, z_m, time_s)
        if nose.startswith("tgs"):
            ohm = element.ohm(ppm)
            readings |= {f"nose{i}": ohm, f"nose{i}_ppm": estimate_ppm(ohm)}
        else:
            readings[f"nose{i}"] = float(ppm > 0.0) if nose == "binary" else ppm
    if has_vane:
        vx, vy = rails.velocity_m_s[:2]
        apparent = (plume.wind_m_s - vx, -vy)
        readings["vane"] = (math.hypot(*apparent), math.atan2(-apparent[1], -apparent[0]))
    status = "flying" if rails.target_m is not None or any(rails.velocity_m_s) else "holding"
    return observation(
        tick=tick, position_m=rails.position_m, readings=readings, yaw_rad=yaw, velocity_m_s=rails.velocity_m_s,
        asked=rails.is_asked, notice=rails.notice, status=status,
    )  # fmt: skip
