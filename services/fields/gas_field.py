"""Interface of all gas models: gas in an environment over time, at points and on grids."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from gslcosim.base.quantities import Vec3
from gslcosim.environment.grid_kernels import trilinear_wind_at_points
from gslcosim.environment.model import Environment
from gslcosim_services.fields.filament.plume import Filaments
from gslcosim_services.fields.mixing_ratio import CUTOFF_SIGMA, Walls

NO_FILAMENTS = Filaments(
    position_world_m=np.zeros((0, 3)),
    sigma_m=np.zeros(0),
    source_index=np.zeros(0, np.int32),
    amount_mol=np.zeros(1),
    gas_index=np.zeros(1, np.int32),
)


@dataclass(frozen=True, kw_only=True)
class Visibility:
    """Visibility of filaments to readings: hidden by `walls` (absent: through them), and up to `cutoff_sigma` away.

    Models without filaments ignore it.
    """

    walls: Walls | None = None
    cutoff_sigma: float = CUTOFF_SIGMA


@dataclass(frozen=True, kw_only=True)
class PointGrid:
    """A regular grid of points: `first_m` has index (0, 0, 0); `shape` counts them along x, y, z; index order ij."""

    first_m: Vec3
    spacing_m: float
    shape: tuple[int, int, int]

    def axes_m(self) -> list[NDArray[np.float64]]:
        """Return the coordinates of the points along x, y and z [m]."""
        return [
            first + np.arange(n, dtype=np.float64) * self.spacing_m
            for first, n in zip(self.first_m, self.shape, strict=True)
        ]

    def points_m(self) -> NDArray[np.float64]:
        """Return all points, (nx * ny * nz, 3), world frame [m]; z runs fastest."""
        return np.stack(np.meshgrid(*self.axes_m(), indexing="ij"), axis=-1).reshape(-1, 3)


class GasField(Protocol):
    """Gas in a room over time. Time 0 is when the sources open; a step has the length of `gas.step_s`.

    Everything follows from the seed; queries change nothing.
    """

    @property
    def gases(self) -> tuple[str, ...]:
        """Names of the gases, in the order of the columns of mixing ratios."""
        ...

    @property
    def step(self) -> int:
        """Number of steps made."""
        ...

    @property
    def filaments(self) -> Filaments:
        """The filaments now, none in models without; the next step may overwrite them."""
        ...

    def reset(self, seed: int) -> None:
        """Return to time 0."""
        ...

    def advance(self, n_steps: int = 1) -> None:
        """Advance by steps."""
        ...

    def mixing_ratio_ppm_at(self, points_world_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the (m, n_gases) mixing ratios [ppm by volume] now at (m, 3) points, world frame [m]."""
        ...

    def mixing_ratio_ppm_on_grid(self, grid: PointGrid, *, gas: int = 0, cutoff_sigma: float) -> NDArray[np.float64]:
        """Return the (nx, ny, nz) mixing ratio of one gas [ppm by volume] now; walls hide no filaments."""
        ...

    def wind_m_s_at(self, points_world_m: NDArray[np.float64]) -> NDArray[np.float64] | None:
        """Return the (m, 3) wind now, world frame [m/s], if the model has its own; otherwise the room's holds."""
        ...


def wind_m_s_at(
    gas: GasField, environment: Environment, points_world_m: NDArray[np.float64], time_s: float
) -> NDArray[np.float64]:
    """Return the wind at points: that of the gas's own model if it has one, otherwise that of the room.

    Args:
        gas: Gas at `time_s`.
        points_world_m: (n, 3) points, world frame [m].
        time_s: Time since the sources opened [s].

    Returns:
        (n, 3) wind, world frame [m/s].
    """
    own_m_s = gas.wind_m_s_at(points_world_m)
    if own_m_s is not None:
        return own_m_s
    grid, wind = environment.grid, environment.wind
    frame = np.asarray(wind.velocity_m_s)[wind.frame_at(time_s)]
    return trilinear_wind_at_points(frame, grid.origin_m, grid.cell_m, points_world_m)
