"""The steady Gaussian plume: the time mean behind a point source in even wind."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from gslcosim.environment.grid import Vec3
from gslcosim.errors import ModelError
from gslcosim.fields.concentration import checked_points

StabilityClass = Literal["A", "B", "C", "D", "E", "F"]

# sigma_y = a x / sqrt(1 + 1e-4 x); sigma_z = b x (1 + c x)^p: (a, b, c, p) of each class, x in metres.
_OPEN_COUNTRY = {
    "A": (0.22, 0.20, 0.0, 0.0),
    "B": (0.16, 0.12, 0.0, 0.0),
    "C": (0.11, 0.08, 2e-4, -0.5),
    "D": (0.08, 0.06, 1.5e-3, -0.5),
    "E": (0.06, 0.03, 3e-4, -1.0),
    "F": (0.04, 0.016, 3e-4, -1.0),
}


def spreads_m(downwind_m: NDArray[np.float64], stability: StabilityClass) -> tuple[NDArray, NDArray]:
    """Return the plume's standard deviations across the wind and upward at distances downwind.

    Args:
        downwind_m: (n,) distance from the source along the wind x [m], > 0; meant for 100 m to 10 km.
        stability: Pasquill's class, A very unstable to F stable.

    Returns:
        (n,) sigma_y and (n,) sigma_z [m].

    Source:
        Briggs 1973, Diffusion estimation for small emissions, ATDL contribution 79, formulas for open country.
    Held by:
        tests/unit/fields/test_gaussian_plume.py
    """
    a, b, c, p = _OPEN_COUNTRY[stability]
    return a * downwind_m / np.sqrt(1.0 + 1e-4 * downwind_m), b * downwind_m * (1.0 + c * downwind_m) ** p


@dataclass(frozen=True, kw_only=True)
class GaussianPlume:
    """A continuous point source in even, horizontal wind; the ground reflects the plume.

    C = Q / (2 pi sy sz u) exp(-y^2 / (2 sy^2)) (exp(-(z - h)^2 / (2 sz^2)) + exp(-(z + h)^2 / (2 sz^2)))
    [1] = [m3/s] / ([m] [m] [m/s]); times 1e6 for ppm. x, y along and across the wind, z above ground, h the source's.

    `release_m3_s` is the volume of pure gas per second Q, `wind_world_m_s` the wind, whose vertical part counts as
    zero, `stability` the class of `spreads_m`. Upwind of the source there is no gas. Without `has_ground` the second
    term is left out: the thesis's eq. 5.1.

    Source: GSL-Bench thesis, eq. 5.1, with the image source of every textbook on air pollution.
    Left out: spread along the wind; walls; calm air (refused).
    Held by: tests/unit/fields/test_gaussian_plume.py
    """

    position_world_m: Vec3
    release_m3_s: float
    wind_world_m_s: Vec3
    stability: StabilityClass = "D"
    has_ground: bool = True

    def mixing_ratio_ppm_at(self, points_world_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the (n,) mixing ratio [ppm by volume] at (n, 3) points, world frame [m].

        Raises:
            ModelError: the air is calm.
            ShapeError: the points are not (n, 3).
        """
        speed_m_s = float(np.hypot(self.wind_world_m_s[0], self.wind_world_m_s[1]))
        if speed_m_s == 0.0:
            raise ModelError("gaussian plume: expected a horizontal wind that is not zero, was calm air.")
        along = np.array(self.wind_world_m_s[:2]) / speed_m_s
        points = checked_points(points_world_m)
        offset_m = points[:, :2] - np.array(self.position_world_m[:2])
        x_m, y_m = offset_m @ along, offset_m @ np.array([-along[1], along[0]])
        is_behind = x_m > 0.0
        sigma_y_m, sigma_z_m = spreads_m(np.where(is_behind, x_m, 1.0), self.stability)
        z_m, h_m = points[:, 2], self.position_world_m[2]
        upward = np.exp(-((z_m - h_m) ** 2) / (2.0 * sigma_z_m**2))
        if self.has_ground:
            upward = upward + np.exp(-((z_m + h_m) ** 2) / (2.0 * sigma_z_m**2))
        across = np.exp(-(y_m**2) / (2.0 * sigma_y_m**2))
        ppm = 1e6 * self.release_m3_s / (2.0 * np.pi * sigma_y_m * sigma_z_m * speed_m_s) * across * upward
        return np.where(is_behind, ppm, 0.0)
