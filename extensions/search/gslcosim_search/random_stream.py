"""Random stream that any language can repeat."""

import math

import numpy as np

from gslcosim.base.rng import stream
from gslcosim_search import elementary

_MASK_64 = 0xFFFFFFFFFFFFFFFF
_FULL_TURN_RAD = 6.283185307179586


class RandomStream:
    """A stream of random numbers by SplitMix64, the same in every language from the same seed.

    Each number costs one step of the generator, a normal one two. Agents draw from this with the seed of their
    briefing and from nothing else.

    Source:
        Steele, Lea, Flood 2014, Fast splittable pseudorandom number generators, doi:10.1145/2660193.2660195.
    Held by:
        extensions/search/tests/unit/test_random_stream.py
    """

    def __init__(self, seed: int) -> None:
        """Begin a stream; `seed` is taken modulo 2^64."""
        self._seed = seed & _MASK_64
        self._state = self._seed

    def fraction(self) -> float:
        """Return the next number, uniform in [0, 1), a multiple of 2^-53."""
        self._state = (self._state + 0x9E3779B97F4A7C15) & _MASK_64
        z = self._state
        z = ((z ^ (z >> 30)) * 0xBF58476D1CE4E5B9) & _MASK_64
        z = ((z ^ (z >> 27)) * 0x94D049BB133111EB) & _MASK_64
        return ((z ^ (z >> 31)) >> 11) / 9007199254740992.0

    def uniform(self, low: float, high: float) -> float:
        """Return a number uniform in [low, high)."""
        return low + (high - low) * self.fraction()

    def angle_rad(self) -> float:
        """Return an angle uniform in [0, 2 pi) [rad]."""
        return _FULL_TURN_RAD * self.fraction()

    def index(self, n: int) -> int:
        """Return a whole number uniform in [0, n)."""
        return int(self.fraction() * n)

    def normal(self) -> float:
        """Return a number of the standard normal distribution: the cosine branch of Box and Muller.

        z = sqrt(-2 ln(1 - u1)) cos(2 pi u2)        u1, u2 the next two fractions
        """
        radius = math.sqrt(-2.0 * elementary.log1p(-self.fraction()))
        return radius * elementary.cos(self.angle_rad())

    def generator(self, purpose: str) -> np.random.Generator:
        """Return a numpy generator of its own, for many numbers at once.

        Args:
            purpose: Its name; equal seeds and names give equal numbers, other names independent ones.
        """
        return stream(self._seed, purpose)
