# pyright: basic
# ruff: noqa: ANN001, ANN201 - kernels have no types, and symbols of equations
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

N_LATTICE = 32
"""Nodes along each axis of the lattice of random numbers, a power of two; beyond them it repeats."""
N_LAYERS = 2
"""Patterns of an octave at any time."""
# Two more nodes along z spare the test for the end of a row.
_ROW = 3 * (N_LATTICE + 2)
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

_1, _2, _3, _4, _5, _6, _7, _8 = (np.uint64(i) for i in range(1, 9))
_HALF, _ONE, _TWO, _NONE = np.float32(0.5), np.float32(1.0), np.float32(2.0), np.float32(0.0)


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

    A pattern has a lattice of random vectors. `potential` holds those at the nodes of each of m patterns, float32 of
    (n n (n + 2) 3); `offset` (m, 3) is its origin [nodes], `drift_s` (m,) its time of drift with the mean wind since
    the middle of its life [s], `weight` (m,) its factor, `spacing_m` (m,) its nodes' distance [m].
    """

    potential: Any
    offset: Any
    drift_s: Any
    weight: Any
    spacing_m: Any


@numba.njit(cache=True, nogil=True)
def potential_at(p, px, py, pz):
    """Return the random vector potential of one lattice and its slopes at a place, by quadratic B-splines.

    Args:
        p: (n n (n + 2) 3) float32 numbers at nodes, n periodic along x and y, along z with the first two again.
        px, py, pz: Place in units of nodes.

    Returns:
        Twelve float32: the components x, y, z, then the slopes along x, y, z of x, of y and of z, per node.

    Held by:
        tests/unit/services/fields/turbulence/test_eddies.py (against splines of scipy, and differences)
    """
    fx, fy, fz = math.floor(px), math.floor(py), math.floor(pz)
    i, j, k = np.int64(fx), np.int64(fy), np.int64(fz)
    tx, ty, tz = np.float32(px - fx), np.float32(py - fy), np.float32(pz - fz)
    sx, sy, sz = _ONE - tx, _ONE - ty, _ONE - tz
    wx, dx = (_HALF * sx * sx, _HALF + tx * sx, _HALF * tx * tx), (-sx, _ONE - _TWO * tx, tx)
    wy, dy = (_HALF * sy * sy, _HALF + ty * sy, _HALF * ty * ty), (-sy, _ONE - _TWO * ty, ty)
    z0, z1, z2, d0, d1, d2 = _HALF * sz * sz, _HALF + tz * sz, _HALF * tz * tz, -sz, _ONE - _TWO * tz, tz
    vx = vy = vz = xx = xy = xz = yx = yy = yz = zx = zy = zz = _NONE
    column = (k & (N_LATTICE - 1)) * 3
    for a in range(3):
        plane = ((i + a) & (N_LATTICE - 1)) * N_LATTICE
        for b in range(3):
            q = np.uint64((plane + ((j + b) & (N_LATTICE - 1))) * _ROW + column)
            w, wdx, wdy = wx[a] * wy[b], dx[a] * wy[b], wx[a] * dy[b]
            n0, n1, n2 = p[q], p[q + _3], p[q + _6]
            along = z0 * n0 + z1 * n1 + z2 * n2
            vx, xx, xy, xz = vx + w * along, xx + wdx * along, xy + wdy * along, xz + w * (d0 * n0 + d1 * n1 + d2 * n2)
            n0, n1, n2 = p[q + _1], p[q + _4], p[q + _7]
            along = z0 * n0 + z1 * n1 + z2 * n2
            vy, yx, yy, yz = vy + w * along, yx + wdx * along, yy + wdy * along, yz + w * (d0 * n0 + d1 * n1 + d2 * n2)
            n0, n1, n2 = p[q + _2], p[q + _5], p[q + _8]
            along = z0 * n0 + z1 * n1 + z2 * n2
            vz, zx, zy, zz = vz + w * along, zx + wdx * along, zy + wdy * along, zz + w * (d0 * n0 + d1 * n1 + d2 * n2)
    return vx, vy, vz, xx, xy, xz, yx, yy, yz, zx, zy, zz


@numba.njit(cache=True, nogil=True)
def eddy_velocity(layers, x, y, z, wind, amplitude, amplitude_slope, shear_square, shear_square_slope):
    """Return the velocity of the large eddies at a point [m/s].

    u = curl(A c psi(q)),  q = (x - U(x) s) / h,  c = 1 / sqrt(1 + s^2 G / 3)
    [m/s] = [1/m] [m2/s]

    The derivatives of q, A and c are exact, so that div u = 0. Shear draws patterns out as they drift: the energy of
    curl(psi(q)) is 1 + s^2 G / 3 times that of an even wind, G the sum of the squared slopes of U, and c takes it back.

    Args:
        layers: `EddyLayers`.
        x, y, z: Point, world frame [m].
        wind: Twelve numbers, see `wind_with_slopes`: the mean wind U that carries them, smooth over their size.
        amplitude: Amplitude A of the potential there [m2/s]; zero at walls, so that no eddy blows through them.
        amplitude_slope: Its gradient [m/s], three numbers.
        shear_square: G there [1/s2].
        shear_square_slope: Its gradient [1/(m s2)], three numbers.

    Source:
        Bridson, Hourihan and Nordenstam 2007, Curl-noise for procedural fluid flow, doi:10.1145/1275808.1276435:
        the curl of a random potential that fades at walls. That patterns drift and fade, and c, are ours.
    Held by:
        tests/unit/services/fields/turbulence/test_eddies.py (variance, in shear too, no divergence, none through walls)
    """
    u, v, w, ux, uy, uz, vx, vy, vz, wx, wy, wz = wind
    gx, gy, gz = shear_square_slope
    sum_x = sum_y = sum_z = 0.0
    for n in range(layers.weight.size):
        per_m = 1.0 / layers.spacing_m[n]
        s, offset, share = layers.drift_s[n], layers.offset[n], layers.weight[n]
        third = s * s / 3.0
        kept_square = 1.0 / (1.0 + third * shear_square)
        kept = math.sqrt(kept_square)
        a, falls = kept * amplitude * per_m, 0.5 * amplitude * kept * kept_square * third
        ax, ay, az = (
            kept * amplitude_slope[0] - falls * gx, kept * amplitude_slope[1] - falls * gy,
            kept * amplitude_slope[2] - falls * gz,
        )  # fmt: skip
        qx, qy, qz = (x - s * u) * per_m + offset[0], (y - s * v) * per_m + offset[1], (z - s * w) * per_m + offset[2]
        px, py, pz, pxx, pxy, pxz, pyx, pyy, pyz, pzx, pzy, pzz = potential_at(layers.potential[n], qx, qy, qz)
        # Of component k along j: sum over m of its slope along q_m, times (delta_mj - s dU_m / dx_j).
        z_y = pzy - s * (pzx * uy + pzy * vy + pzz * wy)
        y_z = pyz - s * (pyx * uz + pyy * vz + pyz * wz)
        x_z = pxz - s * (pxx * uz + pxy * vz + pxz * wz)
        z_x = pzx - s * (pzx * ux + pzy * vx + pzz * wx)
        y_x = pyx - s * (pyx * ux + pyy * vx + pyz * wx)
        x_y = pxy - s * (pxx * uy + pxy * vy + pxz * wy)
        sum_x += share * (a * (z_y - y_z) + ay * pz - az * py)
        sum_y += share * (a * (x_z - z_x) + az * px - ax * pz)
        sum_z += share * (a * (y_x - x_y) + ax * py - ay * px)
    return sum_x, sum_y, sum_z


def potential_amplitude_m2_s(velocity_std_m_s: float, spacing_m: float) -> float:
    """Return the amplitude A of the potential from its curl's standard deviation along each axis [m2/s]."""
    return velocity_std_m_s * spacing_m / math.sqrt(_CURL_VARIANCE)


@dataclass(frozen=True, kw_only=True)
class EddyScales:
    """Scales of the large eddies: longitudinal integral length [m] and Lagrangian time scale [s]."""

    length_m: float
    time_s: float


class PatternAge(NamedTuple):
    """Age of one drifting pattern: its octave, layer and number, its drift since mid-life [s], and its fade, 0 to 1."""

    octave: int
    layer: int
    epoch: int
    drift_s: float
    fade: float


def list_pattern_ages(time_s: float, life_s: NDArray[np.floating]) -> list[PatternAge]:
    """Return the ages of the `N_LAYERS` patterns of each octave at a time >= 0 [s].

    A pattern grows in and fades out as a half sine over its life, and the next begins when the other is at its height.

    Args:
        time_s: The time.
        life_s: (n_octaves,) life of a pattern of each octave [s].
    """
    ages: list[PatternAge] = []
    for octave, octave_life_s in enumerate(life_s.tolist()):
        for layer in range(N_LAYERS):
            lives = time_s / octave_life_s + layer / N_LAYERS
            epoch = math.floor(lives)
            drift_s = (lives - epoch - 0.5) * octave_life_s
            ages.append(PatternAge(octave, layer, epoch, drift_s, elementary.sin(math.pi * (lives - epoch))))
    return ages


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
        self._factor = np.sqrt(energy) * np.ldexp(1.0, -octaves)
        self._life_s = LIFE_PER_TIME_SCALE * scales.time_s * elementary.pow_each(2.0, -2.0 * octaves / 3.0)
        self._spacing_m = np.repeat(largest_spacing_m(scales.length_m) * np.ldexp(1.0, -octaves), N_LAYERS)
        self._seed = seed

    def reset(self, seed: int) -> None:
        """Begin again with a seed."""
        self._seed = seed

    def at(self, time_s: float) -> EddyLayers:
        """Return the eddies at a time >= 0 [s]."""
        ages = list_pattern_ages(time_s, self._life_s)
        patterns = [draw_vectors(self._seed, age.octave, age.layer, age.epoch) for age in ages]
        return EddyLayers(
            tuple(vectors for _, vectors in patterns),
            np.array([offset for offset, _ in patterns]),
            np.array([age.drift_s for age in ages]),
            np.array([self._factor[age.octave] * age.fade for age in ages]),
            self._spacing_m,
        )


# Cached outside of the objects: plume and instruments use the same patterns, and no state holds them.
@lru_cache(maxsize=48)
def draw_vectors(seed: int, octave: int, layer: int, epoch: int) -> tuple[NDArray[np.float64], NDArray[np.float32]]:
    """Return a pattern of a seed: the origin of its lattice (3,) [nodes], and its vectors; see `EddyLayers`."""
    rng = stream(seed, f"fields.eddies.{octave}.{layer}.{epoch}")
    offset = rng.random(3) * N_LATTICE
    numbers = rng.standard_normal((N_LATTICE, N_LATTICE, N_LATTICE, 3), dtype=np.float32)
    return offset, np.concatenate([numbers, numbers[:, :, :2]], axis=2).reshape(-1)
