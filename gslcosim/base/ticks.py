"""Simulated time: whole ticks, seconds derived from them and never accumulated."""

from gslcosim.base.errors import GslCosimError
from gslcosim.base.scalar_kernels import scalar_kernel

NS_PER_S = 1_000_000_000


@scalar_kernel
def seconds_from_ticks(tick: int, tick_ns: int) -> float:
    """Return the simulated time [s] at the end of a tick."""
    return tick * tick_ns / NS_PER_S


def ticks_from_seconds(duration_s: float, tick_ns: int) -> int:
    """Return the number of whole ticks in a duration, rounded to the nearest tick."""
    return round(duration_s * NS_PER_S / tick_ns)


def exact_ticks_from_seconds(duration_s: float, tick_ns: int, *, name: str) -> int:
    """Return the number of ticks in a duration; refuse one that is not a whole, positive number of them."""
    n_ticks = ticks_from_seconds(duration_s, tick_ns)
    if n_ticks < 1 or abs(n_ticks * tick_ns - duration_s * NS_PER_S) > 0.5:
        below = max(1, int(duration_s * NS_PER_S // tick_ns))
        raise GslCosimError(
            f"{name}: expected a whole number of {tick_ns / 1e6:g} ms ticks, was {duration_s:g} s. "
            f"Nearest: {seconds_from_ticks(below, tick_ns):g} s or {seconds_from_ticks(below + 1, tick_ns):g} s."
        )
    return n_ticks
