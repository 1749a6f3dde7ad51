# pyright: basic
"""Farrell's open field: a gusty wind, stirred at the corners of a box, that carries filaments out of it."""

# ruff: noqa: ANN001, ANN201, ANN202 - kernels have no types, and symbols of equations

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, ClassVar, Literal

import numba
import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from gslcosim.base import elementary
from gslcosim.base.problems import Problem
from gslcosim.base.quantities import Vec3
from gslcosim.base.rng import stream
from gslcosim.base.scalar_kernels import norm2
from gslcosim.base.spec import Positive, Spec
from gslcosim.environment.model import Cell, Environment, Grid
from gslcosim.environment.positions import read_room
from gslcosim.scenario import Scenario
from gslcosim.scenario.models.base import NonNegative
from gslcosim.scenario.models.gas import FilamentsSpec
from gslcosim_formats.gaussian_plume import wind_at_first_source_m_s
from gslcosim_services.fields.filament.downwash import Jets
from gslcosim_services.fields.filament.plume import FilamentPlume, Filaments
from gslcosim_services.fields.filament_field import FilamentField
from gslcosim_services.fields.gas_field import GasField, Visibility
from gslcosim_services.fields.gas_setup import GasSetup, build_gas_field_from_block
from gslcosim_services.fields.mixing_ratio import Walls
from gslcosim_services.fields.models.filament_gas import build_gas_model, build_point_turbulence, build_wall_images

# The wind's own clock: its statistics depend neither on the gas's step nor on the tick.
WIND_STEP_S = 0.01
# Gusts beyond so many standard deviations do not occur in years; the stable step is chosen for them.
_MAX_GUST_STD = 6.0
# Nodes along each side, and frequencies, in the computation of the gain in the middle.
_GAIN_NODES, _GAIN_FREQUENCIES = 11, 16
_LEAST_GAIN = 0.25


class FarrellSpec(Spec):
    """Settings of Farrell's open field: a horizontal wind with gusts at its corners, on `n_nodes` nodes per side.

    The corners' gusts are so strong that the middle has `gust_std_m_s`: about twice as strong, and at most four times.
    """

    wind_m_s: Vec3 | None = Field(default=None, description="mean wind (absent: wind of the room at the first source)")
    gust_std_m_s: NonNegative = Field(
        default=0.25, description="standard deviation of the wind along each axis in the middle of the field"
    )
    gust_period_s: Positive = Field(default=30.0, description="period of the gusts")
    gust_damping: Annotated[float, Field(gt=0, lt=1)] = Field(default=0.1, description="damping ratio of the gusts")
    eddy_viscosity_m2_s: NonNegative = Field(
        default=10.0, description="eddy viscosity, which spreads gusts through the field"
    )
    n_nodes: Annotated[int, Field(ge=3, le=200)] = Field(default=21, description="nodes of the wind grid per side")


class FarrellGasSpec(FilamentsSpec):
    """Filaments in Farrell's open field."""

    is_in_open_air: ClassVar[bool] = True

    model: Literal["farrell"] = Field(default="farrell", description="gas model")  # pyright: ignore
    farrell: FarrellSpec = Field(default=FarrellSpec(), description="wind of the open field")


@numba.njit(cache=True, nogil=True)
def _interpolate_edge(values, i_component, a, b):
    # Straight between the corners; the four are (0, 0), (0, 1), (1, 0), (1, 1) of x and y.
    low = (1.0 - b) * values[i_component, 0] + b * values[i_component, 1]
    high = (1.0 - b) * values[i_component, 2] + b * values[i_component, 3]
    return (1.0 - a) * low + a * high


@numba.njit(cache=True, nogil=True)
def set_edges_inplace(wind_m_s, corners_m_s):
    """Set the wind on the border of the field to values straight between those of the corners.

    Args:
        wind_m_s: (nx, ny, 2) wind at nodes, world frame xy [m/s]; its border is modified.
        corners_m_s: (2, 4) component by corner, corners in the order (0, 0), (0, 1), (1, 0), (1, 1) of x and y [m/s].
    """
    nx, ny, _ = wind_m_s.shape
    for c in range(2):
        for i in range(nx):
            a = i / (nx - 1)
            wind_m_s[i, 0, c] = _interpolate_edge(corners_m_s, c, a, 0.0)
            wind_m_s[i, ny - 1, c] = _interpolate_edge(corners_m_s, c, a, 1.0)
        for j in range(ny):
            b = j / (ny - 1)
            wind_m_s[0, j, c] = _interpolate_edge(corners_m_s, c, 0.0, b)
            wind_m_s[nx - 1, j, c] = _interpolate_edge(corners_m_s, c, 1.0, b)


@numba.njit(cache=True, nogil=True)
def advance_wind_inplace(wind_m_s, spare_m_s, dx_m, dy_m, viscosity_m2_s, dt_s, n_steps):
    """Advance the wind inside the field by explicit steps; the border stays.

    du/dt = -u du/dx - v du/dy + nu (d2u/dx2 + d2u/dy2), and the same for v
    [m/s2] = [m/s] [m/s] / [m] + [m2/s] [m/s] / [m2]

    First-order upwind differences for advection, central ones for diffusion, Euler in time.

    Args:
        wind_m_s: (nx, ny, 2) wind at nodes, world frame xy [m/s]; modified.
        spare_m_s: (nx, ny, 2) working memory.
        dx_m, dy_m: Distance of nodes along x, y [m].
        viscosity_m2_s: Eddy viscosity nu, half of Farrell's K [m2/s].
        dt_s: Step [s]; stable below `stable_step_s`.
        n_steps: How many.

    Source:
        Farrell et al. 2002, doi:10.1023/A:1016283702837, eq. of the mean wind field; parameters as in pompy/models.py.
    Deviation:
        Upwind instead of central differences: stable without diffusion.
    Held by:
        extensions/formats/tests/unit/test_farrell.py (decay of a sine, constants stay, box of two side lengths)
    """
    nx, ny, _ = wind_m_s.shape
    for _ in range(n_steps):
        for i in range(1, nx - 1):
            for j in range(1, ny - 1):
                u, v = wind_m_s[i, j, 0], wind_m_s[i, j, 1]
                for c in range(2):
                    here = wind_m_s[i, j, c]
                    west, east = wind_m_s[i - 1, j, c], wind_m_s[i + 1, j, c]
                    south, north = wind_m_s[i, j - 1, c], wind_m_s[i, j + 1, c]
                    along_x = (here - west if u > 0.0 else east - here) / dx_m
                    along_y = (here - south if v > 0.0 else north - here) / dy_m
                    spreading = (west - 2.0 * here + east) / (dx_m * dx_m) + (south - 2.0 * here + north) / (
                        dy_m * dy_m
                    )
                    spare_m_s[i, j, c] = here + dt_s * (-u * along_x - v * along_y + viscosity_m2_s * spreading)
        for i in range(1, nx - 1):
            for j in range(1, ny - 1):
                wind_m_s[i, j, 0] = spare_m_s[i, j, 0]
                wind_m_s[i, j, 1] = spare_m_s[i, j, 1]


@numba.njit(cache=True, nogil=True)
def advance_gusts_inplace(gusts_m_s, rates_m_s2, transition, spread, draws):
    """Advance the gusts at the corners by one exact step of a noisy oscillator.

    dx = y dt, dy = -(w^2 x + 2 z w y) dt + b dW      x gust [m/s], y its rate [m/s2], w [rad/s], z damping ratio

    Args:
        gusts_m_s: (2, 4) gusts x by component and corner [m/s]; modified.
        rates_m_s2: (2, 4) their rates y [m/s2]; modified.
        transition: (2, 2) solution of the equation without noise over a step (see `exact_gust_step`).
        spread: (2, 2) lower triangle L with L L^T the covariance that a step's noise adds.
        draws: (2, 4, 2) standard normal numbers.
    """
    for c in range(2):
        for k in range(4):
            x, y = gusts_m_s[c, k], rates_m_s2[c, k]
            gusts_m_s[c, k] = transition[0, 0] * x + transition[0, 1] * y + spread[0, 0] * draws[c, k, 0]
            rates_m_s2[c, k] = (
                transition[1, 0] * x
                + transition[1, 1] * y
                + spread[1, 0] * draws[c, k, 0]
                + spread[1, 1] * draws[c, k, 1]
            )


@numba.njit(cache=True, nogil=True)
def blow_inplace(
    wind_m_s, spare_m_s, gusts_m_s, rates_m_s2, mean_m_s, transition, spread, draws, dx_m, dy_m, viscosity_m2_s,
    dt_s, n_substeps,
):  # fmt: skip
    """Advance gusts, border and inside by as many steps of the wind's clock as there are draws.

    Args:
        wind_m_s: (nx, ny, 2) wind at nodes, world frame xy [m/s]; modified.
        spare_m_s: (nx, ny, 2) working memory.
        gusts_m_s, rates_m_s2: (2, 4) see `advance_gusts_inplace`; modified.
        mean_m_s: (2,) mean wind [m/s].
        transition, spread: (2, 2) see `advance_gusts_inplace`.
        draws: (n, 2, 4, 2) standard normal numbers.
        dx_m, dy_m: Distance of nodes along x, y [m].
        viscosity_m2_s: Eddy viscosity [m2/s].
        dt_s: Length of a substep [s].
        n_substeps: Substeps of the inside in a step of the clock.
    """
    for n in range(draws.shape[0]):
        advance_gusts_inplace(gusts_m_s, rates_m_s2, transition, spread, draws[n])
        corners_m_s = gusts_m_s.copy()
        for c in range(2):
            for k in range(4):
                corners_m_s[c, k] += mean_m_s[c]
        set_edges_inplace(wind_m_s, corners_m_s)
        advance_wind_inplace(wind_m_s, spare_m_s, dx_m, dy_m, viscosity_m2_s, dt_s, n_substeps)


@numba.njit(cache=True, nogil=True)
def wind_in_cells(wind_m_s, nx, ny):
    """Return the wind at the centres of (nx, ny) cells in the field's box, by bilinear interpolation.

    Args:
        wind_m_s: (mx, my, 2) wind at nodes, the outermost on the border of the field [m/s].
        nx, ny: Cells along x, y.

    Returns:
        (nx, ny, 1, 3) float32 wind, horizontal and the same at all heights [m/s].
    """
    mx, my, _ = wind_m_s.shape
    result = np.empty((nx, ny, 1, 3), np.float32)
    for i in range(nx):
        s = (i + 0.5) / nx * (mx - 1)
        p = min(int(s), mx - 2)
        a = s - p
        for j in range(ny):
            t = (j + 0.5) / ny * (my - 1)
            q = min(int(t), my - 2)
            b = t - q
            for c in range(2):
                low = (1.0 - b) * wind_m_s[p, q, c] + b * wind_m_s[p, q + 1, c]
                high = (1.0 - b) * wind_m_s[p + 1, q, c] + b * wind_m_s[p + 1, q + 1, c]
                result[i, j, 0, c] = (1.0 - a) * low + a * high
            result[i, j, 0, 2] = 0.0
    return result


@dataclass(frozen=True, kw_only=True)
class Gusts:
    """Gusts of the wind: a noisy oscillator of standard deviation, period and damping ratio."""

    std_m_s: float
    period_s: float
    damping: float


def exact_gust_step(gusts: Gusts, dt_s: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the exact transition of a noisy oscillator over a step of any length.

    dx = y dt, dy = -(w^2 x + 2 z w y) dt + b dW, in its stationary state <x^2> = s^2, <y^2> = s^2 w^2, <x y> = 0
    state -> P state + L n: P the solution without noise, L L^T = C - P C P^T with C the stationary covariance

    Args:
        gusts: s, w = 2 pi / period and z < 1.
        dt_s: The step [s].

    Returns:
        (2, 2) P and (2, 2) lower triangle L, for the state (x [m/s], y [m/s2]).

    Source:
        Our derivation from the equation of pompy's ColouredNoiseGenerator. Its noise is multiplied by dt and so depends
        on the step; here the standard deviation is given, for steps of any length.
    Held by:
        extensions/formats/tests/unit/test_farrell.py (two half steps are a whole one; variance stays)
    """
    w, z = 2.0 * math.pi / gusts.period_s, gusts.damping
    w_d = w * math.sqrt(1.0 - z * z)
    decay, c, s = elementary.exp(-z * w * dt_s), elementary.cos(w_d * dt_s), elementary.sin(w_d * dt_s)
    transition = decay * np.array([[c + z * w / w_d * s, s / w_d], [-w * w / w_d * s, c - z * w / w_d * s]])
    stationary = gusts.std_m_s * gusts.std_m_s * np.diag([1.0, w * w])
    added = stationary - elementary.product(elementary.product(transition, stationary), transition.T)
    first = math.sqrt(max(added[0, 0], 0.0))
    cross = added[1, 0] / first if first > 0.0 else 0.0
    return transition, np.array([[first, 0.0], [cross, math.sqrt(max(added[1, 1] - cross * cross, 0.0))]])


def stable_step_s(speed_m_s: float, viscosity_m2_s: float, dx_m: float, dy_m: float) -> float:
    """Return the longest stable step of `advance_wind_inplace` [s] at speeds up to this in each direction.

    dt <= 1 / (u / dx + u / dy + 2 nu (1 / dx^2 + 1 / dy^2))
    """
    rate_per_s = speed_m_s * (1.0 / dx_m + 1.0 / dy_m) + 2.0 * viscosity_m2_s * (
        1.0 / (dx_m * dx_m) + 1.0 / (dy_m * dy_m)
    )
    return 1.0 / rate_per_s if rate_per_s > 0.0 else math.inf


def find_middle_gain(
    size_m: tuple[float, float], mean_m_s: NDArray[np.float64], gusts: Gusts, viscosity_m2_s: float
) -> float:
    """Return the standard deviation of gusts in the middle of a field over that at its corners, to a thousandth [1].

    i w a + u . grad a = nu lap a      a response to one corner's gusts of frequency w, straight between the corners
                                       on the border; u mean wind, upwind as in `advance_wind_inplace`
    gain^2 = mean over the gusts' spectrum of the sum over corners of |a|^2 in the middle: corners are independent

    About one half in a field that gusts spread over in much less than their period. In a large one less reaches the
    middle; below a quarter the result is a quarter, as stronger gusts at the corners would carry the wind themselves.

    Source: Our derivation, for gusts that are weak beside the mean wind.
    Held by: extensions/formats/tests/unit/test_farrell.py (standard deviation of the wind in the middle)
    """
    n, unit = _GAIN_NODES, np.eye(_GAIN_NODES)
    terms: list[NDArray[np.float64]] = []
    for side_m, speed_m_s in zip(size_m, mean_m_s, strict=True):
        step_m, before, after = side_m / (n - 1), np.eye(n, k=-1), np.eye(n, k=1)
        slope = (unit - before if speed_m_s > 0.0 else after - unit) / step_m
        terms.append(speed_m_s * slope - viscosity_m2_s * (before - 2.0 * unit + after) / step_m**2)
    transport = np.kron(terms[0], unit) + np.kron(unit, terms[1])
    low = np.linspace(1.0, 0.0, n)
    corners = np.stack([np.outer(a, b).ravel() for a in (low, low[::-1]) for b in (low, low[::-1])], axis=1)
    inside = np.pad(np.ones((n - 2, n - 2), np.bool_), 1).ravel()
    middle = np.flatnonzero(inside) == n * n // 2
    # Points of the oscillator's spectrum with equal parts of the variance, up to four times its own frequency.
    w = np.linspace(0.0, 4.0, 4001)
    shares = np.cumsum(1.0 / ((1.0 - w**2) ** 2 + (2.0 * gusts.damping * w) ** 2))
    frequencies = np.interp((np.arange(_GAIN_FREQUENCIES) + 0.5) / _GAIN_FREQUENCIES, shares / shares[-1], w)
    squares = [
        np.linalg.norm(
            np.linalg.solve(
                transport[np.ix_(inside, inside)] + 2j * math.pi * frequency / gusts.period_s * np.eye(middle.size),
                transport[np.ix_(inside, ~inside)] @ corners[~inside],
            )[middle]
        )
        ** 2
        for frequency in frequencies
    ]
    # Rounded, so that the wind does not depend on the library of linear algebra.
    return max(_LEAST_GAIN, round(math.sqrt(float(np.mean(squares))), 3))


def find_gust_warnings(scenario: Scenario, directory: Path) -> list[Problem]:
    """Return a warning if the gusts in the middle of a scenario's field are weaker than its setting.

    Args:
        scenario: Its gas is Farrell's.
        directory: The scenario's folder, where relative paths start.
    """
    room = read_room(scenario.environment, scenario.wind, directory)
    if room is None or not isinstance(scenario.gas, FarrellGasSpec) or not scenario.gas.farrell.gust_std_m_s:
        return []
    spec = scenario.gas.farrell
    gusts = Gusts(std_m_s=spec.gust_std_m_s, period_s=spec.gust_period_s, damping=spec.gust_damping)
    x_m, y_m = (n * room.grid.cell_m for n in room.grid.shape[:2])
    mean_m_s = np.array(spec.wind_m_s or scenario.wind.inlet_velocity_m_s)[:2]
    if find_middle_gain((x_m, y_m), mean_m_s, gusts, spec.eddy_viscosity_m2_s) > _LEAST_GAIN:
        return []
    return [
        Problem(
            where="gas.farrell.gust_std_m_s",
            expected="gusts that reach the middle of the field within their period",
            found=f"{gusts.period_s:g} s in a field of {x_m:g} x {y_m:g} m",
            remedy=f"Those at the corners are {1 / _LEAST_GAIN:g} times gust_std_m_s and fade towards the middle; take "
            "a longer gust_period_s, more eddy_viscosity_m2_s or a smaller field.",
        )
    ]


# The wind between two instants: gusts (2, 4) and their rates at the corners, wind at nodes and in cells, time on the
# wind's own clock.
@dataclass(kw_only=True)
class _WindState:
    rng: np.random.Generator
    gust_m_s: NDArray[np.float64]
    rate_m_s2: NDArray[np.float64]
    wind_m_s: NDArray[np.float64]
    spare_m_s: NDArray[np.float64]
    in_cells: NDArray[np.float32]
    n_clock: int = 0


class FarrellWind:
    """The wind of an open field, horizontal and the same at all heights.

    State: wind at nodes, gusts at the corners; starts as even mean wind with gusts in their stationary state. It goes
    on by its own clock of 10 ms, from its own stream, independent of its readers.

    Source: Farrell et al. 2002, Filament-based atmospheric dispersion model, doi:10.1023/A:1016283702837.
    Held by: extensions/formats/tests/unit/test_farrell.py
    """

    def __init__(self, grid: Grid, *, mean_m_s: Vec3, gusts: Gusts, viscosity_m2_s: float, n_nodes: int) -> None:
        """Prepare the field over the floor of a grid, with `n_nodes` nodes along each side.

        `gusts` are those in its middle; at the corners they are stronger, see `find_middle_gain`.
        """
        self._cells = grid.shape[:2]
        self._shape = (n_nodes, n_nodes, 2)
        sides_m = np.multiply(grid.shape[:2], grid.cell_m)
        self._dx_m, self._dy_m = (float(side_m) / (n_nodes - 1) for side_m in sides_m)
        self._mean_m_s = np.array(mean_m_s[:2], np.float64)
        gain = find_middle_gain((float(sides_m[0]), float(sides_m[1])), self._mean_m_s, gusts, viscosity_m2_s)
        self._gusts = gusts = replace(gusts, std_m_s=gusts.std_m_s / gain)
        self._viscosity_m2_s = viscosity_m2_s
        strongest_m_s = float(abs(self._mean_m_s).max()) + _MAX_GUST_STD * gusts.std_m_s
        stable_s = stable_step_s(strongest_m_s, viscosity_m2_s, self._dx_m, self._dy_m)
        self._n_substeps = max(1, math.ceil(WIND_STEP_S / stable_s))
        self._transition, self._spread = exact_gust_step(gusts, WIND_STEP_S)
        self._state = self._start(0)

    def reset(self, seed: int) -> None:
        """Return to time 0."""
        self._state = self._start(seed)

    def at(self, time_s: float) -> NDArray[np.float32]:
        """Return the (nx, ny, 1, 3) wind at cell centres [m/s] at a time [s], which never goes back."""
        state = self._state
        n_due = int(time_s / WIND_STEP_S + 1e-6) - state.n_clock
        if n_due > 0:
            blow_inplace(
                state.wind_m_s, state.spare_m_s, state.gust_m_s, state.rate_m_s2, self._mean_m_s, self._transition,
                self._spread, state.rng.standard_normal((n_due, 2, 4, 2)), self._dx_m, self._dy_m, self._viscosity_m2_s,
                WIND_STEP_S / self._n_substeps, self._n_substeps,
            )  # fmt: skip
            state.n_clock += n_due
            state.in_cells = wind_in_cells(state.wind_m_s, *self._cells)
        return state.in_cells

    def _start(self, seed: int) -> "_WindState":
        rng = stream(seed, "fields.farrell")
        gust_m_s = self._gusts.std_m_s * rng.standard_normal((2, 4))
        rate_std_m_s2 = self._gusts.std_m_s * 2.0 * math.pi / self._gusts.period_s
        rate_m_s2 = rate_std_m_s2 * rng.standard_normal((2, 4))
        wind_m_s = np.empty(self._shape)
        wind_m_s[:] = self._mean_m_s
        spare_m_s = wind_m_s.copy()
        set_edges_inplace(wind_m_s, gust_m_s + self._mean_m_s[:, None])
        return _WindState(
            rng=rng,
            gust_m_s=gust_m_s,
            rate_m_s2=rate_m_s2,
            wind_m_s=wind_m_s,
            spare_m_s=spare_m_s,
            in_cells=wind_in_cells(wind_m_s, *self._cells),
        )


class OpenFieldPlume:
    """Filaments in Farrell's wind, which begins again with them; see `FilamentSource`."""

    def __init__(self, plume: FilamentPlume, wind: FarrellWind) -> None:
        self._plume = plume
        self._wind = wind

    @property
    def step(self) -> int:
        """Number of steps made."""
        return self._plume.step

    @property
    def time_s(self) -> float:
        """Time since the sources opened [s]."""
        return self._plume.time_s

    @property
    def filaments(self) -> Filaments:
        """The filaments now."""
        return self._plume.filaments

    def reset(self, seed: int) -> None:
        """Return to time 0."""
        self._wind.reset(seed)
        self._plume.reset(seed)

    def advance(self, n_steps: int = 1) -> None:
        """Go on by steps."""
        self._plume.advance(n_steps)

    def add_filaments(self, position_world_m: NDArray[np.float64]) -> None:
        """Add filaments; see `FilamentPlume.add_filaments`."""
        self._plume.add_filaments(position_world_m)

    def blow(self, jets: Jets) -> None:
        """Carry filaments down in the jets of vehicles for one step."""
        self._plume.blow(jets)


def open_sides_and_top(environment: Environment) -> Environment:
    """Return an environment with sides and top as outlets of gas; the floor and the obstacles on it stay solid."""
    occupancy = np.array(environment.occupancy)
    for border in (occupancy[0], occupancy[-1], occupancy[:, 0], occupancy[:, -1], occupancy[:, :, -1]):
        border[border == Cell.FREE] = Cell.OUTLET
    return replace(environment, occupancy=occupancy, content_hash=f"{environment.content_hash}, open")


@build_gas_field_from_block.register
def _build_farrell_field(block: FarrellGasSpec, setup: GasSetup) -> GasField:
    scenario, environment, spec = setup.scenario, setup.environment, block.farrell
    mean_m_s = spec.wind_m_s or wind_at_first_source_m_s(scenario, environment)
    wind = FarrellWind(
        environment.grid,
        mean_m_s=mean_m_s,
        gusts=Gusts(std_m_s=spec.gust_std_m_s, period_s=spec.gust_period_s, damping=spec.gust_damping),
        viscosity_m2_s=spec.eddy_viscosity_m2_s,
        n_nodes=spec.n_nodes,
    )
    field_of_air = open_sides_and_top(environment)
    model = build_gas_model(scenario, field_of_air, wind_at=wind.at, own_speed_m_s=norm2(*mean_m_s[:2]))
    source = OpenFieldPlume(model.plume, wind)
    source.reset(setup.seed)
    return FilamentField(
        source,
        model.gases,
        environment.grid,
        sight=setup.sight or Visibility(walls=Walls.of(field_of_air), cutoff_sigma=model.cutoff_sigma),
        n_readings_per_step=setup.n_readings_per_step,
        wind_at=wind.at,
        images=build_wall_images(block, field_of_air),
        turbulence=build_point_turbulence(block, model, setup, wind_at=wind.at),
    )
