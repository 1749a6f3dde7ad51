# pyright: basic

"""Compiled kernels of steady Gaussian plumes."""

import math

import numba
import numpy as np
from numpy.typing import NDArray

from gslcosim.base import elementary
from gslcosim.base.scalar_kernels import norm2
from gslcosim_formats.gaussian_plume import OPEN_COUNTRY, FormulaGasSpec, build_mean_plumes, list_gas_columns
from gslcosim_services.fields.gas_setup import GasSetup

# One steady plume, as kernels take it; see `gaussian_plume.GaussianPlume`.
PLUME_RECORD = np.dtype(
    [
        ("position_world_m", np.float64, (3,)),
        ("release_m3_s", np.float64),
        ("speed_m_s", np.float64),
        ("along", np.float64, (2,)),  # unit vector of the wind
        ("spread", np.float64, (4,)),  # a, b, c, p of sigma_y = a x / sqrt(1 + 1e-4 x), sigma_z = b x (1 + c x)^p
        ("has_ground", np.int64),
        ("gas", np.int64),  # which of the scenario's gases
    ]
)


@numba.njit(cache=True, nogil=True)
def spreads_at(plume, downwind_m):
    """Return the plume's standard deviations across the wind and upward [m] at a distance downwind [m].

    Args:
        plume: Record of `PLUME_RECORD`.
        downwind_m: Distance from the source along the wind [m]; below 0 the values of 1 m.

    Source:
        Briggs 1973; see `gaussian_plume.spreads_m`.
    Held by:
        extensions/training/tests/unit/batch/test_formula_plume_kernels.py
    """
    x_m = downwind_m if downwind_m > 0.0 else 1.0
    a, b, c, p = plume.spread[0], plume.spread[1], plume.spread[2], plume.spread[3]
    bend = elementary.pow(1.0 + c * x_m, p)
    return a * x_m / math.sqrt(1.0 + 1e-4 * x_m), b * x_m * bend


@numba.njit(cache=True, nogil=True)
def distances_along_and_across(plume, x_m, y_m):
    """Return the distances of a place from the source along and across the wind [m].

    Args:
        plume: Record of `PLUME_RECORD`.
        x_m: Place, world frame [m].
        y_m: Place, world frame [m].
    """
    dx_m, dy_m = x_m - plume.position_world_m[0], y_m - plume.position_world_m[1]
    u, v = plume.along[0], plume.along[1]
    return dx_m * u + dy_m * v, dx_m * -v + dy_m * u


@numba.njit(cache=True, nogil=True)
def _gaussian_value(x_m, sigma_m):
    exponent = -(x_m * x_m) / (2.0 * (sigma_m * sigma_m))
    return elementary.exp(exponent)


@numba.njit(cache=True, nogil=True)
def plume_ppm(plume, along_m, across_m, z_m, rise_m, sigma_y_m, sigma_z_m):
    """Return the mixing ratio of a plume [ppm by volume]; see `gaussian_plume.GaussianPlume` for the equation.

    Args:
        plume: Record of `PLUME_RECORD`.
        along_m: Distance from the source along the wind [m].
        across_m: Distance from the plume's axis across it [m].
        z_m: Height above ground [m].
        rise_m: How far the plume's axis is above the source's height [m].
        sigma_y_m: Standard deviation across the wind [m].
        sigma_z_m: Standard deviation upward [m].

    Held by:
        extensions/training/tests/unit/batch/test_formula_plume_kernels.py
    """
    if not along_m > 0.0:
        return 0.0
    h_m = plume.position_world_m[2] + rise_m
    upward = _gaussian_value(z_m - h_m, sigma_z_m)
    if plume.has_ground:
        upward = upward + _gaussian_value(z_m + h_m, sigma_z_m)
    across = _gaussian_value(across_m, sigma_y_m)
    thickness = 2.0 * math.pi * sigma_y_m * sigma_z_m * plume.speed_m_s
    return 1e6 * plume.release_m3_s / thickness * across * upward


@numba.njit(cache=True, nogil=True)
def steady_ppm(plume, x_m, y_m, z_m):
    """Return the mixing ratio of a steady plume [ppm by volume] at a place, world frame [m].

    Args:
        plume: Record of `PLUME_RECORD`.
        x_m: Place, world frame [m].
        y_m: Place, world frame [m].
        z_m: Place, world frame [m].

    Held by:
        extensions/training/tests/unit/batch/test_formula_plume_kernels.py
    """
    along_m, across_m = distances_along_and_across(plume, x_m, y_m)
    if not along_m > 0.0:
        return 0.0
    sigma_y_m, sigma_z_m = spreads_at(plume, along_m)
    return plume_ppm(plume, along_m, across_m, z_m, 0.0, sigma_y_m, sigma_z_m)


@numba.njit(cache=True, nogil=True)
def steady_ppm_at(plume, points_world_m):
    """Return the (n,) mixing ratios [ppm by volume] of a steady plume at (n, 3) points, world frame [m]."""
    ppm = np.empty(len(points_world_m))
    for i in range(len(points_world_m)):
        ppm[i] = steady_ppm(plume, points_world_m[i, 0], points_world_m[i, 1], points_world_m[i, 2])
    return ppm


def build_plume_records(gas: FormulaGasSpec, setup: GasSetup) -> NDArray[np.void]:
    """Return the (n,) mean plumes of the sources as records of `PLUME`, for kernels."""
    means = build_mean_plumes(gas, setup)
    rows = np.zeros(len(means), PLUME_RECORD)
    for row, mean, column in zip(rows, means, list_gas_columns(gas), strict=True):
        speed_m_s = norm2(*mean.wind_world_m_s[:2])
        row["position_world_m"], row["release_m3_s"] = mean.position_world_m, mean.release_m3_s
        row["speed_m_s"], row["along"] = speed_m_s, np.array(mean.wind_world_m_s[:2]) / speed_m_s
        row["spread"], row["has_ground"], row["gas"] = OPEN_COUNTRY[mean.stability], mean.has_ground, column
    return rows
