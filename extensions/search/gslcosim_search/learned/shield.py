"""Obstacle shield: keeps commanded velocities off what range finders see."""

from collections.abc import MutableSequence, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gslcosim.base.errors import UsageError
from gslcosim.base.scalar_kernels import scalar_kernel
from gslcosim.contract.messages import Briefing

# After the time for which a velocity is kept, a vehicle has to brake.
BRAKES_IN_S = 0.5
_PASSES = 3
_LEAST_CLOSENESS = 1e-3
_LEAST_SPEED_M_S = 1e-3
# Rays that look up or down see floors and ceilings.
_MOST_RISE = 0.3


@scalar_kernel
def shield_velocity(
    velocity: MutableSequence[float],
    numbers: Any,
    columns: Sequence[int],
    directions: Sequence[Sequence[float]],
    yaw_sin: float,
    yaw_cos: float,
    keep_m: float,
    reach_m: float,
) -> None:
    """Change a velocity into a near one that leads into nothing that range finders see.

    u . d <= max(0, r - keep) / reach        for each ray of direction d and range r

    What a ray forbids is taken away along the ray, three times over all rays; what then is still forbidden, by slowing
    down.

    Args:
        velocity: (2,) or (3,) u, in units of the highest speed, world frame; changed.
        numbers: Of the observation, with closenesses of ranges.
        columns: (n,) where those stand.
        directions: (n, 2) of the rays in the plane, body frame.
        yaw_sin: Sine of the vehicle's yaw.
        yaw_cos: Its cosine.
        reach_m: How far the highest speed leads until the vehicle stands [m].

    Held by:
        extensions/search/tests/unit/learned/test_shield.py
    """
    for n_pass in range(_PASSES + 1):
        slowed = 1.0
        for n in range(len(columns)):
            x = yaw_cos * directions[n][0] - yaw_sin * directions[n][1]
            y = yaw_sin * directions[n][0] + yaw_cos * directions[n][1]
            closeness = max(float(numbers[columns[n]]), _LEAST_CLOSENESS)
            allowed = max(1.0 / closeness - 1.0 - keep_m, 0.0) / reach_m
            towards = velocity[0] * x + velocity[1] * y
            if towards > allowed:
                if n_pass < _PASSES:
                    velocity[0] -= (towards - allowed) * x
                    velocity[1] -= (towards - allowed) * y
                else:
                    slowed = min(slowed, allowed / towards)
        if n_pass == _PASSES:
            velocity[0] *= slowed
            velocity[1] *= slowed


class VelocityShield:
    """The shield of one agent's velocities, by its range finders.

    Args:
        briefing: Of the agent.
        names: `ObservationVector.names` of the agent.
        keep_m: Distance to keep from obstacles [m].
        speed_m_s: The highest speed [m/s].
        hold_s: How long a velocity is kept [s]; absent: the briefing's.

    Attributes:
        columns: (n,) where the rays stand in an observation.
        directions: (n, 2) of the rays in the plane, body frame.
        reach_m: How far the highest speed leads until the vehicle stands [m].

    Raises:
        UsageError: the agent has no range finder that looks to a side.
    """

    def __init__(
        self, briefing: Briefing, names: Sequence[str], *, keep_m: float, speed_m_s: float, hold_s: float | None
    ) -> None:
        columns: list[int] = []
        directions: list[tuple[float, float]] = []
        for sensor in briefing.sensors:
            # Of a lidar's many rays only the nearest of each sector is observed.
            if sensor.quantity != "range" or sensor.directions_body is None or len(sensor.directions_body.shape) != 2:
                continue
            for i, (x, y, z) in enumerate(sensor.directions_body.to_array().tolist()):
                if abs(z) < _MOST_RISE:
                    columns.append(names.index(f"{sensor.name}.closeness_{i}"))
                    directions.append((x, y))
        if not columns:
            raise UsageError(
                "shield_m: expected range finders that look to the sides among the sensors, found none. Add "
                "four_range_finders, or leave the shield out."
            )
        self.columns, self.directions = tuple(columns), tuple(directions)
        self.keep_m = keep_m
        self.reach_m = max(speed_m_s, _LEAST_SPEED_M_S) * (
            (briefing.hold_s if hold_s is None else hold_s) + BRAKES_IN_S
        )
        self.yaw = (names.index("yaw_sin"), names.index("yaw_cos"))

    def shielded(self, action: Sequence[float], numbers: NDArray[np.float32]) -> NDArray[np.float64]:
        """Return the velocity that may be flown.

        Args:
            action: (2,) or (3,) velocity in units of the highest speed, world frame.
            numbers: The observation upon which it was chosen.
        """
        velocity = [float(number) for number in action]
        sin, cos = (float(numbers[i]) for i in self.yaw)
        shield_velocity(velocity, numbers, self.columns, self.directions, sin, cos, self.keep_m, self.reach_m)
        return np.array(velocity)
