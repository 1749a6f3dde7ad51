"""Calls of C functions by their address in compiled kernels."""
# pyright: basic

from typing import Any

from llvmlite import ir


class _FunctionAt:
    # Opaque pointers have no type of their target; llvmlite reads the called function's type from here.
    def __init__(self, pointer: Any, function_type: ir.FunctionType) -> None:
        self.type = pointer.type
        self.function_type = function_type
        self.get_reference = pointer.get_reference


def call_address(builder: ir.IRBuilder, address: Any, function_type: ir.FunctionType, arguments: list[Any]) -> Any:
    """Emit the call of the C function at an address; return its result.

    Args:
        builder: llvmlite's builder, positioned at the call.
        address: Address of the function, an integer of pointer size.
        function_type: Type of the function.
        arguments: Values of the function's argument types.

    Held by:
        tests/unit/services/world/test_simulation_loop.py
        tests/unit/services/fields/models/test_numpy_loops.py
    """
    return builder.call(_FunctionAt(builder.inttoptr(address, ir.PointerType()), function_type), arguments)
