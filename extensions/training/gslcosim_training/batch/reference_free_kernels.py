"""Compilation of kernels that count no references to arrays, with a plain fallback."""
# pyright: basic

import os
from collections.abc import Callable
from typing import Any

import numba
from numba.core import cpu
from numba.extending import register_jitable

from gslcosim.base.scalar_kernels import list_scalar_kernels

# Tests set it, with a cache of their own: numba keeps kernels of both kinds under one name.
COUNTING_VARIABLE = "GSLCOSIM_COUNT_REFERENCES"
# The option is numba's own and not documented; a version without it counts.
COUNTS_REFERENCES = COUNTING_VARIABLE in os.environ or not hasattr(cpu.CPUTargetOptions, "_nrt")
REFERENCE_FREE: dict[str, Any] = {} if COUNTS_REFERENCES else {"_nrt": False}
_registered: set[Callable[..., Any]] = set()


def reference_free_njit(**options: Any) -> Any:
    """Compile a kernel as `numba.njit` does, into its cache and without the lock of Python, counting no references.

    Counting references to shared arrays took two fifths of a batch's time, and threads waited for each other at the
    counters. Such a kernel may make no arrays, and call only kernels that make none, scalar kernels among them. With
    counting it gives the same bits.

    Args:
        options: Further options of `numba.njit`.

    Held by:
        extensions/training/tests/integration/test_reference_free_kernels.py
    """
    register_scalar_kernels()
    return numba.njit(cache=True, nogil=True, **REFERENCE_FREE, **options)


def register_scalar_kernels() -> None:
    """Let compiled code call the scalar kernels that are imported so far, as any that is compiled from here does."""
    for kernel in list_scalar_kernels():
        if kernel not in _registered:
            _registered.add(kernel)
            register_jitable(kernel)
