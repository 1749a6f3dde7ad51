"""Random streams in compiled code: numpy's own C functions draw from a state of PCG64 in a record.

A stream is four unsigned 64-bit numbers as `pcg64_random_t` of numpy has them: state and increment, low half first.
"""

# ruff: noqa: ANN001, ANN002, ANN201, ANN202 - kernels have no types, and symbols of equations
# pyright: basic, reportCallIssue=false

import ctypes

import numpy as np
from llvmlite import binding, ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic
from numba.np.arrayobj import make_array
from numpy.random import _generator

from gslcosim.base.scalar_kernels import NORMAL_TAIL, tail_normal
from gslcosim_training.batch.reference_free_kernels import reference_free_njit

_INT32, _INT64, _DOUBLE, _POINTER = ir.IntType(32), ir.IntType(64), ir.DoubleType(), ir.PointerType()
_NEXT_BITS = "numpy_pcg64_next_uint64"
# The order of `bitgen_t`, whose `next_raw` PCG64 shares with `next_uint64`.
_NEXT = (_NEXT_BITS, "numpy_pcg64_next_uint32", "numpy_pcg64_next_double", _NEXT_BITS)
_U = np.uint64
_ONE, _ZERO, _11, _16, _32, _63 = _U(1), _U(0), _U(11), _U(16), _U(32), _U(63)
_PER_TWO_53 = 1.0 / 9007199254740992.0
_LOW = _U(0xFFFFFFFF)
_INIT_A, _MULTIPLIER_A = _U(0x43B0D7E5), _U(0x931E8875)
_INIT_B, _MULTIPLIER_B = _U(0x8B51F9DD), _U(0x58F38DED)
_MIX_LEFT, _MIX_RIGHT = _U(0xCA01F9DD), _U(0x4973F715)


def _add_symbols() -> None:
    # Under names, by which code from numba's cache finds them in each process.
    library, generator = ctypes.CDLL(_generator.__file__), np.random.PCG64(0).ctypes
    functions = {f"numpy_{name}": getattr(library, name) for name in ("random_standard_normal", "random_poisson")}
    functions |= {name: getattr(generator, name.removeprefix("numpy_pcg64_")) for name in _NEXT}
    for name, function in functions.items():
        binding.add_symbol(name, ctypes.cast(function, ctypes.c_void_p).value)


_add_symbols()


def _emit_call(context, builder, name, result_type, stream_type, stream, *arguments):
    # Calls a function of numpy with a generator on the stack. The state is copied there, since numpy counts on its
    # alignment, and word by word: reading a copy of all at once would wait for the words written last.
    data = make_array(stream_type)(context, builder, stream).data
    state = cgutils.alloca_once(builder, ir.ArrayType(_INT64, 4))
    state.align = 16
    words = [cgutils.gep_inbounds(builder, data, i) for i in range(4)]
    copies = [cgutils.gep_inbounds(builder, state, 0, i) for i in range(4)]
    for word, copied in zip(words, copies, strict=True):
        builder.store(builder.load(word), copied)
    # `pcg64_state`: where the state is, and half of a number that no distribution here draws.
    generator = cgutils.alloca_once_value(builder, cgutils.pack_struct(builder, (state, _INT32(0), _INT32(0))))
    if name != _NEXT_BITS:
        next_type = ir.FunctionType(_INT64, [_POINTER])
        functions = (cgutils.get_or_insert_function(builder.module, next_type, next_name) for next_name in _NEXT)
        generator = cgutils.alloca_once_value(builder, cgutils.pack_struct(builder, (generator, *functions)))
    function_type = ir.FunctionType(result_type, [_POINTER, *(argument.type for argument in arguments)])
    result = builder.call(cgutils.get_or_insert_function(builder.module, function_type, name), (generator, *arguments))
    for word, copied in zip(words[:2], copies[:2], strict=True):
        builder.store(builder.load(copied), word)
    return result


@intrinsic
def _next_bits_inplace(typingctx, stream):
    def codegen(context, builder, signature, arguments):
        return _emit_call(context, builder, _NEXT_BITS, _INT64, signature.args[0], *arguments)

    return types.uint64(stream), codegen


@reference_free_njit(inline="always")
def _next_uniform_inplace(stream):
    # PCG64's own `next_double`.
    return (_next_bits_inplace(stream) >> _11) * _PER_TWO_53


@intrinsic
def _next_of_numpy_inplace(typingctx, stream):
    def codegen(context, builder, signature, arguments):
        return _emit_call(context, builder, "numpy_random_standard_normal", _DOUBLE, signature.args[0], *arguments)

    return types.float64(stream), codegen


@reference_free_njit()
def next_normal_inplace(stream):
    """Return the next number of `gslcosim.base.rng.RandomStream.standard_normal`.

    Held by:
        extensions/training/tests/unit/batch/test_random_streams.py
    """
    drawn = _next_of_numpy_inplace(stream)
    if -NORMAL_TAIL < drawn < NORMAL_TAIL:
        return drawn
    beyond = 0.0
    while beyond == 0.0:
        beyond = tail_normal(_next_uniform_inplace(stream), _next_uniform_inplace(stream))
    return beyond if drawn > 0.0 else -beyond


@intrinsic
def next_poisson_inplace(typingctx, stream, mean):
    """Return the next number of `Generator.poisson`.

    Held by:
        extensions/training/tests/unit/batch/test_random_streams.py
    """

    def codegen(context, builder, signature, arguments):
        return _emit_call(context, builder, "numpy_random_poisson", _INT64, signature.args[0], *arguments)

    return types.int64(stream, types.float64), codegen


@reference_free_njit(inline="always")
def _hashed(value, constant, multiplier):
    value ^= constant
    constant = (constant * multiplier) & _LOW
    value = (value * constant) & _LOW
    return value ^ (value >> _16), constant


@reference_free_njit(inline="always")
def _mixed(x, y):
    result = (_MIX_LEFT * x - _MIX_RIGHT * y) & _LOW
    return result ^ (result >> _16)


@reference_free_njit(inline="always")
def _two_words(low, high, constant):
    low, constant = _hashed(low, constant, _MULTIPLIER_B)
    high, constant = _hashed(high, constant, _MULTIPLIER_B)
    return low | (high << _32), constant


@reference_free_njit()
def seed_inplace(stream, seed, name):
    """Begin the stream that `gslcosim.base.rng.stream(seed, name)` begins.

    numpy has no C function for it, and its Python takes as long as thirty ticks of a search.

    Args:
        stream: (4,) uint64, written.
        seed: Below 2^32.
        name: (n,) uint8, the bytes of the name.

    Source:
        numpy's SeedSequence, after O'Neill 2015, C++ seeding surprises; and its PCG64.
    Held by:
        extensions/training/tests/unit/batch/test_random_streams.py
    """
    # The pool of SeedSequence stands in the stream.
    constant = _INIT_A
    for i in range(4):
        word = _U(seed) if i == 0 else (_U(name[i - 1]) if i <= len(name) else _ZERO)
        stream[i], constant = _hashed(word, constant, _MULTIPLIER_A)
    for source in range(max(4, len(name) + 1)):
        for i in range(4):
            if i != source:
                word = stream[source] if source < 4 else _U(name[source - 1])
                value, constant = _hashed(word, constant, _MULTIPLIER_A)
                stream[i] = _mixed(stream[i], value)
    state_high, constant = _two_words(stream[0], stream[1], _INIT_B)
    state_low, constant = _two_words(stream[2], stream[3], constant)
    sequence_high, constant = _two_words(stream[0], stream[1], constant)
    sequence_low, constant = _two_words(stream[2], stream[3], constant)
    stream[0] = stream[1] = _ZERO
    stream[2], stream[3] = (sequence_low << _ONE) | _ONE, (sequence_high << _ONE) | (sequence_low >> _63)
    _next_bits_inplace(stream)
    stream[0] += state_low
    stream[1] += state_high + (_ONE if stream[0] < state_low else _ZERO)
    _next_bits_inplace(stream)
