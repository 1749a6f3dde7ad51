# pyright: basic
# ruff: noqa: ANN001, ANN201 - kernels have no types, and symbols of equations
"""Turbulence at points, for instruments: wind with its fluctuations, and gas that is uneven within filaments."""

from collections.abc import Callable

import numba
import numpy as np
from numpy.typing import NDArray

from gslcosim.environment.grid_kernels import trilinear_wind
from gslcosim.environment.model import Grid
from gslcosim_services.fields.turbulence.air import OWN_SHARE, TurbulentAir, eddy_velocity_at
from gslcosim_services.fields.turbulence.eddies import N_EDDY_OCTAVES, N_FINE_OCTAVES, LargeEddies
from gslcosim_services.fields.turbulence.inner_fluctuation import InnerFluctuation
from gslcosim_services.fields.turbulence.vector_kernels import N_SUMS


@numba.njit(cache=True, nogil=True)
def turbulent_wind_at_points(velocity_m_s, air, layers, origin_m, cell_m, points_m):
    """Return the (m, 3) wind at (m, 3) points, world frame [m/s]: the mean between cell centres, and all eddies.

    Args:
        velocity_m_s: (nx, ny, nz, 3) mean wind at cell centres [m/s].
        air: `AirNodes`.
        layers: `EddyLayers`.
        origin_m: (3,) corner of cell (0, 0, 0), world frame [m].
        cell_m: Edge of the cubic cells [m].
        points_m: (m, 3) points, world frame [m].
    """
    wind_m_s, sums = np.empty((points_m.shape[0], 3)), np.empty(N_SUMS, np.float32)
    for p in range(points_m.shape[0]):
        x, y, z = points_m[p, 0], points_m[p, 1], points_m[p, 2]
        u, v, w = trilinear_wind(velocity_m_s, origin_m, cell_m, x, y, z)
        eu, ev, ew = eddy_velocity_at(air, layers, origin_m, cell_m, x, y, z, sums)
        wind_m_s[p, 0], wind_m_s[p, 1], wind_m_s[p, 2] = u + eu, v + ev, w + ew
    return wind_m_s


class PointTurbulence:
    """Turbulence at the positions of instruments: a function of position, time and seed, with the eddies that move gas.

    Finer eddies are added, with the energy of each filament's own velocity.
    """

    def __init__(
        self,
        air: TurbulentAir,
        grid: Grid,
        *,
        inner_intensity: float,
        wind_at: Callable[[float], NDArray[np.float32]],
        seed: int,
    ) -> None:
        """Prepare.

        Args:
            inner_intensity: Standard deviation over mean of gas within filaments.
            wind_at: Mean wind at cell centres at a time [s].
        """
        self._air = air
        self._grid = grid
        self._wind_at = wind_at
        self._eddies = LargeEddies(
            air.scales,
            seed=seed,
            fine_share=OWN_SHARE / (1.0 - OWN_SHARE),
            n_octaves=N_EDDY_OCTAVES + N_FINE_OCTAVES,
        )
        self._inner = InnerFluctuation(air.scales, intensity=inner_intensity, seed=seed)

    def reset(self, seed: int) -> None:
        """Begin again with a seed."""
        self._eddies.reset(seed)
        self._inner.reset(seed)

    def wind_m_s_at(self, points_world_m: NDArray[np.float64], time_s: float) -> NDArray[np.float64]:
        """Return the (m, 3) wind at points at a time >= 0, world frame [m/s]."""
        wind_m_s = self._wind_at(time_s)
        return turbulent_wind_at_points(
            wind_m_s,
            self._air.nodes_in(wind_m_s),
            self._eddies.at(time_s),
            self._grid.origin_m,
            self._grid.cell_m,
            points_world_m,
        )

    def gas_factors_at(
        self, points_world_m: NDArray[np.float64], sigma_m: NDArray[np.float64], time_s: float
    ) -> NDArray[np.float64]:
        """Return the (m,) factors of mean one by which gas at points differs from its filaments, at a time >= 0.

        Args:
            sigma_m: (m,) size of the filaments there, see `mixing_ratio.mixing_ratio_and_size_at`.
        """
        drift_m_s = self._air.nodes_in(self._wind_at(time_s)).drift_m_s
        return self._inner.factors_at(
            points_world_m, sigma_m, time_s, drift_m_s, self._grid.origin_m, self._grid.cell_m
        )
