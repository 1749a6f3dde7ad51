"""Calling MuJoCo's C functions from compiled kernels, by address."""
# pyright: basic

import ctypes
from pathlib import Path

import mujoco
from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from gslcosim.c_call_kernels import call_address
from gslcosim.errors import ModelError


@intrinsic
def call_step(typingctx, function_address, model_address, data_address):
    """Call `void f(const mjModel*, mjData*)` at an address.

    The address is an argument, not a constant, so that compiled kernels can be kept in numba's cache.

    Args:
        typingctx: numba's.
        function_address: Address of the C function, from `step_address`.
        model_address: Address of the mjModel struct.
        data_address: Address of the mjData struct.

    Held by:
        tests/unit/world/physics/test_mujoco_kernels.py
    """
    signature = types.void(types.intp, types.intp, types.intp)

    def codegen(context, builder, _signature, arguments):
        address = context.get_value_type(types.intp)
        function_type = ir.FunctionType(ir.VoidType(), [address, address])
        call_address(builder, arguments[0], function_type, [arguments[1], arguments[2]])
        return context.get_dummy_value()

    return signature, codegen


def step_address() -> int:
    """Return the address of `mj_step` in the shared library that the Python package has loaded.

    Raises:
        ModelError: the package holds no MuJoCo library of a known name.
    """
    folder = Path(mujoco.__file__).parent
    for pattern in ("libmujoco.so*", "libmujoco*.dylib", "mujoco.dll"):
        for path in sorted(folder.glob(pattern)):
            address = ctypes.cast(ctypes.CDLL(str(path)).mj_step, ctypes.c_void_p).value
            if address:
                return address
    raise ModelError(f"mujoco {mujoco.__version__}: expected its shared library beside the package.\nFolder: {folder}")
