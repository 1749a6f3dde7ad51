"""PCG64 random numbers as numpy's generators draw them, to the last bit, with the state in a record.

A stream is four unsigned 64-bit numbers: the state of PCG64, high and low half, and its increment.
"""

# ruff: noqa: ANN001, ANN201, ANN202 - kernels have no types, and symbols of equations
# pyright: basic, reportCallIssue=false

import math

import numpy as np
from numba.np.random._constants import fi_double, ki_double, wi_double, ziggurat_nor_inv_r, ziggurat_nor_r

from gslcosim_training.batch.reference_free_kernels import reference_free_njit

_U = np.uint64
_LOW = _U(0xFFFFFFFF)
_32 = _U(32)
_16 = _U(16)
_MULTIPLIER_HIGH, _MULTIPLIER_LOW = _U(0x2360ED051FC65DA4), _U(0x4385DF649FCCF645)
_INIT_A, _MULT_A = _U(0x43B0D7E5), _U(0x931E8875)
_INIT_B, _MULT_B = _U(0x8B51F9DD), _U(0x58F38DED)
_MIX_LEFT, _MIX_RIGHT = _U(0xCA01F9DD), _U(0x4973F715)
_ONE, _ZERO = _U(1), _U(0)
_63, _58, _11, _8 = _U(63), _U(58), _U(11), _U(8)
_BYTE, _MANTISSA = _U(0xFF), _U(0x000FFFFFFFFFFFFF)
_TO_UNIT = 1.0 / 9007199254740992.0
_KI, _WI, _FI = np.asarray(ki_double), np.asarray(wi_double), np.asarray(fi_double)
_STIRLING = np.array(
    [
        8.333333333333333e-02, -2.777777777777778e-03, 7.936507936507937e-04, -5.952380952380952e-04,
        8.417508417508418e-04, -1.917526917526918e-03, 6.410256410256410e-03, -2.955065359477124e-02,
        1.796443723688307e-01, -1.39243221690590e00,
    ]
)  # fmt: skip
_TAIL, _TAIL_INVERSE = float(ziggurat_nor_r), float(ziggurat_nor_inv_r)


@reference_free_njit(inline="always")
def _high_of_product(a, b):
    a0, a1, b0, b1 = a & _LOW, a >> _32, b & _LOW, b >> _32
    middle = a1 * b0 + ((a0 * b0) >> _32)
    other = a0 * b1 + (middle & _LOW)
    return a1 * b1 + (middle >> _32) + (other >> _32)


@reference_free_njit(inline="always")
def _advance_inplace(stream):
    high, low = stream[0], stream[1]
    new_low = low * _MULTIPLIER_LOW
    new_high = _high_of_product(low, _MULTIPLIER_LOW) + high * _MULTIPLIER_LOW + low * _MULTIPLIER_HIGH
    total = new_low + stream[3]
    carry = _ONE if total < new_low else _ZERO
    stream[0] = new_high + stream[2] + carry
    stream[1] = total


@reference_free_njit()
def next_bits_inplace(stream):
    """Return the next 64 bits of a stream (PCG64, XSL RR output).

    Source:
        O'Neill 2014, PCG: A Family of Simple Fast Space-Efficient Statistically Good Algorithms for Random Number
        Generation; numpy's PCG64.
    Held by:
        extensions/training/tests/unit/batch/test_pcg64.py
    """
    _advance_inplace(stream)
    high, low = stream[0], stream[1]
    mixed, turn = high ^ low, high >> _58
    return (mixed >> turn) | (mixed << ((_U(64) - turn) & _63))


@reference_free_njit()
def next_uniform_inplace(stream):
    """Return the next number of `Generator.random`, in [0, 1)."""
    return np.float64(next_bits_inplace(stream) >> _11) * _TO_UNIT


@reference_free_njit()
def next_normal_inplace(stream):
    """Return the next number of `Generator.standard_normal`.

    Source:
        Marsaglia and Tsang 2000, The Ziggurat Method for Generating Random Variables, with numpy's tables.
    Held by:
        extensions/training/tests/unit/batch/test_pcg64.py
    """
    while True:
        bits = next_bits_inplace(stream)
        i = np.int64(bits & _BYTE)
        bits >>= _8
        is_negative = (bits & _ONE) == _ONE
        size = (bits >> _ONE) & _MANTISSA
        x = np.float64(size) * _WI[i]
        if is_negative:
            x = -x
        if size < _KI[i]:
            return x
        if i == 0:
            while True:
                far = -_TAIL_INVERSE * math.log1p(-next_uniform_inplace(stream))
                height = -math.log1p(-next_uniform_inplace(stream))
                if height + height > far * far:
                    return -(_TAIL + far) if (size >> _8) & _ONE == _ONE else _TAIL + far
        elif (_FI[i - 1] - _FI[i]) * next_uniform_inplace(stream) + _FI[i] < math.exp(-0.5 * x * x):
            return x


@reference_free_njit()
def next_poisson_inplace(stream, mean):
    """Return the next number of `Generator.poisson`.

    Source:
        Hormann 1993, The transformed rejection method for generating Poisson random variables (PTRS), from a mean of 10
        on; below, products of uniform numbers. Both as numpy has them.
    Held by:
        extensions/training/tests/unit/batch/test_pcg64.py
    """
    if mean == 0.0:
        return 0
    if mean < 10.0:
        least, product, n = math.exp(-mean), 1.0, 0
        while True:
            product *= next_uniform_inplace(stream)
            if product <= least:
                return n
            n += 1
    root, log_mean = math.sqrt(mean), math.log(mean)
    b = 0.931 + 2.53 * root
    a = -0.059 + 0.02483 * b
    inverse_alpha = 1.1239 + 1.1328 / (b - 3.4)
    v_r = 0.9277 - 3.6224 / (b - 2)
    while True:
        u = next_uniform_inplace(stream) - 0.5
        v = next_uniform_inplace(stream)
        u_s = 0.5 - abs(u)
        n = np.int64(math.floor((2 * a / u_s + b) * u + mean + 0.43))
        if u_s >= 0.07 and v <= v_r:
            return n
        if n < 0 or (u_s < 0.013 and v > u_s):
            continue
        level = math.log(v) + math.log(inverse_alpha) - math.log(a / (u_s * u_s) + b)
        if level <= -mean + n * log_mean - _log_gamma(n + 1.0):
            return n


# Of numpy: Zhang and Jin 1996, Computation of Special Functions.
@reference_free_njit()
def _log_gamma(x):
    if x == 1.0 or x == 2.0:
        return 0.0
    n = int(7 - x) if x < 7.0 else 0
    x0 = x + n
    x2 = (1.0 / x0) * (1.0 / x0)
    total = _STIRLING[9]
    for k in range(8, -1, -1):
        total *= x2
        total += _STIRLING[k]
    result = total / x0 + 0.5 * 1.8378770664093453e00 + (x0 - 0.5) * math.log(x0) - x0
    if x < 7.0:
        for _ in range(n):
            result -= math.log(x0 - 1.0)
            x0 -= 1.0
    return result


@reference_free_njit(inline="always")
def _hashed(value, constant):
    value ^= constant
    constant = (constant * _MULT_A) & _LOW
    value = (value * constant) & _LOW
    return value ^ (value >> _16), constant


@reference_free_njit(inline="always")
def _mixed(x, y):
    result = (((_MIX_LEFT * x) & _LOW) - ((_MIX_RIGHT * y) & _LOW)) & _LOW
    return result ^ (result >> _16)


@reference_free_njit()
def seed_inplace(stream, seed, name):
    """Begin the stream that `gslcosim.base.rng.stream(seed, name)` begins.

    Args:
        stream: (4,) uint64, written.
        seed: Below 2^32.
        name: (n,) uint8, the bytes of the name.

    Source:
        numpy's SeedSequence, after O'Neill 2015, C++ seeding surprises; and its PCG64.
    Held by:
        extensions/training/tests/unit/batch/test_pcg64.py
    """
    n = len(name) + 1
    pool = (
        _ZERO, _ZERO, _ZERO, _ZERO,
    )  # fmt: skip
    p0, p1, p2, p3 = pool
    constant = _INIT_A
    p0, constant = _hashed(_U(seed), constant)
    p1, constant = _hashed(_U(name[0]) if n > 1 else _ZERO, constant)
    p2, constant = _hashed(_U(name[1]) if n > 2 else _ZERO, constant)
    p3, constant = _hashed(_U(name[2]) if n > 3 else _ZERO, constant)
    for source in range(4):
        for target in range(4):
            if source == target:
                continue
            value = p0 if source == 0 else (p1 if source == 1 else (p2 if source == 2 else p3))
            value, constant = _hashed(value, constant)
            if target == 0:
                p0 = _mixed(p0, value)
            elif target == 1:
                p1 = _mixed(p1, value)
            elif target == 2:
                p2 = _mixed(p2, value)
            else:
                p3 = _mixed(p3, value)
    for k in range(3, n - 1):
        value, constant = _hashed(_U(name[k]), constant)
        p0 = _mixed(p0, value)
        value, constant = _hashed(_U(name[k]), constant)
        p1 = _mixed(p1, value)
        value, constant = _hashed(_U(name[k]), constant)
        p2 = _mixed(p2, value)
        value, constant = _hashed(_U(name[k]), constant)
        p3 = _mixed(p3, value)
    constant = _INIT_B
    w0, constant = _describe(p0, constant)
    w1, constant = _describe(p1, constant)
    w2, constant = _describe(p2, constant)
    w3, constant = _describe(p3, constant)
    w4, constant = _describe(p0, constant)
    w5, constant = _describe(p1, constant)
    w6, constant = _describe(p2, constant)
    w7, constant = _describe(p3, constant)
    state_high, state_low = w0 | (w1 << _32), w2 | (w3 << _32)
    sequence_high, sequence_low = w4 | (w5 << _32), w6 | (w7 << _32)
    stream[2] = (sequence_high << _ONE) | (sequence_low >> _63)
    stream[3] = (sequence_low << _ONE) | _ONE
    stream[0] = _ZERO
    stream[1] = _ZERO
    _advance_inplace(stream)
    total = stream[1] + state_low
    carry = _ONE if total < state_low else _ZERO
    stream[0] = stream[0] + state_high + carry
    stream[1] = total
    _advance_inplace(stream)


@reference_free_njit(inline="always")
def _describe(value, constant):
    value ^= constant
    constant = (constant * _MULT_B) & _LOW
    value = (value * constant) & _LOW
    return value ^ (value >> _16), constant


@reference_free_njit()
def scrambled(seed, i_search, n_begun):
    """Return 64 random bits that follow from three whole numbers alone: what a search draws at its reset.

    Source:
        Steele, Lea and Flood 2014, Fast splittable pseudorandom number generators (SplitMix64), three rounds.
    Held by:
        extensions/training/tests/unit/batch/test_pcg64.py
    """
    bits = _finished(_U(seed) + _U(0x9E3779B97F4A7C15))
    bits = _finished(bits + (_U(i_search) + _ONE) * _U(0x9E3779B97F4A7C15))
    return _finished(bits + (_U(n_begun) + _ONE) * _U(0x9E3779B97F4A7C15))


@reference_free_njit(inline="always")
def _finished(bits):
    bits = (bits ^ (bits >> _U(30))) * _U(0xBF58476D1CE4E5B9)
    bits = (bits ^ (bits >> _U(27))) * _U(0x94D049BB133111EB)
    return bits ^ (bits >> _U(31))
