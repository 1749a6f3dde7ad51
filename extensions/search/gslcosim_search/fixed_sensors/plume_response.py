# pyright: basic
"""Response of fixed sensors and laser paths to a source upwind, by a Gaussian plume from measured turbulence."""

# ruff: noqa: ANN001, ANN202 - kernels have no types, and symbols of equations

import math
from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

from gslcosim.base.errors import ShapeError
from gslcosim_search import elementary

Floats = NDArray[np.float64]

# Beyond so many deviations across the plume there is nothing: exp(-18) is 1.5e-8.
_FARTHEST = 6.0


@dataclass(frozen=True)
class SensorPaths:
    """Sensors as sample points: a point sensor has one, a laser's path many, over which the reading is the mean.

    `points_m` (k, p, 3) world frame [m], z above ground.
    """

    points_m: Floats

    @classmethod
    def of_points(cls, points_m: Floats) -> "SensorPaths":
        """Return point sensors at (k, 3) places [m]."""
        return cls(np.asarray(points_m, dtype=np.float64)[:, None, :])

    @classmethod
    def of_beams(cls, instrument_m: Floats, reflectors_m: Floats, *, n_points: int = 80) -> "SensorPaths":
        """Return paths from one instrument to (k, 3) reflectors [m], summed at the midpoints of equal pieces."""
        share = (np.arange(n_points) + 0.5) / n_points
        start, ends = np.asarray(instrument_m, dtype=np.float64), np.asarray(reflectors_m, dtype=np.float64)
        return cls(start + share[None, :, None] * (ends[:, None, :] - start))


@dataclass(frozen=True)
class WindStatistics:
    """Wind of n periods, such as minutes: means and fluctuations within each.

    `mean_world_m_s` (n, 2) toward x and y; `across_std_m_s`, `up_std_m_s` (n,) standard deviations of the wind across
    the mean wind and upward within the period [m/s].
    """

    mean_world_m_s: Floats
    across_std_m_s: Floats
    up_std_m_s: Floats

    @classmethod
    def of_components(cls, mean_world_m_s: Floats, std_world_m_s: Floats) -> "WindStatistics":
        """Return statistics from (n, 3) means and standard deviations of the components x, y, z [m/s].

        s_across^2 = (s_x e_y)^2 + (s_y e_x)^2, e the mean wind's direction: as if x and y did not go together.
        """
        mean = np.ascontiguousarray(mean_world_m_s[:, :2])
        speed = np.linalg.norm(mean, axis=1)
        along = mean / np.where(speed > 0.0, speed, 1.0)[:, None]
        across = np.linalg.norm(std_world_m_s[:, :2] * along[:, ::-1], axis=1)
        return cls(mean, across, np.ascontiguousarray(std_world_m_s[:, 2]))


@numba.njit(cache=True)
def _responses(points_m, wind_m_s, across_std_m_s, up_std_m_s, source_m, source_sigma_m):
    n, k, p = wind_m_s.shape[0], points_m.shape[0], points_m.shape[1]
    total = np.zeros((n, k))
    h = source_m[2]
    for i in range(n):
        u = math.sqrt(wind_m_s[i, 0] ** 2 + wind_m_s[i, 1] ** 2)
        if not u > 0.0:
            total[i] = math.nan
            continue
        e_x, e_y = wind_m_s[i, 0] / u, wind_m_s[i, 1] / u
        for j in range(k):
            for m in range(p):
                dx, dy = points_m[j, m, 0] - source_m[0], points_m[j, m, 1] - source_m[1]
                x = dx * e_x + dy * e_y
                if x <= 0.0:
                    continue
                y, z, t = dy * e_x - dx * e_y, points_m[j, m, 2], x / u
                sigma_y = math.sqrt(source_sigma_m**2 + (across_std_m_s[i] * t) ** 2)
                if abs(y) > _FARTHEST * sigma_y:
                    continue
                sigma_z = math.sqrt(source_sigma_m**2 + (up_std_m_s[i] * t) ** 2)
                upward = elementary.exp(-0.5 * ((z - h) / sigma_z) ** 2) + elementary.exp(
                    -0.5 * ((z + h) / sigma_z) ** 2
                )
                across = elementary.exp(-0.5 * (y / sigma_y) ** 2)
                total[i, j] += across * upward / (2.0 * math.pi * sigma_y * sigma_z * u)
            total[i, j] *= 1e6 / p
    return total


def plume_responses(
    sensors: SensorPaths, wind: WindStatistics, source_m: Floats, *, source_sigma_m: float = 0.5
) -> Floats:
    """Return the reading of each sensor in each period above background, per cubic metre of pure gas a second.

    C / Q = exp(-y^2 / (2 sy^2)) (exp(-(z - h)^2 / (2 sz^2)) + exp(-(z + h)^2 / (2 sz^2))) / (2 pi sy sz u)
    sy^2 = a^2 + (s_across t)^2,  sz^2 = a^2 + (s_up t)^2,  t = x / u
    [1 / (m3/s)] = [1] / ([m2] [m/s]); times 1e6 for ppm. x, y along and across the wind, h height of the source.

    Args:
        sensors: Points or paths of the k sensors.
        wind: Of n periods; nan wind gives nan.
        source_m: (3,) place of the source, world frame, z above ground [m].
        source_sigma_m: a, deviation of the gas at the source [m].

    Returns:
        (n, k) [ppm s/m3]; nan in calm air.

    Source:
        Taylor 1922 for times short beside the Lagrangian time scale, where a plume spreads as fast as the wind
        fluctuates; mean and image plume as every textbook.
    Left out:
        The path of the gas through changing wind (periods are taken as steady, which needs x / u below a few of them),
        the slower spread over long distances, spread along the wind.
    Held by:
        extensions/search/tests/unit/fixed_sensors/test_plume_response.py (the flux through a plane downwind is Q)

    Raises:
        ShapeError: the arrays do not fit each other.
    """
    n = len(wind.mean_world_m_s)
    if wind.mean_world_m_s.shape != (n, 2) or wind.across_std_m_s.shape != (n,) or wind.up_std_m_s.shape != (n,):
        raise ShapeError("wind: expected means (n, 2) and standard deviations (n,) of the same n periods.")
    return _responses(
        np.ascontiguousarray(sensors.points_m),
        np.ascontiguousarray(wind.mean_world_m_s),
        np.ascontiguousarray(wind.across_std_m_s),
        np.ascontiguousarray(wind.up_std_m_s),
        np.asarray(source_m, dtype=np.float64),
        source_sigma_m,
    )
