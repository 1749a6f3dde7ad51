"""The reference a vehicle follows: a minimum-jerk polynomial from one tick on, then rest or steady flight."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from gslcosim.ticks import seconds_from_ticks
from gslcosim.world.trajectory_kernels import plan_inplace, polynomial_at

Vec3 = tuple[float, float, float]

# Compiled functions take positional arguments only: what the flag of `plan_inplace` means.
_TO_POINT, _TO_VELOCITY = False, True


@dataclass(frozen=True, kw_only=True)
class Limits:
    """What a trajectory keeps to: greatest speed [m/s] and acceleration [m/s^2] of the reference."""

    max_speed_m_s: float
    max_acceleration_m_s2: float


@dataclass(frozen=True, kw_only=True)
class Trajectory:
    """A polynomial from the end of `start_tick` on; after `duration_s` it goes on with `end_velocity_world_m_s`.

    `coefficients` is (3, 6): axis xyz, power 0 to 5, world frame [m/s^i]. `forgets_integral` clears what the controller
    has learned of steady forces: after pushing against an obstacle that is wrong.
    """

    start_tick: int
    coefficients: NDArray[np.float64] = field(repr=False)
    duration_s: float
    end_world_m: Vec3
    end_velocity_world_m_s: Vec3 = (0.0, 0.0, 0.0)
    forgets_integral: bool = False

    def state_at(self, tick: int, tick_ns: int) -> NDArray[np.float64]:
        """Return the reference at the end of a tick as (3, 3): rows position [m], velocity [m/s], acceleration."""
        t_s = seconds_from_ticks(tick - self.start_tick, tick_ns)
        if t_s >= self.duration_s:
            beyond_s = t_s - self.duration_s
            velocity = np.array(self.end_velocity_world_m_s)
            return np.array([np.array(self.end_world_m) + beyond_s * velocity, velocity, np.zeros(3)])
        return np.array([polynomial_at(self.coefficients, axis, t_s)[:3] for axis in range(3)]).T

    def is_over(self, tick: int, tick_ns: int) -> bool:
        """Return whether the polynomial has ended at the end of a tick."""
        return seconds_from_ticks(tick - self.start_tick, tick_ns) >= self.duration_s


def stay_at(position_world_m: Vec3, start_tick: int, *, forgets_integral: bool = False) -> Trajectory:
    """Return the trajectory that rests at a point, world frame [m]."""
    coefficients = np.zeros((3, 6))
    coefficients[:, 0] = position_world_m
    return Trajectory(
        start_tick=start_tick,
        coefficients=coefficients,
        duration_s=0.0,
        end_world_m=position_world_m,
        forgets_integral=forgets_integral,
    )


def fly_to(start: NDArray[np.float64], end_world_m: Vec3, limits: Limits, start_tick: int) -> Trajectory:
    """Return the quickest trajectory that comes to rest at a point.

    Args:
        start: (3, 3) rows position [m], velocity [m/s], acceleration [m/s^2]; columns xyz, world frame.
        end_world_m: Where it rests, world frame [m].
        limits: Speed and acceleration kept to.
        start_tick: The tick at whose end it starts.
    """
    coefficients = np.empty((3, 6))
    duration_s = plan_inplace(
        coefficients, start, np.array(end_world_m), _TO_POINT, limits.max_speed_m_s, limits.max_acceleration_m_s2
    )
    return Trajectory(
        start_tick=start_tick, coefficients=coefficients, duration_s=float(duration_s), end_world_m=end_world_m
    )


def fly_at(start: NDArray[np.float64], velocity_world_m_s: Vec3, limits: Limits, start_tick: int) -> Trajectory:
    """Return the quickest trajectory that reaches a velocity and goes on with it; zero is a stop.

    Args:
        start: (3, 3) rows position [m], velocity [m/s], acceleration [m/s^2]; columns xyz, world frame.
        velocity_world_m_s: Velocity to reach, world frame [m/s].
        limits: Speed and acceleration kept to.
        start_tick: The tick at whose end it starts.
    """
    coefficients = np.empty((3, 6))
    duration_s = plan_inplace(
        coefficients,
        start,
        np.array(velocity_world_m_s),
        _TO_VELOCITY,
        limits.max_speed_m_s,
        limits.max_acceleration_m_s2,
    )
    end_x_m, end_y_m, end_z_m = (float(polynomial_at(coefficients, axis, duration_s)[0]) for axis in range(3))
    return Trajectory(
        start_tick=start_tick,
        coefficients=coefficients,
        duration_s=float(duration_s),
        end_world_m=(end_x_m, end_y_m, end_z_m),
        end_velocity_world_m_s=velocity_world_m_s,
    )
