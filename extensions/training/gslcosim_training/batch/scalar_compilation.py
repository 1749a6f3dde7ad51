"""Compilation of scalar kernels for batches: as callees of other kernels, and behind addresses that records hold."""

# ruff: noqa: ANN001, ANN202 - kernels have no types, and symbols of equations
# pyright: basic, reportCallIssue=false

from collections.abc import Callable
from functools import cache
from typing import Any

import numba
import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic, overload
from numba.np.arrayobj import make_array

from gslcosim.base import scalar_kernels
from gslcosim_training.batch.free_space import array_at
from gslcosim_training.batch.random_streams import next_normal_inplace, next_poisson_inplace
from gslcosim_training.batch.reference_free_kernels import REFERENCE_FREE, register_scalar_kernels

_ADDRESS = types.intp
_ADVANCE = _ADDRESS(*(_ADDRESS,) * 10)
_ESTIMATE = _ADDRESS(*(_ADDRESS,) * 5)
_ENCODE = _ADDRESS(*(_ADDRESS,) * 4)
_OWN_PACKAGES = ("gslcosim.", "gslcosim_services.")


# Compiled, the streams of scalar kernels are these.
@overload(scalar_kernels.next_normal)
def _overload_next_normal(stream):
    return lambda stream: next_normal_inplace(stream)


@overload(scalar_kernels.next_poisson)
def _overload_next_poisson(stream, mean):
    return lambda stream, mean: next_poisson_inplace(stream, mean)


def find_advance_address(kernel: Callable[..., Any]) -> int:
    """Return the address at which compiled code calls a `SensorKernel.advance` with `call_kernel`.

    The arguments are address and length of parameters, state and mixing ratios, the address of wind and velocity, which
    stand one behind the other, that of the stream, and address and length of the values.

    Args:
        kernel: A scalar kernel; it is compiled, and stays as long as the process.
    """
    return _compile(kernel, _build_advance, _ADVANCE).address


def find_estimate_address(kernel: Callable[..., Any]) -> int:
    """Return the address at which compiled code calls a `KernelEstimator.estimate`; see `find_advance_address`.

    The arguments are address and length of parameters and values, and the address where the estimate is written.
    """
    return _compile(kernel, _build_estimate, _ESTIMATE).address


def find_encode_address(kernel: Callable[..., Any]) -> int:
    """Return the address at which compiled code calls a channel's `encode`; see `find_advance_address`.

    The arguments are address and length of the values, and of the numbers that are written.
    """
    return _compile(kernel, _build_encode, _ENCODE).address


@cache
def _compile(kernel: Callable[..., Any], build: Callable[[Any], Any], signature: Any) -> Any:
    register_scalar_kernels()
    # A package of others can change without a change of ours, which would leave the old one in numba's cache.
    is_ours = kernel.__module__.startswith(_OWN_PACKAGES)
    return numba.cfunc(signature, cache=is_ours, **REFERENCE_FREE)(build(kernel))


def _build_advance(kernel):
    def advance(parameters, n_parameters, state, n_state, ppm, n_gases, air, stream, values, n_values):
        is_saturated = kernel(
            array_at(parameters, n_parameters, np.float64), array_at(state, n_state, np.float64),
            array_at(ppm, n_gases, np.float64), array_at(air, 3, np.float64), array_at(air + 24, 3, np.float64),
            array_at(stream, 4, np.uint64), array_at(values, n_values, np.float64),
        )  # fmt: skip
        return 1 if is_saturated else 0

    return advance


def _build_estimate(kernel):
    def estimate(parameters, n_parameters, values, n_values, estimates):
        estimated = array_at(estimates, 1, np.float64)
        estimated[0] = kernel(array_at(parameters, n_parameters, np.float64), array_at(values, n_values, np.float64))
        return 0

    return estimate


def _build_encode(kernel):
    def encode(values, n_values, numbers, n_numbers):
        kernel(array_at(values, n_values, np.float64), array_at(numbers, n_numbers, np.float64))
        return 0

    return encode


@intrinsic
def address_of(typingctx: Any, array: Any) -> Any:
    """Return the address of the first number of an array."""
    signature = _ADDRESS(array)

    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        data = make_array(signature.args[0])(context, builder, arguments[0]).data
        return builder.ptrtoint(data, context.get_value_type(_ADDRESS))

    return signature, codegen


class _FunctionAt:
    # Opaque pointers have no type of their target; llvmlite reads the called function's type from here.
    def __init__(self, pointer: Any, function_type: ir.FunctionType) -> None:
        self.type = pointer.type
        self.function_type = function_type
        self.get_reference = pointer.get_reference


@intrinsic
def call_kernel(typingctx: Any, address: Any, given: Any) -> Any:
    """Call what is compiled at an address with a tuple of addresses and lengths; return its result."""
    signature = _ADDRESS(_ADDRESS, given)

    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        numbers = cgutils.unpack_tuple(builder, arguments[1])
        kinds = signature.args[1]
        converted = [context.cast(builder, n, kind, _ADDRESS) for n, kind in zip(numbers, kinds, strict=True)]
        integer = context.get_value_type(_ADDRESS)
        function_type = ir.FunctionType(integer, [integer] * len(converted))
        return builder.call(_FunctionAt(builder.inttoptr(arguments[0], ir.PointerType()), function_type), converted)

    return signature, codegen
