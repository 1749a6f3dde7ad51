"""A loop of plain Python whose time says how fast a machine is, so that figures of different machines compare."""

import time

_N = 200_000


def reference_loop_s() -> float:
    """Return how long the loop takes now, by the clock [s]: about 0.02 s on a machine of 2023."""
    began = time.perf_counter()
    total = 0
    for i in range(_N):
        total += i * i & 0xFF
    assert total > 0, "the loop is not optimised away"
    return time.perf_counter() - began
