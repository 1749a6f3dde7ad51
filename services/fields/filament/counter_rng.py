# pyright: basic
# ruff: noqa: ANN001, ANN201, ANN202 - kernels have no types, and symbols of equations
"""Counter-based random numbers, normal and uniform, for batches of filaments: any draw can be computed alone."""

import math

import numba
import numpy as np

from gslcosim.base import elementary

# Each part of a step is a short loop over a batch, so that vector instructions do it for several filaments at once. A
# compiler uses them only if it can prove that a write does not change the next read. Therefore the numbers of a batch
# are in few flat arrays at constant distances: those of the x axis side by side, those of y a BATCH further and those
# of z another: x of filament p at p, y at Y + p, z at Z + p. A batch's numbers stay in the first cache.
BATCH = 128
Y = BATCH
Z = 2 * BATCH

# Rows of the float64 working memory, by their first place; those of three axes take three rows.
POSITION = 0  # where a filament is, in cells from the corner of the grid
NORMAL = 3 * BATCH  # standard normal numbers
MOVED = 6 * BATCH  # where a filament is after the step, world frame [m]
SIGMA = 9 * BATCH  # size after the step [m]
DT = 10 * BATCH  # how long a filament moves [s]
ETA = 11 * BATCH  # standard deviation of its random displacement per axis [m]
RISE = 12 * BATCH  # upward velocity relative to the air [m/s]
REACH = 13 * BATCH  # how far it may move along each axis without a look at walls [m]
FATE = 14 * BATCH  # one of the fates below
N_WORK = 15 * BATCH

FREE = 0.0
BOUNDED = 1.0
LEFT = 2.0


N_LAYERS = 256
TAIL_START = 3.6541528853610088
_LAYER_AREA = 0.00492867323399

_GOLDEN = np.uint64(0x9E3779B97F4A7C15)
_MIX_1 = np.uint64(0xBF58476D1CE4E5B9)
_MIX_2 = np.uint64(0x94D049BB133111EB)
_THREE_GOLDEN = np.uint64(3 * 0x9E3779B97F4A7C15 % 2**64)
_S30, _S27, _S31 = np.uint64(30), np.uint64(27), np.uint64(31)
_LAYER_MASK = np.uint64(N_LAYERS - 1)
_UNIT_52 = 2.0**-52
_UNIT_53 = 2.0**-53


def _layers():
    # Right edges of the ziggurat's layers, from the base (whose width stands for its tail) up to the tip at zero.
    edge = np.zeros(N_LAYERS + 1)
    density = elementary.exp(-0.5 * TAIL_START * TAIL_START)
    edge[0] = _LAYER_AREA / density
    edge[1] = TAIL_START
    for i in range(2, N_LAYERS):
        density += _LAYER_AREA / edge[i - 1]
        edge[i] = math.sqrt(-2.0 * elementary.log(density))
    return edge


_EDGE = _layers()
_INNER_FRAC = _EDGE[1:] / _EDGE[:-1]
_DENSITY = elementary.exp_each(-0.5 * (_EDGE * _EDGE))


@numba.njit(cache=True, nogil=True)
def mix_bits(state):
    """Scramble 64 bits so that neighbouring inputs give unrelated outputs (the output function of SplitMix64).

    Args:
        state: Any 64 bits, uint64.

    Returns:
        64 bits, uint64; a bijection of the input.

    Source:
        Steele, Lea and Flood 2014, Fast splittable pseudorandom number generators, doi:10.1145/2660193.2660195,
        with the constants of Stafford's variant 13.
    Held by:
        tests/unit/services/fields/filament/test_counter_rng.py (published outputs of SplitMix64)
    """
    z = (state ^ (state >> _S30)) * _MIX_1
    z = (z ^ (z >> _S27)) * _MIX_2
    return z ^ (z >> _S31)


@numba.njit(cache=True, nogil=True)
def derive_step_key(key, step):
    """Return the key of one step's draws, unrelated to those of all other steps.

    Args:
        key: 64 bits of the stream, uint64.
        step: Number of the step, >= 0.
    """
    return mix_bits(key ^ mix_bits(np.uint64(step) * _GOLDEN + _GOLDEN))


@numba.njit(cache=True, nogil=True)
def _uniform(bits):
    # In (0, 1]: a logarithm of it is finite.
    return (float(bits >> np.uint64(11)) + 1.0) * _UNIT_53


@numba.njit(cache=True, nogil=True)
def _symmetric(bits):
    # In [-1, 1), from other bits than the layer's.
    return float(np.int64(bits) >> np.int64(11)) * _UNIT_52


@numba.njit(cache=True, nogil=True)
def _normal_outside_core(bits, layer, u):
    # The 1.2 % of draws that fall outside a layer's inner part; further bits are a chain from the first ones.
    while True:
        x = u * _EDGE[layer]
        if layer == 0:
            while True:
                bits = mix_bits(bits + _GOLDEN)
                tail = -elementary.log(_uniform(bits)) / TAIL_START
                bits = mix_bits(bits + _GOLDEN)
                if -2.0 * elementary.log(_uniform(bits)) > tail * tail:
                    return TAIL_START + tail if u > 0.0 else -TAIL_START - tail
        bits = mix_bits(bits + _GOLDEN)
        height = _DENSITY[layer] + _uniform(bits) * (_DENSITY[layer + 1] - _DENSITY[layer])
        if height < elementary.exp(-0.5 * x * x):
            return x
        bits = mix_bits(bits + _GOLDEN)
        layer = np.int64(bits & _LAYER_MASK)
        u = _symmetric(bits)
        if abs(u) < _INNER_FRAC[layer]:
            return u * _EDGE[layer]


@numba.njit(cache=True, nogil=True)
def normal_at(key, counter):
    """Return draw number `counter` of the standard normal stream `key`, by the ziggurat method with 256 layers.

    Args:
        key: 64 bits of the stream (see `derive_step_key`), uint64.
        counter: Which draw, uint64.

    Returns:
        A standard normal number, float64.

    Source:
        Marsaglia and Tsang 2000, The ziggurat method for generating random variables, doi:10.18637/jss.v005.i08,
        in Doornik's form (2005), which takes layer and abscissa from different bits.
    Deviation:
        The bits come from a counter and not from a sequential generator.
    Held by:
        tests/unit/services/fields/filament/test_counter_rng.py (distribution, moments, tail, independence of
        neighbours)
    """
    bits = mix_bits(key + counter * _GOLDEN)
    layer = np.int64(bits & _LAYER_MASK)
    u = _symmetric(bits)
    if abs(u) < _INNER_FRAC[layer]:
        return u * _EDGE[layer]
    return _normal_outside_core(bits, layer, u)


@numba.njit(cache=True, nogil=True)
def _draw_bits(key, filament_id, bits, u):
    for p in range(filament_id.size):
        first = key + np.uint64(filament_id[p]) * _THREE_GOLDEN
        second = first + _GOLDEN
        x, y, z = mix_bits(first), mix_bits(second), mix_bits(second + _GOLDEN)
        bits[p], bits[Y + p], bits[Z + p] = x, y, z
        u[p], u[Y + p], u[Z + p] = _symmetric(x), _symmetric(y), _symmetric(z)


@numba.njit(cache=True, nogil=True)
def _scale_inplace(u, bits, n, outside):
    # Scales all as if they were in the inner parts of their layers, and lists those that are not: a call within the
    # loop would keep all others waiting.
    n_outside = 0
    for first in (0, Y, Z):
        for p in range(np.uint64(first), np.uint64(first + n)):
            layer = bits[p] & _LAYER_MASK
            if not abs(u[p]) < _INNER_FRAC[layer]:
                outside[n_outside] = p
                n_outside += 1
            u[p] *= _EDGE[layer]
    return n_outside


@numba.njit(cache=True, nogil=True)
def draw_filament_normals(key, filament_id, bits, outside, draws):
    """Draw for each filament of a batch the standard normal numbers 3 id, 3 id + 1 and 3 id + 2 of a stream.

    Args:
        key: 64 bits of the stream (see `derive_step_key`), uint64.
        filament_id: (n,) int64, n at most BATCH.
        bits: (3 BATCH,) uint64 working memory.
        outside: (3 BATCH,) int64 working memory.
        draws: (3 BATCH,) receives what `normal_at` returns, axis after axis.

    Held by:
        tests/unit/services/fields/filament/test_counter_rng.py (equals `normal_at`)
    """
    _draw_bits(key, filament_id, bits, draws)
    n_outside = _scale_inplace(draws, bits, filament_id.size, outside)
    for i in range(n_outside):
        p = outside[i]
        draws[p] = _normal_outside_core(bits[p], np.int64(bits[p] & _LAYER_MASK), _symmetric(bits[p]))


@numba.njit(cache=True, nogil=True)
def uniform_at(key, counter):
    """Return draw number `counter` of the uniform stream `key`, in (0, 1].

    Args:
        key: 64 bits of the stream, uint64.
        counter: Which draw, uint64.

    Held by:
        tests/unit/services/fields/filament/test_counter_rng.py
    """
    return _uniform(mix_bits(key + counter * _GOLDEN))


@numba.njit(cache=True, nogil=True)
def draw_uniforms(key, first, n):
    """Return draws `first` to `first + n - 1` of the uniform stream `key`, (n,) float64 in (0, 1].

    Held by:
        tests/unit/services/fields/filament/test_counter_rng.py
    """
    draws = np.empty(n)
    for i in range(n):
        draws[i] = uniform_at(key, np.uint64(first + i))
    return draws
