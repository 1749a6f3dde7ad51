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
    N_LAYERS,
    EddyScales,
    age_patterns,
    draw_origins,
    largest_spacing_m,
    octave_shares,
)
from gslcosim_services.fields.turbulence.vector_kernels import N_LATTICE

_NODES = N_LATTICE * N_LATTICE * N_LATTICE
# Mean of the square of a sum of 27 quadratic splines over unit normal numbers.
_SPLINE_VARIANCE = 0.55 * 0.55 * 0.55
N_INNER_OCTAVES = 5
"""Octaves of structure within filaments, from the smallest eddies that move them on."""
# Structure of nodes this many standard deviations of its filament apart is half as strong as in a larger filament.
_LARGEST_SIGMA = 1.5
_FADING = 1.35
"""Square of the intensity in large filaments, over that of integral length by standard deviation; see `inner_factors`.

9 b 0.43^(-2/3) / C_phi, b = (g_i / 6)^(1/3) = 0.171 of `grown_variance_m2` and 0.43 of `integral_length_m`.
"""


class InnerLayers(NamedTuple):
    """Structure of one instant, in the form for kernels.

    `numbers` (n n n,) float32 stand at the nodes of a lattice that repeats. Of m patterns, `offset` (m, 3) are the
    origins in it [nodes], `spacing_m`, `drift_s`, `weight` and `share` (m,): distance of nodes, time of drift, factor
    that leaves the two patterns of an octave with unit variance, and that octave's part of the factor's variance.
    """

    numbers: Any
    offset: Any
    spacing_m: Any
    drift_s: Any
    weight: Any
    share: Any


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
def bounded_power(intensity):
    """Return the power q with which a bounded factor has this standard deviation over mean, 0.01 to 3.

    q^3 + 5 q^2 - 8 i^2 q - 4 i^2 = 0, from the moments 2 / ((1 + n q) (2 + n q)); Newton's steps from above.
    """
    square = intensity * intensity
    q = intensity + square
    for _ in range(8):
        q -= (((q + 5.0) * q - 8.0 * square) * q - 4.0 * square) / ((3.0 * q + 10.0) * q - 8.0 * square)
    return q


@numba.njit(cache=True, nogil=True)
def inner_factors(points_m, sigma_m, layers, length_m, drift_m_s, origin_m, cell_m):
    """Return the factors of the mixing ratio at points: bounded numbers of mean one, with X normal of unit variance.

    M = (1 - sqrt(1 - Phi(X)))^q (1 + q) (2 + q) / 2,  q of the intensity i by `bounded_power`
    1 / i^2 = 1 / sum(v) + sigma^2 / (1.35 L^2),  v = share / (1 + (l / (1.5 sigma))^2) of octaves of size l

    A filament holds structure that is smaller than itself. While it is smaller than the largest eddies, its growth
    makes as much variance as mixing takes. A larger one has what is left when mixing, in a time k / (C_phi epsilon),
    takes what its growth makes: 9 b epsilon^(1/3) L^(4/3) / sigma^2 of its mean's square a second.

    Args:
        points_m: (m, 3) points, world frame [m].
        sigma_m: (m,) standard deviation of the filaments that are there, their mean by gas [m].
        layers: `InnerLayers`.
        length_m: Integral length L [m].
        drift_m_s: wind that carries structure, see `AirNodes`.
        origin_m: (3,) corner of cell (0, 0, 0), world frame [m].
        cell_m: Edge of the cubic cells [m].

    Source:
        Kumaraswamy 1980, Journal of Hydrology 46, 79, for the distribution, much like the beta distributions of gas
        that mixes (Girimaji 1991, Combustion Science and Technology 78, 177): no gas is denser than what it came from.
        Pope 2000, equation 12.337, for C_phi = 2. The balance in large filaments is ours.
    Held by:
        tests/unit/services/fields/turbulence/test_inner_fluctuation.py
    """
    factors = np.ones(points_m.shape[0])
    for p in range(points_m.shape[0]):
        size = sigma_m[p]
        if size <= 0.0:
            continue
        x, y, z = points_m[p, 0], points_m[p, 1], points_m[p, 2]
        wind = drift_with_slopes(drift_m_s, origin_m, cell_m, x, y, z)
        total = variance = 0.0
        for n in range(layers.weight.size):
            s, h, offset = layers.drift_s[n], layers.spacing_m[n], layers.offset[n]
            ratio = h / (_LARGEST_SIGMA * size)
            part = layers.share[n] / (1.0 + ratio * ratio)
            qx = (x - s * wind[0]) / h + offset[0]
            qy = (y - s * wind[1]) / h + offset[1]
            qz = (z - s * wind[2]) / h + offset[2]
            total += layers.weight[n] * math.sqrt(part) * lattice_value(layers.numbers, qx, qy, qz)
            variance += part / N_LAYERS
        total /= math.sqrt(variance)
        intensity_square = 1.0 / (1.0 / variance + size * size / (_FADING * length_m * length_m))
        power = bounded_power(math.sqrt(intensity_square))
        tail = 0.5 * elementary.erfc(min(max(total, -8.0), 8.0) * math.sqrt(0.5))
        factors[p] = elementary.pow(1.0 - math.sqrt(tail), power) * 0.5 * (1.0 + power) * (2.0 + power)
    return factors


class InnerFluctuation:
    """Factor of mean one for the gas within filaments: a function of place, time and seed.

    A normal field is the sum of octaves of size l with variances as l^(2/3), which gives a spectrum of slope -5/3; each
    drifts with the mean wind and decorrelates in its own time, as l^(2/3). The largest are of the size of the smallest
    eddies that move filaments, and are in filaments as large. The factor has a bounded distribution. The gas's
    amount is kept in the mean over many such structures, not in each filament.

    Source:
        Obukhov 1949 and Corrsin 1951 for the spectrum, measured by Mylne and Mason 1991, QJRMS 117, 177.
    Held by:
        tests/unit/services/fields/turbulence/test_inner_fluctuation.py
    """

    def __init__(self, scales: EddyScales, *, intensity: float, seed: int) -> None:
        """Build the factor; `intensity` is its standard deviation where all octaves are in, one its mean."""
        self._seed = seed
        self._length_m = scales.length_m
        octaves = np.arange(N_EDDY_OCTAVES - 1, N_EDDY_OCTAVES - 1 + N_INNER_OCTAVES)
        self._share = np.repeat(intensity * intensity * octave_shares(N_INNER_OCTAVES), N_LAYERS)
        self._life_s = LIFE_PER_TIME_SCALE * scales.time_s * elementary.pow_each(2.0, -2.0 * octaves / 3.0)
        self._spacing_m = np.repeat(largest_spacing_m(scales.length_m) * np.ldexp(1.0, -octaves), N_LAYERS)

    def reset(self, seed: int) -> None:
        """Begin again with a seed."""
        self._seed = seed

    def factors_at(
        self,
        points_m: NDArray[np.float64],
        sigma_m: NDArray[np.float64],
        time_s: float,
        drift_m_s: NDArray[np.float32],
        origin_m: Any,
        cell_m: float,
    ) -> NDArray[np.float64]:
        """Return the (m,) factors at (m, 3) points, world frame [m], at a time >= 0 [s]; see `inner_factors`."""
        if not self._share.any():
            return np.ones(len(points_m))
        return inner_factors(points_m, sigma_m, self._at(time_s), self._length_m, drift_m_s, origin_m, cell_m)

    def _at(self, time_s: float) -> InnerLayers:
        epochs, drift_s, fade = age_patterns(time_s, self._life_s)
        return InnerLayers(
            draw_numbers(self._seed),
            draw_origins(self._seed, "inner", tuple(epochs.tolist())),
            self._spacing_m,
            drift_s,
            fade / math.sqrt(_SPLINE_VARIANCE),
            self._share,
        )


# Cached outside of the objects, as for eddies.
@lru_cache(maxsize=4)
def draw_numbers(seed: int) -> NDArray[np.float32]:
    """Return the numbers of a seed at the nodes of the lattice, (n n n,)."""
    return stream(seed, "fields.inner").standard_normal(_NODES, dtype=np.float32)
