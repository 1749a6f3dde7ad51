# pyright: basic

"""First numbers of a named stream: where few are drawn, a generator of numpy costs more to make than to use."""

import numba
import numpy as np

_M, _16, _32 = np.uint64(0xFFFFFFFF), np.uint64(16), np.uint64(32)
_INIT_A, _MULT_A = np.uint64(0x43B0D7E5), np.uint64(0x931E8875)
_INIT_B, _MULT_B = np.uint64(0x8B51F9DD), np.uint64(0x58F38DED)
_LEFT, _RIGHT = np.uint64(0xCA01F9DD), np.uint64(0x4973F715)
_PCG_HIGH, _PCG_LOW = np.uint64(0x2360ED051FC65DA4), np.uint64(0x4385DF649FCCF645)


@numba.njit(cache=True, nogil=True, inline="always")
def _hash(value, factor, next_factor):
    mixed = ((value ^ factor) * next_factor) & _M
    return mixed ^ (mixed >> _16)


@numba.njit(cache=True, nogil=True)
def _step(high, low, more_high, more_low):
    # state * multiplier + increment, of 128 bits.
    a, b, c, d = low & _M, low >> _32, _PCG_LOW & _M, _PCG_LOW >> _32
    middle = ((a * c) >> _32) + ((a * d) & _M) + ((b * c) & _M)
    carried = b * d + ((a * d) >> _32) + ((b * c) >> _32) + (middle >> _32)
    product = low * _PCG_LOW
    total = product + more_low
    return carried + high * _PCG_LOW + low * _PCG_HIGH + more_high + np.uint64(total < product), total


@numba.njit(cache=True, nogil=True)
def draw_first_uniforms(words, n):
    """Return what `numpy.random.Generator(PCG64(words)).random(n)` does, (n,) in [0, 1).

    Args:
        words: (m,) uint32, m >= 4.
        n: How many numbers.

    Source:
        numpy's SeedSequence, after M. E. O'Neill 2015, Developing a seed_seq alternative; her PCG XSL RR 128/64, 2014.
    Held by:
        tests/unit/base/test_rng_kernels.py
    """
    pool, factor = np.empty(4, np.uint64), _INIT_A
    for i in range(8 + words.size - 4):
        word = np.uint64(words[i]) if i < 4 else (pool[i - 4] if i < 8 else np.uint64(words[i - 4]))
        for k in range(4):
            if (i < 4 and k != i) or k == i - 4:
                continue
            hashed, factor = _hash(word, factor, (factor * _MULT_A) & _M), (factor * _MULT_A) & _M
            if i >= 4:
                hashed = (_LEFT * pool[k] - _RIGHT * hashed) & _M
                hashed ^= hashed >> _16
            pool[k] = hashed
    state, factor = np.zeros(4, np.uint64), _INIT_B
    for i in range(8):
        state[i // 2] |= _hash(pool[i % 4], factor, (factor * _MULT_B) & _M) << np.uint64(i % 2 * 32)
        factor = (factor * _MULT_B) & _M
    one = np.uint64(1)
    more_high, more_low = (state[2] << one) | (state[3] >> np.uint64(63)), (state[3] << one) | one
    low = more_low + state[1]
    high, low = _step(more_high + state[0] + np.uint64(low < more_low), low, more_high, more_low)
    uniforms = np.empty(n)
    for i in range(n):
        high, low = _step(high, low, more_high, more_low)
        bits, turn = high ^ low, high >> np.uint64(58)
        bits = (bits >> turn) | (bits << ((np.uint64(64) - turn) & np.uint64(63)))
        uniforms[i] = np.float64(bits >> np.uint64(11)) * 2.0**-53
    return uniforms
