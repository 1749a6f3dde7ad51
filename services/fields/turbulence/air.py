# pyright: basic
# ruff: noqa: ANN001, ANN201, ANN202 - kernels have no types, and symbols of equations
"""Turbulence of a room's air: its strength and scales from k and epsilon, at the corners of cells."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from gslcosim.base import elementary
from gslcosim.base.problems import Problem
from gslcosim.environment.model import Cell, Environment, EnvironmentGeometry, Grid
from gslcosim.environment.openings import cells_at
from gslcosim.environment.positions import read_room
from gslcosim.scenario import Scenario
from gslcosim.scenario.models.gas import FilamentsSpec
from gslcosim_services.fields.turbulence.eddies import (
    AMPLITUDE,
    EPSILON_ROOT,
    N_COLUMNS,
    OWN_RATE,
    OWN_STD,
    SHEAR_SQUARE,
    EddyScales,
    eddy_velocity,
    largest_spacing_m,
    potential_amplitude_m2_s,
)
from gslcosim_services.fields.turbulence.grid_filters import distance_to, find_nearest, smooth_gaussian
from gslcosim_services.fields.turbulence.vector_kernels import interpolate_4, interpolate_8

LAGRANGIAN_C0 = 6.0
"""Kolmogorov's constant C0 of the Lagrangian structure function: Lien and D'Asaro 2002, Physics of Fluids 14, 4456."""
LENGTH_PER_K_EPSILON = 0.43
"""Longitudinal integral length over k^(3/2) / epsilon: Pope 2000, fig. 6.24."""
RICHARDSON_G = 0.5
"""Richardson's constant g of <r^2> = g eps t^3: Ott and Mann 2000, Journal of Fluid Mechanics 422, 207."""
OWN_TIME_RATIO = 2.0
"""Correlation time of a filament's own velocity over the Lagrangian time scale."""
OWN_SHARE = OWN_TIME_RATIO * RICHARDSON_G / (2.0 * LAGRANGIAN_C0)
"""Fraction of the energy in each filament's own velocity.

Its velocity is an Ornstein-Uhlenbeck process driven by noise of g eps / 2, so that two filaments that start together
separate as <r^2> = g eps t^3 within its correlation time (Obukhov 1959); its variance is that noise times half that
time.
"""
HOLD_PER_TIME_SCALE, MOST_HELD = 0.4, 8
"""Longest time for which a filament holds its velocity over the Lagrangian time scale, and in steps; chosen."""


Walled = NDArray[np.bool_]
"""(3, 2) whether a room has a wall at the lower and at the upper end of each axis."""
_GROUND: Walled = np.array([[False, False], [False, False], [True, False]])
# At most this fraction of the air beside an open side is beside its frame.
_FRAME_SHARE = 0.1


class AirNodes(NamedTuple):
    """Turbulence at the corners of cells, in the form for kernels.

    `nodes` (nx + 1, ny + 1, nz + 1, N_COLUMNS) float32: amplitude of the large eddies' potential [m2/s], zero on
    walls; the standard deviation of a filament's own velocity along each axis [m/s]; the inverse of its correlation
    time [1/s]; the cube root of epsilon [m^(2/3)/s]; the sum of the squared slopes of the wind that carries eddies
    [1/s2], zero where that is the wind of each instant; zeros.
    `drift_m_s` (nx, ny, nz or 1, 4) float32 wind at cell centres that carries eddies, smooth over their size; a zero.
    `length_m` is the integral length.
    """

    nodes: Any
    drift_m_s: Any
    length_m: float


@numba.njit(cache=True, nogil=True, inline="always")
def _bracket_with_slope(coordinate_m, origin_m, cell_m, n):
    # Lower and upper centre, weight of the upper, and the weight's slope: zero beyond the outermost centres.
    s = (coordinate_m - origin_m) / cell_m - 0.5
    if n < 2 or s <= 0.0:
        return 0, 0, 0.0, 0.0
    if s >= n - 1.0:
        return n - 1, n - 1, 0.0, 0.0
    i = np.int64(s)
    return i, i + 1, s - i, 1.0 / cell_m


@numba.njit(cache=True, nogil=True, inline="always")
def drift_with_slopes(drift_m_s, origin_m, cell_m, x, y, z):
    """Return the wind that carries eddies at a point and its slopes, of the same interpolation as `trilinear_wind`.

    Args:
        drift_m_s: See `AirNodes`.
        origin_m: (3,) corner of cell (0, 0, 0), world frame [m].
        cell_m: Edge of the cubic cells [m].
        x, y, z: Point, world frame [m].

    Returns:
        Sixteen float32: u, v, w [m/s] and a zero, then their slopes along x, along y and along z [1/s].

    Held by:
        tests/unit/services/fields/turbulence/test_air.py
    """
    nx, ny, nz, _ = drift_m_s.shape
    i, i1, a, da = _bracket_with_slope(x, origin_m[0], cell_m, nx)
    j, j1, b, db = _bracket_with_slope(y, origin_m[1], cell_m, ny)
    k, k1, c, dc = _bracket_with_slope(z, origin_m[2], cell_m, nz)
    steps = (4 * ny * nz * (i1 - i), 4 * nz * (j1 - j), 4 * (k1 - k))
    return interpolate_4(drift_m_s, 4 * ((i * ny + j) * nz + k), steps, (a, b, c), (da, db, dc))


@numba.njit(cache=True, nogil=True, inline="always")
def nodes_with_slopes(nodes, origin_m, cell_m, x, y, z):
    """Return the columns of the table at corners at a point, and their slopes.

    Args:
        nodes: See `AirNodes`.
        origin_m: (3,) corner (0, 0, 0), world frame [m].
        cell_m: Edge of the cubic cells [m].
        x, y, z: Point, world frame [m], in the grid.

    Returns:
        4 N_COLUMNS float32: the columns, then their slopes along x, along y and along z [1/m].
    """
    nx, ny, nz, _ = nodes.shape
    sx, sy, sz = (x - origin_m[0]) / cell_m, (y - origin_m[1]) / cell_m, (z - origin_m[2]) / cell_m
    i = min(max(np.int64(sx), 0), nx - 2)
    j = min(max(np.int64(sy), 0), ny - 2)
    k = min(max(np.int64(sz), 0), nz - 2)
    weights = min(max(sx - i, 0.0), 1.0), min(max(sy - j, 0.0), 1.0), min(max(sz - k, 0.0), 1.0)
    per_m, steps = 1.0 / cell_m, (N_COLUMNS * ny * nz, N_COLUMNS * nz, N_COLUMNS)
    return interpolate_8(nodes, N_COLUMNS * ((i * ny + j) * nz + k), steps, weights, (per_m, per_m, per_m))


@numba.njit(cache=True, nogil=True, inline="always")
def eddy_velocity_at(air, layers, origin_m, cell_m, x, y, z, sums):
    """Return the velocity of the large eddies at a point of a room, world frame [m/s]; see `eddy_velocity`.

    Args:
        air: `AirNodes`.
        layers: `EddyLayers`.
        origin_m: (3,) corner of cell (0, 0, 0), world frame [m].
        cell_m: Edge of the cubic cells [m].
        x, y, z: Point, world frame [m].
        sums: (N_SUMS,) float32, working memory.
    """
    node = nodes_with_slopes(air.nodes, origin_m, cell_m, x, y, z)
    return eddy_velocity(layers, x, y, z, drift_with_slopes(air.drift_m_s, origin_m, cell_m, x, y, z), node, sums)


@dataclass(frozen=True, kw_only=True, eq=False)
class TurbulentAir:
    """Turbulence of a room.

    Attributes:
        scales: Size and time of its large eddies.
        velocity_std_m_s: Standard deviation of the velocity along each axis, its mean in the room [m/s].
        nodes: Strength at the corners of cells.
        drifts_with_wind: Whether the wind of each instant carries the eddies, in place of the one in `nodes`.
    """

    scales: EddyScales
    velocity_std_m_s: float
    nodes: AirNodes
    drifts_with_wind: bool = False

    def steps_to_hold(self, step_s: float) -> int:
        """Return for how many steps a filament may hold its velocity: `HOLD_PER_TIME_SCALE`, at most `MOST_HELD`."""
        return max(1, min(MOST_HELD, math.floor(HOLD_PER_TIME_SCALE * self.scales.time_s / step_s)))

    def nodes_in(self, wind_m_s: NDArray[np.float32]) -> AirNodes:
        """Return the table for kernels, in the wind of an instant."""
        return self.nodes._replace(drift_m_s=_with_zero(wind_m_s)) if self.drifts_with_wind else self.nodes


@dataclass(frozen=True, kw_only=True, eq=False)
class KEpsilonFields:
    """Turbulence energy [m2/s2] and its dissipation [m2/s3] at cell centres, (nx, ny, nz) each."""

    k_m2_s2: NDArray[np.floating]
    epsilon_m2_s3: NDArray[np.floating]


def integral_length_m(k_m2_s2: float, epsilon_m2_s3: float) -> float:
    """Return the longitudinal integral length 0.43 k^(3/2) / epsilon [m]."""
    return LENGTH_PER_K_EPSILON * k_m2_s2 * math.sqrt(k_m2_s2) / epsilon_m2_s3


def lagrangian_time_s(k_m2_s2: float, epsilon_m2_s3: float) -> float:
    """Return the Lagrangian time scale 2 s^2 / (C0 epsilon), s^2 = 2 k / 3 [s].

    Source:
        Thomson 1987, Journal of Fluid Mechanics 180, 529.
    """
    return 4.0 * k_m2_s2 / (3.0 * LAGRANGIAN_C0 * epsilon_m2_s3)


def k_epsilon_from_intensity(velocity_std_m_s: float, length_m: float) -> tuple[float, float]:
    """Return k [m2/s2] and epsilon [m2/s3] of a standard deviation along each axis and an integral length."""
    k_m2_s2 = 1.5 * velocity_std_m_s * velocity_std_m_s
    return k_m2_s2, LENGTH_PER_K_EPSILON * k_m2_s2 * math.sqrt(k_m2_s2) / length_m


def mean_speed_m_s(environment: Environment) -> float:
    """Return the mean speed of the wind over a room's air and the frames of its wind [m/s]."""
    velocity_m_s = np.asarray(environment.wind.velocity_m_s, np.float64)
    return float(np.linalg.norm(velocity_m_s, axis=-1)[:, environment.occupancy != Cell.SOLID].mean())


def find_walls(room: EnvironmentGeometry) -> Walled:
    """Return the sides of a room that are walls: not those that openings fill, or nearly."""
    is_air, is_opening = room.occupancy != Cell.SOLID, room.occupancy == Cell.OUTLET
    for opening in room.openings:
        is_opening[cells_at(opening, room.grid)] = True
    walls = np.ones((3, 2), np.bool_)
    for axis in range(3):
        for side in (0, 1):
            air, opening_cells = (np.moveaxis(cells, axis, 0)[-side] for cells in (is_air, is_opening & is_air))
            walls[axis, side] = not air.any() or opening_cells.sum() < (1.0 - _FRAME_SHARE) * air.sum()
    return walls


def longest_eddies_m(grid: Grid, walls: Walled) -> float:
    """Return the integral length of the largest eddies that have room [m]: infinite where there are no walls.

    Half of the distance between two walls; between a wall and the open its whole, as the open side is the middle of a
    room that the wall's image closes. A wall blocks eddies within about their length of it, and here they fade within
    it: longer ones would be weaker than their k in all of the air.

    Source: Hunt and Graham 1978, Journal of Fluid Mechanics 84, 209, for eddies that a wall blocks; the bound is ours.
    """
    sides_m = np.multiply(grid.shape, grid.cell_m)
    n_walls = walls.sum(axis=1)
    return float(np.where(n_walls > 0, sides_m / np.maximum(n_walls, 1), np.inf).min())


def find_eddy_warnings(scenario: Scenario, directory: Path) -> list[Problem]:
    """Return a warning if a scenario's eddies are longer than its room allows.

    Args:
        scenario: Its gas has turbulence of a given length.
        directory: The scenario's folder, where relative paths start.
    """
    room = read_room(scenario.environment, scenario.wind, directory)
    gas = scenario.gas
    turbulence = gas.eddies if isinstance(gas, FilamentsSpec) else None
    if room is None or not isinstance(gas, FilamentsSpec) or turbulence is None:
        return []
    longest_m = longest_eddies_m(room.grid, _GROUND if gas.is_in_open_air else find_walls(room))
    if turbulence.length_m <= longest_m:
        return []
    return [
        Problem(
            where="gas.turbulence.length_m",
            expected=f"at most {longest_m:g} m, half of the distance of two walls, or the height of open ground",
            found=f"{turbulence.length_m:g} m",
            remedy=f"Eddies have {longest_m:g} m in this room.",
        )
    ]


def build_turbulent_air(
    environment: Environment,
    strength: KEpsilonFields,
    *,
    is_open: bool = False,
) -> TurbulentAir:
    """Build the turbulence of a room from k and epsilon at its cell centres.

    The large eddies have one size and one time in a room: those of its mean k and epsilon, weighted by k, and no more
    than `longest_eddies_m`. Their strength is that of each place, and fades near walls.

    Args:
        environment: The room.
        strength: Its k and epsilon; values in solids are not used.
        is_open: Whether the air goes on beyond the grid's sides and top, in a wind of the gas's own.
    """
    air = environment.occupancy != Cell.SOLID
    k = np.where(air, np.maximum(strength.k_m2_s2, 1e-8), 0.0)
    epsilon = np.where(air, np.maximum(strength.epsilon_m2_s3, 1e-10), 0.0)
    # Sums in one order on every machine: numpy's pairwise sums are.
    mean_k = float((k * k).sum() / k.sum())
    mean_epsilon = float((k * epsilon).sum() / k.sum())
    walls = find_walls(environment) if not is_open else _GROUND
    length_m = min(integral_length_m(mean_k, mean_epsilon), longest_eddies_m(environment.grid, walls))
    scales = EddyScales(length_m=length_m, time_s=lagrangian_time_s(mean_k, mean_epsilon))
    spacing_m = largest_spacing_m(length_m)
    node_k, node_epsilon = _at_corners(k, air), _at_corners(epsilon, air)
    std = np.sqrt(2.0 / 3.0 * node_k)
    fade = _fade_at_walls(_distance_to_walls_m(environment, walls, reach_m=spacing_m) / spacing_m)
    nodes = np.zeros((*std.shape, N_COLUMNS), np.float32)
    nodes[..., AMPLITUDE] = potential_amplitude_m2_s(math.sqrt(1.0 - OWN_SHARE), spacing_m) * std * fade
    nodes[..., OWN_STD] = math.sqrt(OWN_SHARE) * std
    nodes[..., OWN_RATE] = 0.75 * LAGRANGIAN_C0 / OWN_TIME_RATIO * node_epsilon / node_k
    nodes[..., EPSILON_ROOT] = elementary.cbrt_each(node_epsilon)
    drift = np.zeros((1, 1, 1, 3))
    if not is_open:
        drift = _smooth_wind(environment, air, length_m)
        nodes[..., SHEAR_SQUARE] = _shear_square_at_corners(drift, environment.grid.cell_m)
    return TurbulentAir(
        scales=scales,
        velocity_std_m_s=math.sqrt(2.0 / 3.0 * mean_k),
        nodes=AirNodes(nodes, _with_zero(drift), length_m),
        drifts_with_wind=is_open,
    )


# The mean of the cells of air around each corner; corners within solids have that of the nearest air.
def _at_corners(values: NDArray[np.floating], air: NDArray[np.bool_]) -> NDArray[np.float64]:
    sums, counts = (_sum_around_corners(np.where(air, each, 0.0)) for each in (values, np.ones(air.shape)))
    mean = sums / np.maximum(counts, 1.0)
    if (counts == 0).any():
        mean = mean[tuple(find_nearest(counts != 0))]
    return mean


def _sum_around_corners(values: NDArray[np.floating]) -> NDArray[np.float64]:
    padded = np.pad(np.asarray(values, np.float64), 1)
    for axis in range(3):
        length = padded.shape[axis]
        padded = np.take(padded, range(length - 1), axis) + np.take(padded, range(1, length), axis)
    return padded


def _distance_to_walls_m(environment: Environment, walls: Walled, *, reach_m: float) -> NDArray[np.float64]:
    # Beyond the border there is wall, save on a side that is open and beside an outlet.
    solid = np.pad(environment.occupancy == Cell.SOLID, 1, constant_values=False)
    outlet = np.pad(environment.occupancy == Cell.OUTLET, 1, constant_values=False)
    for axis, side in np.argwhere(walls):
        np.moveaxis(solid, axis, 0)[-side] = True
    for axis in range(3):
        solids, outlets = np.moveaxis(solid, axis, 0), np.moveaxis(outlet, axis, 0)
        solids[0] &= ~outlets[1]
        solids[-1] &= ~outlets[-2]
    is_wall = np.zeros(tuple(n + 1 for n in environment.grid.shape), np.bool_)
    for di in (0, 1):
        for dj in (0, 1):
            for dk in (0, 1):
                nx, ny, nz = is_wall.shape
                is_wall |= solid[di : di + nx, dj : dj + ny, dk : dk + nz]
    if not is_wall.any():
        return np.full(is_wall.shape, reach_m)
    return distance_to(is_wall) * environment.grid.cell_m


# Zero at a wall, one from a spacing on, smooth between: Bridson's ramp.
def _fade_at_walls(distance: NDArray[np.float64]) -> NDArray[np.float64]:
    r = np.minimum(distance, 1.0)
    r_r = r * r
    return r * (15.0 - r_r * (10.0 - 3.0 * r_r)) / 8.0


# Beyond the outermost centres the wind has no slope.
def _shear_square_at_corners(wind_m_s: NDArray[np.float64], cell_m: float) -> NDArray[np.float64]:
    padded = np.pad(wind_m_s, ((1, 1), (1, 1), (1, 1), (0, 0)), mode="edge")
    found = np.zeros(tuple(n + 1 for n in wind_m_s.shape[:3]))
    for axis in range(3):
        slopes = np.diff(padded, axis=axis) / cell_m
        for other in (each for each in range(3) if each != axis):
            n = slopes.shape[other]
            slopes = 0.5 * (np.take(slopes, range(n - 1), other) + np.take(slopes, range(1, n), other))
        for i in range(3):
            found += slopes[..., i] * slopes[..., i]
    return found


def _with_zero(wind_m_s: NDArray[np.floating]) -> NDArray[np.float32]:
    padded = np.zeros((*wind_m_s.shape[:3], 4), np.float32)
    padded[..., :3] = wind_m_s
    return padded


def _smooth_wind(environment: Environment, air: NDArray[np.bool_], length_m: float) -> NDArray[np.float64]:
    mean = np.asarray(environment.wind.velocity_m_s).mean(axis=0, dtype=np.float64)
    width = 0.5 * length_m / environment.grid.cell_m
    weight = np.maximum(smooth_gaussian(air.astype(np.float64), width), 1e-3)
    smooth = [smooth_gaussian(np.where(air, mean[..., i], 0.0), width) / weight for i in range(3)]
    return np.stack(smooth, axis=-1)
