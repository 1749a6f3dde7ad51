"""Farrell's open field: gusts at the corners of a box stir a wind that carries filaments out of it."""

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gslcosim.environment.grid import Grid
from gslcosim.environment.model import Cell, Environment
from gslcosim.fields.filament.downwash import Jets
from gslcosim.fields.filament.plume import FilamentPlume, Filaments
from gslcosim.fields.models.farrell_kernels import blow_inplace, set_edges_inplace, wind_in_cells
from gslcosim.quantities import Vec3
from gslcosim.rng import stream

# The wind's own clock: its statistics depend neither on the gas's step nor on the tick.
CLOCK_S = 0.01
# Gusts beyond so many standard deviations are not met in years; the stable step is chosen for them.
_STRONGEST_GUST_STD = 6.0


@dataclass(frozen=True, kw_only=True)
class Gusts:
    """How the wind at a corner varies: a noisy oscillator of standard deviation, period and damping ratio."""

    std_m_s: float
    period_s: float
    damping: float


def exact_step(gusts: Gusts, dt_s: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return how a noisy oscillator goes on over a step of any length, without error.

    dx = y dt, dy = -(w^2 x + 2 z w y) dt + b dW, in its stationary state <x^2> = s^2, <y^2> = s^2 w^2, <x y> = 0
    state -> P state + L n: P the solution without noise, L L^T = C - P C P^T with C the stationary covariance

    Args:
        gusts: s, w = 2 pi / period and z < 1.
        dt_s: The step [s].

    Returns:
        (2, 2) P and (2, 2) lower triangle L, for the state (x [m/s], y [m/s2]).

    Source:
        Our derivation from the equation of pompy's ColouredNoiseGenerator, whose noise is multiplied by dt and so
        depends on the step; here the standard deviation is given and the step does not matter.
    Held by:
        tests/unit/fields/models/test_farrell.py (two half steps are a whole one; variance stays)
    """
    w, z = 2.0 * math.pi / gusts.period_s, gusts.damping
    w_d = w * math.sqrt(1.0 - z * z)
    decay, c, s = math.exp(-z * w * dt_s), math.cos(w_d * dt_s), math.sin(w_d * dt_s)
    transition = decay * np.array([[c + z * w / w_d * s, s / w_d], [-w * w / w_d * s, c - z * w / w_d * s]])
    stationary = gusts.std_m_s**2 * np.diag([1.0, w * w])
    added = stationary - transition @ stationary @ transition.T
    first = math.sqrt(max(added[0, 0], 0.0))
    cross = added[1, 0] / first if first > 0.0 else 0.0
    return transition, np.array([[first, 0.0], [cross, math.sqrt(max(added[1, 1] - cross * cross, 0.0))]])


def stable_step_s(speed_m_s: float, viscosity_m2_s: float, dx_m: float, dy_m: float) -> float:
    """Return the longest stable step of `advance_wind_inplace` [s] at speeds up to this in each direction.

    dt <= 1 / (u / dx + u / dy + 2 nu (1 / dx^2 + 1 / dy^2))
    """
    rate_per_s = speed_m_s * (1.0 / dx_m + 1.0 / dy_m) + 2.0 * viscosity_m2_s * (1.0 / dx_m**2 + 1.0 / dy_m**2)
    return 1.0 / rate_per_s if rate_per_s > 0.0 else math.inf


# The wind between two instants: gusts (2, 4) and their rates at the corners, wind at nodes and in cells, time on the
# wind's own clock.
@dataclass(kw_only=True)
class _Stirred:
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
    on by its own clock of 10 ms, from its own stream, whatever asks for it.

    Source: Farrell et al. 2002, Filament-based atmospheric dispersion model, doi:10.1023/A:1016283702837.
    Held by: tests/unit/fields/models/test_farrell.py
    """

    def __init__(self, grid: Grid, *, mean_m_s: Vec3, gusts: Gusts, viscosity_m2_s: float, n_nodes: int) -> None:
        """Prepare the field over the floor of a grid, with `n_nodes` nodes along each side."""
        self._cells = grid.shape[:2]
        self._shape = (n_nodes, n_nodes, 2)
        sides_m = np.multiply(grid.shape[:2], grid.cell_m)
        self._dx_m, self._dy_m = (float(side_m) / (n_nodes - 1) for side_m in sides_m)
        self._mean_m_s = np.array(mean_m_s[:2], np.float64)
        self._gusts = gusts
        self._viscosity_m2_s = viscosity_m2_s
        strongest_m_s = float(abs(self._mean_m_s).max()) + _STRONGEST_GUST_STD * gusts.std_m_s
        stable_s = stable_step_s(strongest_m_s, viscosity_m2_s, self._dx_m, self._dy_m)
        self._n_substeps = max(1, math.ceil(CLOCK_S / stable_s))
        self._transition, self._spread = exact_step(gusts, CLOCK_S)
        self._state = self._start(0)

    def reset(self, seed: int) -> None:
        """Return to time 0."""
        self._state = self._start(seed)

    def at(self, time_s: float) -> NDArray[np.float32]:
        """Return the (nx, ny, 1, 3) wind at cell centres [m/s] at a time [s], which never goes back."""
        state = self._state
        n_due = int(time_s / CLOCK_S + 1e-6) - state.n_clock
        if n_due > 0:
            blow_inplace(
                state.wind_m_s,
                state.spare_m_s,
                state.gust_m_s,
                state.rate_m_s2,
                self._mean_m_s,
                self._transition,
                self._spread,
                state.rng.standard_normal((n_due, 2, 4, 2)),
                self._dx_m,
                self._dy_m,
                self._viscosity_m2_s,
                CLOCK_S / self._n_substeps,
                self._n_substeps,
            )
            state.n_clock += n_due
            state.in_cells = wind_in_cells(state.wind_m_s, *self._cells)
        return state.in_cells

    def _start(self, seed: int) -> "_Stirred":
        rng = stream(seed, "fields.farrell")
        gust_m_s = self._gusts.std_m_s * rng.standard_normal((2, 4))
        rate_std_m_s2 = self._gusts.std_m_s * 2.0 * math.pi / self._gusts.period_s
        rate_m_s2 = rate_std_m_s2 * rng.standard_normal((2, 4))
        wind_m_s = np.empty(self._shape)
        wind_m_s[:] = self._mean_m_s
        spare_m_s = wind_m_s.copy()
        set_edges_inplace(wind_m_s, gust_m_s + self._mean_m_s[:, None])
        return _Stirred(
            rng=rng,
            gust_m_s=gust_m_s,
            rate_m_s2=rate_m_s2,
            wind_m_s=wind_m_s,
            spare_m_s=spare_m_s,
            in_cells=wind_in_cells(wind_m_s, *self._cells),
        )


class OpenFieldPlume:
    """Filaments in Farrell's wind, which begins anew with them; see `FilamentSource`."""

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

    def blow(self, jets: Jets) -> None:
        """Carry filaments down in the jets of vehicles for one step."""
        self._plume.blow(jets)


def open_field(environment: Environment) -> Environment:
    """Return an environment whose sides and top let gas out; the floor and what stands on it stay solid."""
    occupancy = np.array(environment.occupancy)
    for border in (occupancy[0], occupancy[-1], occupancy[:, 0], occupancy[:, -1], occupancy[:, :, -1]):
        border[border == Cell.FREE] = Cell.OUTLET
    return replace(environment, occupancy=occupancy, content_hash=f"{environment.content_hash}, open")
