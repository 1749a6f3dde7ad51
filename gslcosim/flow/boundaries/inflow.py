"""Inflow of an inlet: profiles over its cells and schedules over time."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gslcosim.base.errors import FlowError
from gslcosim.base.quantities import Vec3

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]

Profile = Callable[[F64], F64]

_AXES = "xyz"


@dataclass(frozen=True, kw_only=True)
class Schedule:
    """Values at given times, linear in between; held before the first and after the last time, or repeated.

    Attributes:
        times_s: Rising times from the start of the flow [s].
        values: As many numbers (factors of an inlet's velocity), or as many velocities [m/s].
        is_repeating: Start again after the last time: the value at t is that at `times_s[0]` plus
            (t - times_s[0]) modulo (times_s[-1] - times_s[0]). Equal first and last values repeat without a jump.
    """

    times_s: Sequence[float]
    values: Sequence[float] | Sequence[Vec3]
    is_repeating: bool = False

    def __post_init__(self) -> None:
        """Raise FlowError unless times rise and every time has a value."""
        times_s, values = np.asarray(self.times_s, float), np.asarray(self.values, float)
        if times_s.ndim != 1 or times_s.size == 0 or not np.isfinite(times_s).all() or (np.diff(times_s) <= 0).any():
            raise FlowError(f"Schedule.times_s: expected rising times [s], was {self.times_s}.")
        if values.shape not in ((times_s.size,), (times_s.size, 3)) or not np.isfinite(values).all():
            raise FlowError(
                f"Schedule.values: expected {times_s.size} finite numbers or velocities, one for each time, "
                f"was {self.values}."
            )
        if self.is_repeating and times_s.size < 2:
            raise FlowError("Schedule.times_s: expected at least two times to repeat, was one.")

    @property
    def has_velocities(self) -> bool:
        """Return whether the values are velocities rather than numbers."""
        return np.ndim(self.values) == 2

    def at(self, time_s: float) -> F64:
        """Return the number, as an array without dimensions, or the (3,) velocity [m/s] at a time [s]."""
        times_s, values = np.asarray(self.times_s, float), np.asarray(self.values, float)
        if self.is_repeating:
            time_s = times_s[0] + (time_s - times_s[0]) % (times_s[-1] - times_s[0])
        if values.ndim == 1:
            return np.asarray(np.interp(time_s, times_s, values))
        return np.array([np.interp(time_s, times_s, component) for component in values.T])


InletVelocity = Vec3 | NDArray[Any] | Profile | Schedule


@dataclass(frozen=True, kw_only=True)
class Inflow:
    """The velocities on an inlet's cells at any time.

    `profile_m_s` is (na, nb, 3) [m/s]; `factor` multiplies it, or `velocity` takes its place.
    """

    profile_m_s: F32
    factor: Schedule | None
    velocity: Schedule | None

    def at(self, time_s: float) -> F32:
        """Return (na, nb, 3) velocities at a time [s]."""
        if self.velocity is not None:
            return np.broadcast_to(self.velocity.at(time_s).astype(np.float32), self.profile_m_s.shape)
        return self.profile_m_s if self.factor is None else self.profile_m_s * np.float32(self.factor.at(time_s))

    @property
    def largest_speed_m_s(self) -> float:
        """Return the largest speed of any cell at any time [m/s]."""
        return float(self._speeds().max())

    @property
    def typical_speed_m_s(self) -> float:
        """Return the root mean square of the speed over cells and the schedule's times [m/s]."""
        return float(np.sqrt(np.mean(self._speeds() ** 2)))

    @property
    def period_s(self) -> float:
        """Return after which time it repeats [s], 0 if never."""
        schedule = self.velocity or self.factor
        return float(schedule.times_s[-1] - schedule.times_s[0]) if schedule and schedule.is_repeating else 0.0

    @property
    def steady_from_s(self) -> float:
        """Return from when on it does not change, or only repeats [s]."""
        schedule = self.velocity or self.factor
        return max(0.0, float(schedule.times_s[-1])) if schedule and not schedule.is_repeating else 0.0

    def _speeds(self) -> F64:
        if self.velocity is not None:
            return np.linalg.norm(np.asarray(self.velocity.values, float), axis=-1)
        speeds = np.linalg.norm(self.profile_m_s.astype(np.float64), axis=-1)
        factors = [1.0] if self.factor is None else self.factor.values
        return np.abs(np.multiply.outer(np.asarray(factors, float), speeds))


def make_inflow(name: str, velocity: InletVelocity, factor: Schedule | None, centres_m: F64) -> Inflow:
    """Lay an inlet's velocity out on its cells.

    Args:
        name: The inlet's, for messages.
        velocity: As in `Inlet`.
        factor: As in `Inlet`.
        centres_m: (na, nb, 3) centres of the patch's boundary faces, grid's frame [m].

    Raises:
        FlowError: the velocity has the wrong shape or is not finite, or schedules are mixed up.
    """
    if factor is not None and factor.has_velocities:
        raise FlowError(f"{name}: factor: expected a Schedule of numbers, was one of velocities. Use velocity_m_s.")
    if isinstance(velocity, Schedule):
        if factor is not None or not velocity.has_velocities:
            raise FlowError(
                f"{name}: velocity_m_s: expected a Schedule of velocities without a factor beside it. "
                f"For a profile that changes in time give the profile as velocity_m_s and the schedule as factor."
            )
        return Inflow(profile_m_s=np.zeros(centres_m.shape, np.float32), factor=None, velocity=velocity)
    return Inflow(profile_m_s=_profile(name, velocity, centres_m), factor=factor, velocity=None)


# (na, nb, 3) velocities from one velocity, an array or a function.
def _profile(name: str, velocity: Vec3 | NDArray[Any] | Profile, centres_m: F64) -> F32:
    if callable(velocity):
        values = np.asarray(velocity(centres_m.reshape(-1, 3)), float)
        if values.shape != (centres_m.size // 3, 3):
            raise FlowError(
                f"{name}: velocity_m_s: expected a function that returns an array of shape "
                f"({centres_m.size // 3}, 3) for as many points, was {values.shape}."
            )
        values = values.reshape(centres_m.shape)
    else:
        values = np.asarray(velocity, float)
        if values.shape not in ((3,), centres_m.shape):
            raise FlowError(
                f"{name}: velocity_m_s: expected three components, or an array of shape {centres_m.shape} for the "
                f"cells the patch covers, was {values.shape}."
            )
    if not np.isfinite(values).all():
        raise FlowError(f"{name}: velocity_m_s: expected finite numbers, was {velocity}.")
    return np.broadcast_to(values, centres_m.shape).astype(np.float32)


def parabolic_profile(mean_velocity_m_s: Vec3, *, across: str, low_m: float, high_m: float) -> Profile:
    """Return laminar flow between two walls, fully developed: u = 6 u_mean s (1 - s), s = (x - low) / (high - low).

    [m/s] = [m/s]; zero outside [low, high].

    Args:
        mean_velocity_m_s: Mean between the walls [m/s]; on n cells the flow is 1 / (2 n^2) of it larger.
        across: Axis from wall to wall: x, y or z.
        low_m: Where the one wall is on it [m].
        high_m: Where the other is [m].
    """
    axis = _axis(across)
    if not high_m > low_m:
        raise FlowError(f"parabolic_profile: high_m: expected above low_m ({low_m} m), was {high_m} m.")

    def velocity_m_s(points_m: F64) -> F64:
        share = np.clip((points_m[:, axis] - low_m) / (high_m - low_m), 0.0, 1.0)
        return np.multiply.outer(6.0 * share * (1.0 - share), np.asarray(mean_velocity_m_s, float))

    return velocity_m_s


def log_profile(
    velocity_m_s: Vec3, *, height_m: float, roughness_m: float, ground_m: float = 0.0, up: str = "z"
) -> Profile:
    """Return wind over rough ground: u(z) = u_ref ln((z + z0) / z0) / ln((z_ref + z0) / z0).

    [m/s] = [m/s]; z is the height above ground, 0 below it.

    Args:
        velocity_m_s: Wind at the reference height, u_ref [m/s].
        height_m: Reference height, z_ref [m].
        roughness_m: Roughness length, z0 [m]: 0.03 for grass, 0.5 for suburbs.
        ground_m: Where the ground is [m].
        up: Axis of the height: x, y or z.

    Source: Richards and Hoxey 1993, doi:10.1016/0167-6105(93)90124-7, equation 5; lengths from Wieringa 1993,
    doi:10.1007/BF00712119.
    """
    axis = _axis(up)
    if not (height_m > 0 and roughness_m > 0):
        raise FlowError(
            f"log_profile: expected height_m and roughness_m above 0 m, were {height_m} m and {roughness_m} m."
        )

    def profile_m_s(points_m: F64) -> F64:
        height = np.maximum(points_m[:, axis] - ground_m, 0.0)
        share = np.log1p(height / roughness_m) / np.log1p(height_m / roughness_m)
        return np.multiply.outer(share, np.asarray(velocity_m_s, float))

    return profile_m_s


def _axis(name: str) -> int:
    if name not in ("x", "y", "z"):
        raise FlowError(f"axis: expected x, y or z, was {name!r}.")
    return _AXES.index(name)
