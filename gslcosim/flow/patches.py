"""Patches on the boundary of the box: inlets with their inflow, outlets, openings, and their placement on the grid."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gslcosim.base import elementary
from gslcosim.base.errors import FlowError
from gslcosim.base.quantities import Vec3
from gslcosim.flow.pressure import LOW

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]

Profile = Callable[[F64], F64]

AXES = ("x", "y", "z")
Bool = NDArray[np.bool_]
Slices = tuple[slice | int, ...]


@dataclass(frozen=True, kw_only=True)
class Schedule:
    """Values at given times, linear in between; held before the first and after the last time, or repeated.

    Attributes:
        times_s: Rising times from the start of the flow [s].
        values: As many numbers (factors of an inlet's velocity), or as many velocities [m/s].
        is_repeating: Repeat after the last time: the value at t is that at `times_s[0]` plus (t - times_s[0]) modulo
            (times_s[-1] - times_s[0]). Equal first and last values repeat without a jump.
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
        """Return the value at a time [s]: a number, as an array without dimensions, or a (3,) velocity [m/s]."""
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

    `profile_m_s` is (na, nb, 3) [m/s]; `factor` multiplies it, or `velocity` replaces it.
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
        return float(np.sqrt(np.mean(np.square(self._speeds()))))

    @property
    def period_s(self) -> float:
        """Return the period of a repeating inflow [s], 0 if it does not repeat."""
        schedule = self.velocity or self.factor
        return float(schedule.times_s[-1] - schedule.times_s[0]) if schedule and schedule.is_repeating else 0.0

    @property
    def steady_from_s(self) -> float:
        """Return the time from which on it is constant or periodic [s]."""
        schedule = self.velocity or self.factor
        return max(0.0, float(schedule.times_s[-1])) if schedule and not schedule.is_repeating else 0.0

    def _speeds(self) -> F64:
        if self.velocity is not None:
            return np.linalg.norm(np.asarray(self.velocity.values, float), axis=-1)
        speeds = np.linalg.norm(self.profile_m_s.astype(np.float64), axis=-1)
        factors = [1.0] if self.factor is None else self.factor.values
        return np.abs(np.multiply.outer(np.asarray(factors, float), speeds))


def make_inflow(name: str, velocity: InletVelocity, factor: Schedule | None, centres_m: F64) -> Inflow:
    """Lay out an inlet's velocity on its cells.

    Args:
        name: Name of the inlet, for messages.
        velocity, factor: As in `Inlet`.
        centres_m: (na, nb, 3) centres of the patch's boundary faces, grid's frame [m].
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


def log_profile(
    velocity_m_s: Vec3, *, height_m: float, roughness_m: float, ground_m: float = 0.0, up: str = "z"
) -> Profile:
    """Return wind over rough ground: u(z) = u_ref ln((z + z0) / z0) / ln((z_ref + z0) / z0).

    [m/s] = [m/s]; z is the height above ground, 0 below it.

    Args:
        velocity_m_s: Wind at the reference height, u_ref [m/s].
        height_m: Reference height, z_ref [m].
        roughness_m: Roughness length, z0 [m]: 0.03 for grass, 0.5 for suburbs.
        ground_m: Height of the ground [m].
        up: Axis of the height: x, y or z.

    Source: Richards and Hoxey 1993, doi:10.1016/0167-6105(93)90124-7, equation 5; lengths from Wieringa 1993,
    doi:10.1007/BF00712119.
    """
    if up not in AXES:
        raise FlowError(f"axis: expected x, y or z, was {up!r}.")
    axis = AXES.index(up)
    if not (height_m > 0 and roughness_m > 0):
        raise FlowError(
            f"log_profile: expected height_m and roughness_m above 0 m, were {height_m} m and {roughness_m} m."
        )

    def profile_m_s(points_m: F64) -> F64:
        height = np.maximum(points_m[:, axis] - ground_m, 0.0)
        ratio = elementary.log1p_each(height / roughness_m) / elementary.log1p_each(height_m / roughness_m)
        return np.multiply.outer(ratio, np.asarray(velocity_m_s, float))

    return profile_m_s


@dataclass(frozen=True, kw_only=True)
class Patch:
    """A rectangle on the boundary of the box, given as a flat box: corners in the grid's frame [m].

    It acts on the boundary cells whose centre it covers. The boundary outside all patches is a wall at rest.
    """

    min_m: Vec3
    max_m: Vec3

    def __str__(self) -> str:
        """Name the patch in messages."""
        return f"{type(self).__name__}(min_m={self.min_m}, max_m={self.max_m})"


@dataclass(frozen=True, kw_only=True, eq=False)
class Inlet(Patch):
    """Air enters with a given velocity [m/s]; one that points out of the box is a fan that extracts air.

    `velocity_m_s` is one of

    - a velocity, the same on the whole patch;
    - an array (na, nb, 3) of velocities of the patch's cells, a and b the two axes along it in the order x, y, z;
    - a function from (n, 3) centres of boundary faces, grid's frame [m], to (n, 3) velocities, for example
      `log_profile`;
    - a `Schedule` of velocities.

    All but the last are multiplied by `factor`, a `Schedule` of numbers, if given.
    `turbulence_intensity` is the root mean square of the fluctuations over the mean speed, per axis, I, and
    `turbulence_length_m` the length scale L of the dissipation: k = 1.5 (I U)^2, epsilon = C_mu^(3/4) k^(3/2) / L.
    Their defaults, 0.05 and a length of 0.1 times the patch's shorter side, are AutoGDM+'s. Where a specification
    gives epsilon = k^(3/2) / l, L is 0.164 l.
    """

    velocity_m_s: InletVelocity
    factor: Schedule | None = None
    turbulence_intensity: float = 0.05
    turbulence_length_m: float | None = None


@dataclass(frozen=True, kw_only=True)
class Outlet(Patch):
    """Air leaves (or enters) freely: the pressure on the patch is zero.

    Entering air has no momentum of its own, as from a still room next door.
    """


@dataclass(frozen=True, kw_only=True)
class Open(Outlet):
    """The outdoors beyond the box: air leaves, or is drawn in, through the side or top of a box in the open.

    Where air leaves the pressure is zero. Where it enters it has been accelerated from far away, so the pressure is p =
    -u_n^2 / 2 (Bernoulli, p over density), and its velocity is that inside: no velocity changes across the patch. Wind
    along the patch therefore is unchanged, and a jet entrains air from the sides.

    Source: Dong, Karniadakis and Chryssostomidis 2014, doi:10.1016/j.jcp.2013.12.042, equation 3: the kinetic energy of
    entering air is taken from the pressure, which keeps the flow from feeding on its own backflow.
    Deviation: the speed normal to the patch instead of the whole speed, with a sharp switch: with the whole speed, wind
    along the patch would not be a solution.
    """


@dataclass(frozen=True, kw_only=True)
class MovingWall(Patch):
    """A wall that drags the air with it; `velocity_m_s` must lie in the wall's plane."""

    velocity_m_s: Vec3


@dataclass(frozen=True, kw_only=True)
class SlipWall(Patch):
    """A wall without friction, or a plane of symmetry."""


@dataclass(frozen=True, kw_only=True)
class PlacedPatch:
    """A patch on the grid: the side of the box it lies on and the boundary cells it covers.

    `inside` is the padded index, along `axis`, of the layer of cells inside the box; `rows` is the pair of index ranges
    along the two other axes (unpadded). `inflow` is the inflow of an inlet.
    """

    patch: Patch
    axis: int
    is_high: bool
    inside: int
    rows: tuple[slice, slice]
    n_cells: int
    inflow: Inflow | None = None

    @property
    def face(self) -> int:
        """Return the padded index of the layer of boundary faces."""
        return self.inside + self.is_high

    @property
    def just_outside(self) -> int:
        """Return the padded index of the layer of cells outside the box."""
        return self.inside + 1 if self.is_high else self.inside - 1

    @property
    def outside(self) -> slice:
        """Return the padded indices of all layers of cells outside the box."""
        return slice(self.inside + 1, None) if self.is_high else slice(0, self.inside)

    def layer(self, index: int | slice, *, face_axis: int | None = None) -> Slices:
        """Return a padded-array index: `index` along the patch's axis, the covered range along the others.

        With `face_axis` one of the other axes, the range is that of the faces on it: one more.
        """
        selection: list[slice | int] = []
        others = iter(self.rows)
        for axis in range(3):
            if axis == self.axis:
                selection.append(index)
                continue
            row = next(others)
            extra = 1 if axis == face_axis else 0
            selection.append(slice(row.start + LOW, row.stop + LOW + extra))
        return tuple(selection)


def place_patch(patch: Patch, free: Bool, cell_m: float) -> PlacedPatch:
    """Find a patch's side of the box and its cells, and lay out its velocity on them."""
    name = str(patch)
    low, high = np.asarray(patch.min_m, float), np.asarray(patch.max_m, float)
    if low.shape != (3,) or high.shape != (3,) or not (np.isfinite(low).all() and np.isfinite(high).all()):
        raise FlowError(f"{name}: expected two corners of three finite coordinates [m].")
    if (high < low).any():
        raise FlowError(f"{name}: expected min_m <= max_m on every axis.")
    box = np.asarray(free.shape) * cell_m
    axis, is_high = _side(name, low, high, box, cell_m)
    a, b = (other for other in range(3) if other != axis)
    rows = (_covered(low[a], high[a], free.shape[a], cell_m), _covered(low[b], high[b], free.shape[b], cell_m))
    covered = np.take(free, free.shape[axis] - 1 if is_high else 0, axis=axis)[rows]
    if covered.size == 0:
        raise FlowError(
            f"{name}: covers no cell; expected it to hold at least one centre of a {cell_m} m boundary cell."
        )
    if isinstance(patch, (Inlet, Outlet)) and not covered.any():
        raise FlowError(f"{name}: lies inside a solid; expected at least one air cell behind it.")
    if isinstance(patch, MovingWall) and patch.velocity_m_s[axis] != 0:
        raise FlowError(f"{name}: moves along {AXES[axis]}, through its own plane; use an Inlet for that.")
    if isinstance(patch, MovingWall) and not np.isfinite(patch.velocity_m_s).all():
        raise FlowError(f"{name}: velocity_m_s: expected finite numbers, was {patch.velocity_m_s}.")
    inflow = None
    if isinstance(patch, Inlet):
        if not 0 <= patch.turbulence_intensity < 1:
            raise FlowError(
                f"{name}: turbulence_intensity: expected a share from 0 to below 1, was {patch.turbulence_intensity}."
            )
        length_m = patch.turbulence_length_m
        if length_m is not None and not 0 < length_m < np.inf:
            raise FlowError(f"{name}: turbulence_length_m: expected a length above 0 m, was {length_m}.")
        centres_m = _face_centres_m(axis, box[axis] if is_high else 0.0, rows, cell_m)
        inflow = make_inflow(name, patch.velocity_m_s, patch.factor, centres_m)
    return PlacedPatch(
        patch=patch,
        axis=axis,
        is_high=is_high,
        inside=LOW + free.shape[axis] - 1 if is_high else LOW,
        rows=rows,
        n_cells=int(np.count_nonzero(covered)),
        inflow=inflow,
    )


# (na, nb, 3) centres of a patch's boundary faces, grid's frame [m].
def _face_centres_m(axis: int, at_m: float, rows: tuple[slice, slice], cell_m: float) -> F64:
    a_m, b_m = ((np.arange(row.start, row.stop) + 0.5) * cell_m for row in rows)
    parts = list(np.meshgrid(a_m, b_m, indexing="ij"))
    parts.insert(axis, np.full_like(parts[0], at_m))
    return np.stack(parts, axis=-1)


# The axis to which a patch is normal, and whether it is at the high end of the box.
def _side(name: str, low: F64, high: F64, box: F64, cell_m: float) -> tuple[int, bool]:
    near = 0.5 * cell_m
    candidates = [
        (axis, is_high)
        for axis in range(3)
        for is_high in (False, True)
        if high[axis] - low[axis] < near and abs(0.5 * (low[axis] + high[axis]) - (box[axis] if is_high else 0)) <= near
    ]
    if not candidates:
        size = " x ".join(f"{length:g}" for length in box)
        raise FlowError(
            f"{name}: expected a flat box on the boundary of the grid (origin to {size} m, equal min and max on one "
            f"axis); it is not on any side."
        )
    return min(candidates, key=lambda side: high[side[0]] - low[side[0]])


# Cells along one axis whose centre lies in [low, high].
def _covered(low_m: float, high_m: float, n: int, cell_m: float) -> slice:
    slack = 1e-6
    first = int(np.ceil(low_m / cell_m - 0.5 - slack))
    last = int(np.floor(high_m / cell_m - 0.5 + slack))
    return slice(max(first, 0), max(min(last, n - 1) + 1, 0))


def check_kinds(placed: Sequence[PlacedPatch], *, needs_openings: bool) -> None:
    """Raise FlowError where air can enter but not leave, or, if openings are needed, where one kind is missing."""
    has_inlet = any(isinstance(p.patch, Inlet) for p in placed)
    has_outlet = any(isinstance(p.patch, Outlet) for p in placed)
    if has_outlet and has_inlet:
        return
    if not needs_openings and not has_inlet:
        return
    missing = [name for name, has in (("Inlet", has_inlet), ("Outlet", has_outlet)) if not has]
    raise FlowError(
        f"patches: expected at least one Inlet and one Outlet, found no {' and no '.join(missing)} "
        f"among {len(placed)} patches. Air that enters must be able to leave."
    )


def check_overlap(placed: Sequence[PlacedPatch], shape: tuple[int, int, int]) -> None:
    """Raise FlowError if two patches cover the same boundary cell."""
    for axis in range(3):
        for is_high in (False, True):
            owner = np.full([n for a, n in enumerate(shape) if a != axis], -1)
            for index, patch in enumerate(placed):
                if (patch.axis, patch.is_high) != (axis, is_high):
                    continue
                taken = owner[patch.rows]
                if (taken >= 0).any():
                    other = placed[int(taken.max())].patch
                    raise FlowError(f"patches: {patch.patch} and {other} cover the same boundary cells.")
                owner[patch.rows] = index
