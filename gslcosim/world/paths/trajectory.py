"""The reference a vehicle follows: a minimum-jerk polynomial from one tick on, then rest or steady flight."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from gslcosim.quantities import Vec3
from gslcosim.ticks import seconds_from_ticks
from gslcosim.world.paths.quickest_kernels import plan_inplace
from gslcosim.world.paths.trajectory_kernels import polynomial_state

# Compiled functions take positional arguments only: what the flag of `plan_inplace` means.
_TO_POINT, _TO_VELOCITY = False, True
_NOTHING: Vec3 = (0.0, 0.0, 0.0)
# Ticks and durations that differ by less are the same instant.
_SAME_S = 1e-9


@dataclass(frozen=True, kw_only=True)
class Limits:
    """What a trajectory keeps to: greatest speed [m/s] and acceleration [m/s^2] of the reference."""

    max_speed_m_s: float
    max_acceleration_m_s2: float


@dataclass(frozen=True, kw_only=True)
class Heading:
    """Where a vehicle looks: along its path, or towards an angle from world x [rad]; neither: as before."""

    yaw_rad: float | None = None
    is_along_path: bool = False


AS_BEFORE = Heading()


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
    end_acceleration_world_m_s2: Vec3 = (0.0, 0.0, 0.0)
    forgets_integral: bool = False
    heading: Heading = AS_BEFORE

    def state_at(self, tick: int, tick_ns: int) -> NDArray[np.float64]:
        """Return the reference at the end of a tick as (3, 3): rows position [m], velocity [m/s], acceleration."""
        return self.state_after(seconds_from_ticks(tick - self.start_tick, tick_ns))

    def state_after(self, t_s: float) -> NDArray[np.float64]:
        """Return the reference at a time since the end of the start tick [s]; see `state_at`."""
        if t_s >= self.duration_s - _SAME_S:
            beyond_s = max(0.0, t_s - self.duration_s)
            velocity = np.array(self.end_velocity_world_m_s)
            acceleration = np.array(self.end_acceleration_world_m_s2) if beyond_s <= _SAME_S else np.zeros(3)
            return np.array([np.array(self.end_world_m) + beyond_s * velocity, velocity, acceleration])
        return polynomial_state(self.coefficients, t_s)

    def is_over(self, tick: int, tick_ns: int) -> bool:
        """Return whether the polynomial has ended at the end of a tick."""
        return seconds_from_ticks(tick - self.start_tick, tick_ns) >= self.duration_s - _SAME_S


def stay_at(
    position_world_m: Vec3, start_tick: int, *, duration_s: float = 0.0, forgets_integral: bool = False
) -> Trajectory:
    """Return the trajectory that rests at a point, world frame [m]; it counts as over after a duration [s]."""
    coefficients = np.zeros((3, 6))
    coefficients[:, 0] = position_world_m
    return Trajectory(
        start_tick=start_tick,
        coefficients=coefficients,
        duration_s=duration_s,
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
    return fly_through(start, np.array([end_world_m, _NOTHING, _NOTHING]), limits, start_tick)


def fly_through(
    start: NDArray[np.float64],
    end: NDArray[np.float64],
    limits: Limits,
    start_tick: int,
    *,
    least_s: float = 0.0,
    step_s: float = 0.0,
) -> Trajectory:
    """Return the quickest trajectory that reaches a state of motion and goes on with its velocity.

    Args:
        start: (3, 3) rows position [m], velocity [m/s], acceleration [m/s^2]; columns xyz, world frame.
        end: (3, 3) the same at the end.
        limits: Speed and acceleration kept to.
        start_tick: The tick at whose end it starts.
        least_s: It takes at least this long [s].
        step_s: It takes a whole multiple of this [s]; 0: any time.
    """
    coefficients, duration_s = _planned(start, end, limits, is_velocity=_TO_POINT, least_s=least_s, step_s=step_s)
    return Trajectory(
        start_tick=start_tick,
        coefficients=coefficients,
        duration_s=duration_s,
        end_world_m=_vec3(end[0]),
        end_velocity_world_m_s=_vec3(end[1]),
        end_acceleration_world_m_s2=_vec3(end[2]),
    )


def fly_at(start: NDArray[np.float64], velocity_world_m_s: Vec3, limits: Limits, start_tick: int) -> Trajectory:
    """Return the quickest trajectory that reaches a velocity and goes on with it; zero is a stop.

    Args:
        start: (3, 3) rows position [m], velocity [m/s], acceleration [m/s^2]; columns xyz, world frame.
        velocity_world_m_s: Velocity to reach, world frame [m/s].
        limits: Speed and acceleration kept to.
        start_tick: The tick at whose end it starts.
    """
    end = np.array([_NOTHING, velocity_world_m_s, _NOTHING])
    coefficients, duration_s = _planned(start, end, limits, is_velocity=_TO_VELOCITY)
    return Trajectory(
        start_tick=start_tick,
        coefficients=coefficients,
        duration_s=duration_s,
        end_world_m=_vec3(polynomial_state(coefficients, duration_s)[0]),
        end_velocity_world_m_s=velocity_world_m_s,
    )


def _planned(
    start: NDArray[np.float64],
    end: NDArray[np.float64],
    limits: Limits,
    *,
    is_velocity: bool,
    least_s: float = 0.0,
    step_s: float = 0.0,
) -> tuple[NDArray[np.float64], float]:
    coefficients = np.empty((3, 6))
    speed, acceleration = limits.max_speed_m_s, limits.max_acceleration_m_s2
    duration_s = plan_inplace(coefficients, start, end, is_velocity, speed, acceleration, least_s, step_s)
    return coefficients, float(duration_s)


def _vec3(row: NDArray[np.float64]) -> Vec3:
    x, y, z = row.tolist()
    return x, y, z
