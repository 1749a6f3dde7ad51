# pyright: basic
# ruff: noqa: ANN001, ANN201 - kernels have no types, and symbols of equations
"""Inner fluctuation: uneven gas within filaments, as a random factor of mean one that drifts along."""

import math
from functools import lru_cache
from typing import Any, NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from gslcosim.base import elementary
from gslcosim.base.rng import stream
from gslcosim_services.fields.turbulence.air import drift_with_slopes
from gslcosim_services.fields.turbulence.eddies import (
    LIFE_PER_TIME_SCALE,
    N_EDDY_OCTAVES,
    N_FINE_OCTAVES,
    N_LAYERS,
    EddyScales,
    draw_origin,
    largest_spacing_m,
    list_pattern_ages,
    octave_shares,
)
from gslcosim_services.fields.turbulence.pattern_sums import N_LATTICE

_NODES = N_LATTICE * N_LATTICE * N_LATTICE
# Mean of the square of a sum of 27 quadratic splines over unit normal numbers.
_SPLINE_VARIANCE = 0.55 * 0.55 * 0.55


class InnerLayers(NamedTuple):
    """Structure of one instant, in the form for kernels.

    `numbers` (n n n,) float32 stand at the nodes of a lattice that repeats. Of m patterns, `offset` (m, 3) are the
    origins in it [nodes], `spacing_m`, `drift_s` and `weight` (m,): distance of nodes, time of drift and weight.
    """

    numbers: Any
    offset: Any
    spacing_m: Any
    drift_s: Any
    weight: Any


@numba.njit(cache=True, nogil=True)
def lattice_value(numbers, px, py, pz):
    """Return one lattice's random number at a place in units of nodes, by quadratic B-splines; periodic.

    Held by:
        tests/unit/services/fields/turbulence/test_inner_fluctuation.py
    """
    fx, fy, fz = math.floor(px), math.floor(py), math.floor(pz)
    i, j, k = np.int64(fx), np.int64(fy), np.int64(fz)
    tx, ty, tz = px - fx, py - fy, pz - fz
    sx, sy, sz = 1.0 - tx, 1.0 - ty, 1.0 - tz
    wx = (0.5 * sx * sx, 0.5 + tx * sx, 0.5 * tx * tx)
    wy = (0.5 * sy * sy, 0.5 + ty * sy, 0.5 * ty * ty)
    z0, z1, z2 = 0.5 * sz * sz, 0.5 + tz * sz, 0.5 * tz * tz
    mask = N_LATTICE - 1
    k0, k1, k2 = k & mask, (k + 1) & mask, (k + 2) & mask
    value = 0.0
    for a in range(3):
        plane = ((i + a) & mask) * N_LATTICE
        for b in range(3):
            row = (plane + ((j + b) & mask)) * N_LATTICE
            value += wx[a] * wy[b] * (z0 * numbers[row + k0] + z1 * numbers[row + k1] + z2 * numbers[row + k2])
    return value


@numba.njit(cache=True, nogil=True)
def inner_factors(points_m, layers, drift_m_s, origin_m, cell_m, shape):
    """Return the factors of the mixing ratio at points: Weibull numbers of mean one, with X normal of unit variance.

    M = (-ln(1 - Phi(X)))^(1 / k) / Gamma(1 + 1 / k)

    Args:
        points_m: (m, 3) points, world frame [m].
        layers: `InnerLayers`.
        drift_m_s: wind that carries structure, see `AirNodes`.
        origin_m: (3,) corner of cell (0, 0, 0), world frame [m].
        cell_m: Edge of the cubic cells [m].
        shape: Shape k of the Weibull distribution.

    Held by:
        tests/unit/services/fields/turbulence/test_inner_fluctuation.py
    """
    factors = np.empty(points_m.shape[0])
    per_mean = elementary.exp(-elementary.lgamma(1.0 + 1.0 / shape))
    for p in range(points_m.shape[0]):
        x, y, z = points_m[p, 0], points_m[p, 1], points_m[p, 2]
        wind = drift_with_slopes(drift_m_s, origin_m, cell_m, x, y, z)
        total = 0.0
        for n in range(layers.weight.size):
            s, h, offset = layers.drift_s[n], layers.spacing_m[n], layers.offset[n]
            qx = (x - s * wind[0]) / h + offset[0]
            qy = (y - s * wind[1]) / h + offset[1]
            qz = (z - s * wind[2]) / h + offset[2]
            total += layers.weight[n] * lattice_value(layers.numbers, qx, qy, qz)
        # The logarithm of a normal tail; beyond 8 standard deviations it is out of the range of numbers.
        tail = 0.5 * elementary.erfc(min(max(total, -8.0), 8.0) * math.sqrt(0.5))
        factors[p] = per_mean * elementary.pow(-elementary.log(tail), 1.0 / shape)
    return factors


def weibull_shape(intensity: float) -> float:
    """Return the shape k of the Weibull distribution with this standard deviation over mean, 0.05 to 20.

    1 + i^2 = Gamma(1 + 2 / k) / Gamma(1 + 1 / k)^2, by bisection of the logarithm.
    """
    low, high = 0.1, 30.0
    for _ in range(60):
        k = math.sqrt(low * high)
        found = elementary.lgamma(1.0 + 2.0 / k) - 2.0 * elementary.lgamma(1.0 + 1.0 / k)
        low, high = (k, high) if found > elementary.log1p(intensity * intensity) else (low, k)
    return math.sqrt(low * high)


class InnerFluctuation:
    """Factor of mean one for the gas within filaments: a function of place, time and seed.

    A normal field is the sum of octaves of size l with variances as l^(2/3), which gives a spectrum of slope -5/3; each
    drifts with the mean wind and decorrelates in its own time, as l^(2/3). The largest is below the smallest eddies
    that move filaments, so no size is counted twice. The factor has a Weibull distribution. The gas's amount is kept in
    the mean over many such structures, not in each filament.

    Source:
        Weibull distribution of concentrations: Oettl and Ferrero 2017, Atmospheric Environment 152, 1; spectrum:
        Obukhov 1949 and Corrsin 1951, measured by Mylne and Mason 1991, QJRMS 117, 177.
    Held by:
        tests/unit/services/fields/turbulence/test_inner_fluctuation.py
    """

    def __init__(self, scales: EddyScales, *, intensity: float, seed: int) -> None:
        """Build the factor; `intensity` is its standard deviation, one its mean."""
        self._shape = weibull_shape(intensity) if intensity > 0.0 else math.inf
        self._seed = seed
        octaves = np.arange(N_EDDY_OCTAVES, N_EDDY_OCTAVES + N_FINE_OCTAVES)
        self._weight = np.sqrt(octave_shares(N_FINE_OCTAVES) / _SPLINE_VARIANCE)
        self._life_s = (LIFE_PER_TIME_SCALE * scales.time_s * elementary.pow_each(2.0, -2.0 * octaves / 3.0)).tolist()
        self._spacing_m = np.repeat(largest_spacing_m(scales.length_m) * np.ldexp(1.0, -octaves), N_LAYERS)

    def reset(self, seed: int) -> None:
        """Begin again with a seed."""
        self._seed = seed

    def factors_at(
        self, points_m: NDArray[np.float64], time_s: float, drift_m_s: NDArray[np.float32], origin_m: Any, cell_m: float
    ) -> NDArray[np.float64]:
        """Return the (m,) factors at (m, 3) points, world frame [m], at a time >= 0 [s]; see `inner_factors`."""
        if math.isinf(self._shape):
            return np.ones(len(points_m))
        return inner_factors(points_m, self._at(time_s), drift_m_s, origin_m, cell_m, self._shape)

    def _at(self, time_s: float) -> InnerLayers:
        ages = list_pattern_ages(time_s, self._life_s)
        return InnerLayers(
            draw_numbers(self._seed),
            np.array([draw_origin(self._seed, "inner", age) for age in ages]),
            self._spacing_m,
            np.array([age.drift_s for age in ages]),
            np.array([self._weight[age.octave] * age.fade for age in ages]),
        )


# Cached outside of the objects, as for eddies.
@lru_cache(maxsize=4)
def draw_numbers(seed: int) -> NDArray[np.float32]:
    """Return the numbers of a seed at the nodes of the lattice, (n n n,)."""
    return stream(seed, "fields.inner").standard_normal(_NODES, dtype=np.float32)
