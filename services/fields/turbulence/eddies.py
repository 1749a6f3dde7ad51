# pyright: basic
# ruff: noqa: ANN001, ANN201, ANN202 - kernels have no types, and symbols of equations
"""Large eddies: a random velocity without divergence that the mean wind carries."""

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from gslcosim.base import elementary
from gslcosim.base.rng import stream
from gslcosim_services.fields.turbulence.vector_kernels import N_LATTICE, N_SUMS, PADDED, add_pattern_pair

N_LAYERS = 2
"""Patterns of an octave at any time."""
# <(d psi_z / dy - d psi_y / dz)^2> of quadratic splines over unit normal numbers, in spacings: 2 (11/20)^2.
_CURL_VARIANCE = 2.0 * 0.55 * 0.55
# Splines over a lattice of spacing h correlate about as exp(-r^2 / h^2).
_SPACING_PER_LENGTH = 2.0 / math.sqrt(math.pi)
N_EDDY_OCTAVES = 3
"""Octaves of eddies that move filaments: of the largest size, a half and a quarter of it."""
N_FINE_OCTAVES = 3
"""Octaves below them, for instruments."""
LIFE_PER_TIME_SCALE = 4.0
"""Life of the largest pattern over the Lagrangian time scale; velocity in a drifting pattern decorrelates within it."""

# Columns of the table of turbulence at the corners of cells.
AMPLITUDE, OWN_STD, OWN_RATE, EPSILON_ROOT, SHEAR_SQUARE = range(5)
N_COLUMNS = 8
_MASK = N_LATTICE - 1
_HALF, _ONE, _NONE = np.float32(0.5), np.float32(1.0), np.float32(0.0)


def octave_shares(n: int) -> NDArray[np.float64]:
    """Return the fractions of n octaves in the energy of an inertial range, (size)^(2/3), of sum one."""
    shares = elementary.pow_each(2.0, -2.0 * np.arange(n) / 3.0)
    return shares / shares.sum()


def largest_spacing_m(length_m: float) -> float:
    """Return the distance of nodes of the largest octave [m], so that all have a longitudinal integral length [m]."""
    shares = octave_shares(N_EDDY_OCTAVES)
    return _SPACING_PER_LENGTH * length_m / sum(np.ldexp(shares, -np.arange(N_EDDY_OCTAVES)).tolist())


class EddyLayers(NamedTuple):
    """Eddies of one instant, in the form for kernels.

    `lattice` (PADDED^3 3 + 1,) float32 has random vectors of a seed at the nodes of a lattice that repeats. Each of
    m patterns, m even and two to an octave, has an origin of its own in it, `offset` (m, 3) [nodes]; `drift_s` (m,) is
    its time of drift with the mean wind since the middle of its life [s], `weight` (m,) its factor, `per_spacing_m`
    (m,) the inverse of its nodes' distance [1/m], float32 each.
    """

    lattice: Any
    offset: Any
    drift_s: Any
    weight: Any
    per_spacing_m: Any


@numba.njit(cache=True, nogil=True, inline="always")
def _find_start(qx, qy, qz):
    # Index of the lowest node of the lattice that reaches a place [nodes], and the place above its cell.
    fx, fy, fz = math.floor(qx), math.floor(qy), math.floor(qz)
    i, j, k = np.int64(fx) & _MASK, np.int64(fy) & _MASK, np.int64(fz) & _MASK
    return ((i * PADDED + j) * PADDED + k) * 3, np.float32(qx - fx), np.float32(qy - fy), np.float32(qz - fz)


@numba.njit(cache=True, nogil=True, inline="always")
def slopes_of(node, column):
    """Return the slopes of a column of `nodes_with_slopes` along x, y and z."""
    return node[N_COLUMNS + column], node[2 * N_COLUMNS + column], node[3 * N_COLUMNS + column]


@numba.njit(cache=True, nogil=True, inline="always")
def _add_pair(layers, n, x, y, z, drift, shear_square, sums):
    u, v, w, _, ux, vx, wx, _, uy, vy, wy, _, uz, vz, wz, _ = drift
    third = np.float32(1.0 / 3.0)
    s, r = layers.drift_s[n], layers.drift_s[n + 1]
    per_m, offset, other = layers.per_spacing_m[n], layers.offset[n], layers.offset[n + 1]
    start, ax, ay, az = _find_start(
        (x - s * u) * per_m + offset[0], (y - s * v) * per_m + offset[1], (z - s * w) * per_m + offset[2]
    )
    second, bx, by, bz = _find_start(
        (x - r * u) * per_m + other[0], (y - r * v) * per_m + other[1], (z - r * w) * per_m + other[2]
    )
    t, q = s * s * third, r * r * third
    kept_square, also_square = _ONE / (_ONE + t * shear_square), _ONE / (_ONE + q * shear_square)
    kept, also = layers.weight[n] * np.sqrt(kept_square), layers.weight[n + 1] * np.sqrt(also_square)
    add_pattern_pair(
        layers.lattice,
        sums,
        (start, second),
        (ax, ay, az, bx, by, bz),
        (
            _ONE - s * ux, -s * uy, -s * uz, -s * vx, _ONE - s * vy, -s * vz, -s * wx, -s * wy, _ONE - s * wz,
            _ONE - r * ux, -r * uy, -r * uz, -r * vx, _ONE - r * vy, -r * vz, -r * wx, -r * wy, _ONE - r * wz,
        ),
        (
            kept * per_m, kept, _HALF * kept * kept_square * t,
            also * per_m, also, _HALF * also * also_square * q,
        ),
    )  # fmt: skip


@numba.njit(cache=True, nogil=True, inline="always")
def eddy_velocity(layers, x, y, z, drift, node, sums):
    """Return the velocity of the large eddies at a point [m/s].

    u = curl(A c psi(q)),  q = (x - U(x) s) / h,  c = 1 / sqrt(1 + s^2 G / 3)
    [m/s] = [1/m] [m2/s]

    The derivatives of q, A and c are exact, so that div u = 0. Shear draws patterns out as they drift: the energy of
    curl(psi(q)) is 1 + s^2 G / 3 times that of an even wind, G the sum of the squared slopes of U, and c takes it back.

    Args:
        layers: `EddyLayers`.
        x, y, z: Point, world frame [m].
        drift: Of `drift_with_slopes`: the mean wind U that carries them, smooth over their size.
        node: Of `nodes_with_slopes`: with the amplitude A of the potential [m2/s], zero at walls, so that no eddy blows
            through them, and G [1/s2].
        sums: (N_SUMS,) float32, working memory.

    Source:
        Bridson, Hourihan and Nordenstam 2007, Curl-noise for procedural fluid flow, doi:10.1145/1275808.1276435:
        the curl of a random potential that fades at walls. That patterns drift and fade, and c, are ours.
    Held by:
        tests/unit/services/fields/turbulence/test_eddies.py (variance, in shear too, no divergence, none through walls)
    """
    sums[:] = _NONE
    for n in range(0, layers.weight.size, 2):
        _add_pair(layers, n, x, y, z, drift, node[SHEAR_SQUARE], sums)
    # Slopes along x, y and z of components x, y and z, then the potential, and what shear takes back.
    for i in range(N_SUMS // 8):
        for m in range(3):
            sums[8 * i + m] += sums[8 * i + 4 + m]
    px, py, pz, fx, fy, fz = sums[24], sums[25], sums[26], sums[32], sums[33], sums[34]
    amplitude, (ax, ay, az) = node[AMPLITUDE], slopes_of(node, AMPLITUDE)
    gx, gy, gz = slopes_of(node, SHEAR_SQUARE)
    return (
        amplitude * (sums[10] - sums[17] - gy * fz + gz * fy) + ay * pz - az * py,
        amplitude * (sums[16] - sums[2] - gz * fx + gx * fz) + az * px - ax * pz,
        amplitude * (sums[1] - sums[8] - gx * fy + gy * fx) + ax * py - ay * px,
    )


def potential_amplitude_m2_s(velocity_std_m_s: float, spacing_m: float) -> float:
    """Return the amplitude A of the potential from its curl's standard deviation along each axis [m2/s]."""
    return velocity_std_m_s * spacing_m / math.sqrt(_CURL_VARIANCE)


@dataclass(frozen=True, kw_only=True)
class EddyScales:
    """Scales of the large eddies: longitudinal integral length [m] and Lagrangian time scale [s]."""

    length_m: float
    time_s: float


@numba.njit(cache=True, nogil=True)
def age_patterns(time_s, life_s):
    """Return the ages of the `N_LAYERS` patterns of each octave at a time >= 0.

    A pattern grows in and fades out as a half sine over its life, and the next begins when the other is at its height.

    Args:
        time_s: The time [s].
        life_s: (n,) life of a pattern of each octave [s].

    Returns:
        (N_LAYERS n,) of each pattern: its number in its layer, int64; its drift since mid-life [s]; its fade, 0 to 1.
    """
    m = N_LAYERS * life_s.size
    epoch, drift_s, fade = np.empty(m, np.int64), np.empty(m), np.empty(m)
    for n in range(m):
        octave_life_s = life_s[n // N_LAYERS]
        lives = time_s / octave_life_s + n % N_LAYERS / N_LAYERS
        epoch[n] = math.floor(lives)
        drift_s[n] = (lives - epoch[n] - 0.5) * octave_life_s
        fade[n] = elementary.sin(math.pi * (lives - epoch[n]))
    return epoch, drift_s, fade


class LargeEddies:
    """Large eddies over time: a function of seed and time alone, the same for gas and instruments.

    Each octave has two patterns at any time; a pattern drifts with the mean wind for its life, grows in and fades out
    as a half sine, and the next begins when the other is at its height. Energy goes as size^(2/3), and so does life.
    """

    def __init__(
        self, scales: EddyScales, *, seed: int, fine_share: float = 0.0, n_octaves: int = N_EDDY_OCTAVES
    ) -> None:
        """Build the eddies of a seed.

        Args:
            scales: Of the turbulence.
            seed: Of the random numbers.
            fine_share: Energy of all octaves below the first `N_EDDY_OCTAVES`, over that of these.
            n_octaves: Number of octaves. The first are the same whatever their number.
        """
        octaves = np.arange(n_octaves)
        energy = np.zeros(n_octaves)
        energy[:N_EDDY_OCTAVES] = octave_shares(N_EDDY_OCTAVES)
        if n_octaves > N_EDDY_OCTAVES:
            energy[N_EDDY_OCTAVES:] = fine_share * octave_shares(n_octaves - N_EDDY_OCTAVES)
        # A is a velocity times the largest spacing; smaller lattices have as much less.
        self._factor = np.repeat(np.sqrt(energy) * np.ldexp(1.0, -octaves), N_LAYERS)
        self._life_s = LIFE_PER_TIME_SCALE * scales.time_s * elementary.pow_each(2.0, -2.0 * octaves / 3.0)
        spacing_m = np.ldexp(largest_spacing_m(scales.length_m), -octaves).astype(np.float32)
        self._per_spacing_m = np.repeat(np.float32(1.0) / spacing_m, N_LAYERS)
        self._seed = seed

    def reset(self, seed: int) -> None:
        """Begin again with a seed."""
        self._seed = seed

    def at(self, time_s: float) -> EddyLayers:
        """Return the eddies at a time >= 0 [s]."""
        epochs, drift_s, fade = age_patterns(time_s, self._life_s)
        return EddyLayers(
            draw_vectors(self._seed),
            draw_origins(self._seed, "eddies", tuple(epochs.tolist())),
            drift_s.astype(np.float32),
            (self._factor * fade).astype(np.float32),
            self._per_spacing_m,
        )


# Cached outside of the objects: plume and instruments use the same patterns, and no state holds them.
@lru_cache(maxsize=64)
def draw_origins(seed: int, of: str, epochs: tuple[int, ...]) -> NDArray[np.float64]:
    """Return the origins (m, 3) [nodes] of patterns of a seed in the lattice that their kind of patterns shares.

    Patterns of one lattice are independent of each other, as their origins are: its numbers have no mean.

    Args:
        seed: Of the random numbers.
        of: Kind of patterns.
        epochs: Numbers of m patterns in their layers, of `age_patterns`.
    """
    return np.array([_draw_origin(seed, of, n, epoch) for n, epoch in enumerate(epochs)])


@lru_cache(maxsize=256)
def _draw_origin(seed: int, of: str, n: int, epoch: int) -> list[float]:
    return (stream(seed, f"fields.{of}.{n // N_LAYERS}.{n % N_LAYERS}.{epoch}").random(3) * N_LATTICE).tolist()


@lru_cache(maxsize=4)
def draw_vectors(seed: int) -> NDArray[np.float32]:
    """Return the random vectors of a seed, see `EddyLayers`."""
    numbers = stream(seed, "fields.eddies").standard_normal((N_LATTICE, N_LATTICE, N_LATTICE, 3), dtype=np.float32)
    return np.append(np.pad(numbers, [(0, 2)] * 3 + [(0, 0)], mode="wrap"), np.float32(0.0))
