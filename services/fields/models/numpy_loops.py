"""Numpy's own exponential and power in compiled kernels, so that both give the same bits on any processor.

Numpy picks its loops by the processor, and their last digit is not that of the C library, which compiled code calls.
"""

# ruff: noqa: ANN001, ANN201, ANN202 - kernels have no types, and symbols of equations
# pyright: basic

import ctypes

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from gslcosim.base.c_calls import call_address
from gslcosim.base.errors import ModelError

_INT64 = ir.IntType(64)


# The head of numpy's PyUFuncObject, which is part of its C interface.
class _Ufunc(ctypes.Structure):
    _fields_ = [
        ("head", ctypes.c_ssize_t * 2),
        ("counts", ctypes.c_int * 4),
        ("functions", ctypes.POINTER(ctypes.c_void_p)),
        ("data", ctypes.POINTER(ctypes.c_void_p)),
        ("ntypes", ctypes.c_int),
    ]


def find_loop_address(ufunc: np.ufunc) -> int:
    """Return the address of the loop that a function of numpy runs over doubles; kernels pass it on.

    Raises:
        ModelError: the function has no such loop.
    """
    of_doubles = [i for i, kinds in enumerate(ufunc.types) if set(kinds) == set("d->")]
    if not of_doubles:
        raise ModelError(f"{ufunc.__name__}: expected a loop over doubles, was {', '.join(ufunc.types)}.")
    address = _Ufunc.from_address(id(ufunc)).functions[of_doubles[0]]
    assert address is not None
    return int(address)


# Calls `void loop(char **args, npy_intp const *dimensions, npy_intp const *steps, void *data)` for one element.
def _call_loop(builder: ir.IRBuilder, address, values):
    n = len(values) + 1
    entry = builder.function.entry_basic_block
    with builder.goto_block(entry):
        places = builder.alloca(ir.DoubleType(), n)
        args = builder.alloca(_INT64, n)
        numbers = builder.alloca(_INT64, 1 + n)
    for i in range(n):
        place = _item(builder, places, ir.DoubleType(), i)
        if i < len(values):
            builder.store(values[i], place)
        builder.store(builder.ptrtoint(place, _INT64), _item(builder, args, _INT64, i))
        step = _item(builder, numbers, _INT64, 1 + i)
        builder.store(ir.Constant(_INT64, 8), step)
    builder.store(ir.Constant(_INT64, 1), numbers)
    function_type = ir.FunctionType(ir.VoidType(), [_INT64] * 4)
    steps = _item(builder, numbers, _INT64, 1)
    pointers = [builder.ptrtoint(pointer, _INT64) for pointer in (args, numbers, steps)]
    call_address(builder, address, function_type, [*pointers, ir.Constant(_INT64, 0)])
    return builder.load(_item(builder, places, ir.DoubleType(), n - 1), typ=ir.DoubleType())


def _item(builder: ir.IRBuilder, array: ir.Value, item_type: ir.Type, i: int) -> ir.Value:
    return builder.gep(array, [ir.Constant(ir.IntType(32), i)], source_etype=item_type)


@intrinsic
def call_unary_loop(typingctx, address, x):
    """Call a loop of numpy over doubles with one argument, such as that of `numpy.exp`, for one number.

    Args:
        typingctx: numba's.
        address: Of `find_loop_address`.
        x: The argument.

    Held by:
        tests/unit/services/fields/models/test_numpy_loops.py
    """
    signature = types.float64(types.intp, types.float64)

    def codegen(context, builder, _signature, arguments):
        return _call_loop(builder, arguments[0], arguments[1:])

    return signature, codegen


@intrinsic
def call_binary_loop(typingctx, address, x, y):
    """Call a loop of numpy over doubles with two arguments, such as that of `numpy.power`, for one pair of numbers.

    Args:
        typingctx: numba's.
        address: Of `find_loop_address`.
        x: The first argument.
        y: The second argument.

    Held by:
        tests/unit/services/fields/models/test_numpy_loops.py
    """
    signature = types.float64(types.intp, types.float64, types.float64)

    def codegen(context, builder, _signature, arguments):
        return _call_loop(builder, arguments[0], arguments[1:])

    return signature, codegen
