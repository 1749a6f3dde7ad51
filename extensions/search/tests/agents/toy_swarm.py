"""A swarm of real agents in a toy world: a team at a given speed in a field that does not change, among what is solid.

Everything is in one plane. Rectangles (x0, y0, x1, y1) are solid: legs and velocities end before them, and are counted.
"""

import math
from collections.abc import Callable, Mapping, Sequence

from team_flight import TeamFlight, Vehicle

from gslcosim.agent_kit import Agent, Briefing
from gslcosim.contract.messages import ChannelDescription

SPEED_M_S = 1.0
LIMIT_M = 4.0
Rectangle = tuple[float, float, float, float]


def hill(x_m: float, y_m: float, width_m: float = 3.0, ppm: float = 100.0) -> Callable[[float, float], float]:
    """A static Gaussian field with its top at a place."""
    return lambda x, y: ppm * math.exp(-((x - x_m) ** 2 + (y - y_m) ** 2) / (2.0 * width_m**2))


class ToySwarm(TeamFlight):
    tick_s = 0.1
    max_bytes = 64
    sensors = (*TeamFlight.sensors, ("four_range_finders", "around"))

    def __init__(
        self,
        agent_type: Callable[[Briefing], Agent],
        starts_m: Sequence[tuple[float, float]],
        gas: Callable[[float, float], float],
        *,
        size_m: tuple[float, float] = (15.0, 15.0),
        solid: Sequence[Rectangle] = (),
        parameters: Mapping[str, object] | None = None,
        hold_s: float = 0.5,
        speed_m_s: float = SPEED_M_S,
        **changes: object,
    ) -> None:
        starts = {f"robot_{i + 1}": start_m for i, start_m in enumerate(starts_m)}
        channel = ChannelDescription(
            name="radio", members=tuple(starts), range_m=None, delay_ticks=1, max_bytes=self.max_bytes
        )
        self.solid = tuple(solid)
        super().__init__(
            agent_type, starts, gas=gas, height_m=1.0, speed_m_s=speed_m_s, size_m=(*size_m, 3.0),
            refuses=lambda x, y: not self.is_free((x, y)), parameters=parameters, channels=(channel,), hold_s=hold_s,
            **changes,
        )  # fmt: skip

    @property
    def robots(self) -> list[Vehicle]:
        return list(self.vehicles.values())

    @property
    def declarations(self):
        return [command.declaration for _, command in self.declared]

    def fly(self, until_s: float, stop: Callable[["ToySwarm"], bool] = lambda swarm: False) -> bool:
        """Fly until a time; return whether the condition to stop came before."""
        while self.time_s < until_s:
            self.step()
            if stop(self):
                return True
        return False

    def readings(self, vehicle: Vehicle) -> dict[str, object]:
        return {**super().readings(vehicle), "around": self.ranges_m(vehicle.position_m)}

    def ranges_m(self, place_m: Sequence[float]) -> list[float]:
        """Distances to the room and to what is solid: front (+x), left, back, right."""
        return [self._range_m(place_m, *direction) for direction in ((1, 0), (0, 1), (-1, 0), (0, -1))]

    def _range_m(self, place_m: Sequence[float], dx: int, dy: int) -> float:
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

    def move(self, vehicle: Vehicle) -> None:
        before_m, target_m = vehicle.position_m, vehicle.target_m
        super().move(vehicle)
        if not self.is_free(vehicle.position_m[:2]):
            vehicle.n_blocked += 1
            vehicle.position_m, vehicle.velocity_m_s = before_m, (0.0, 0.0, 0.0)
            if target_m is not None:
                vehicle.target_m, vehicle.rest_s = None, vehicle.hold_s
