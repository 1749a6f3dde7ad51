"""Numbers that look drawn and are not: the same observation gives the same ones, in flight and in a batch."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gslcosim.search.learned.policies.policy import ActionSettings, Floats, PolicyError, checked_number

_STEP = np.uint64(0x9E3779B97F4A7C15)
_FIRST, _SECOND = np.uint64(0xBF58476D1CE4E5B9), np.uint64(0x94D049BB133111EB)
_30, _27, _31, _11 = (np.uint64(n) for n in (30, 27, 31, 11))


def normal_numbers(observations: Floats, n: int) -> NDArray[np.float32]:
    """Return n numbers for each observation (rows, k), as if drawn from the standard normal distribution, (rows, n).

    A policy that was trained with noise leaves by it what the mean of the policy circles in. Sensors are noisy, so
    that the last bits of an observation are as good as a stream of chance, and a policy needs none of its own: what
    flies is a function of what it sees.

    z = sqrt(-2 ln u) cos(2 pi v), u and v from the bits of the observation and the number's index by SplitMix64

    Source:
        Box and Muller 1958; Steele, Lea and Flood 2014, doi:10.1145/2660193.2660195.
    Held by:
        tests/unit/search/learned/policies/test_scatter.py
    """
    shares = even_numbers(observations, 2 * n)
    lengths = np.sqrt(-2.0 * np.log1p(-shares[:, :n]))
    return (lengths * np.cos(2 * np.pi * shares[:, n:])).astype(np.float32)


def spread_out(outputs: Floats, observations: Floats, spread: float) -> Floats:
    """Return a network's outputs (rows, n) with numbers of standard deviation `spread` added; see `normal_numbers`."""
    return outputs + np.float32(spread) * normal_numbers(observations, outputs.shape[1]) if spread else outputs


def spread_of(settings: Mapping[str, Any], action: ActionSettings) -> float:
    """Return the spread that a policy's settings name, 0 where they name none.

    Raises:
        PolicyError: it is no number from 0, or the actions are choices.
    """
    spread = checked_number(settings, "spread", is_above=False, default=0.0)
    if spread and action.n_choices:
        raise PolicyError(f"settings.spread: expected 0 for action {action.kind}, which has choices, was {spread}.")
    return spread


def even_numbers(observations: Floats, n: int) -> NDArray[np.float64]:
    """Return n numbers for each observation (rows, k), as if drawn evenly from 0 to below 1, (rows, n).

    Source and test: as `normal_numbers`.
    """
    bits = np.ascontiguousarray(observations, np.float32).view(np.uint32).astype(np.uint64)
    mixed = np.zeros(len(bits), np.uint64)
    with np.errstate(over="ignore"):
        for i in range(bits.shape[1]):
            mixed = _scrambled(mixed ^ bits[:, i])
        counted = mixed[:, None] + _STEP * np.arange(1, n + 1, dtype=np.uint64)
        return (_scrambled(counted) >> _11).astype(np.float64) * 2.0**-53


def _scrambled(z: NDArray[np.uint64]) -> NDArray[np.uint64]:
    z = z + _STEP
    z = (z ^ (z >> _30)) * _FIRST
    z = (z ^ (z >> _27)) * _SECOND
    return z ^ (z >> _31)
