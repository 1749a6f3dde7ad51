"""Named random streams: every draw of a run comes from one seed and a name."""

import math
from typing import Any

import numpy as np

from gslcosim.base.scalar_kernels import NORMAL_TAIL, tail_normal

# So few numbers are drawn faster one by one than searched for tails.
_FEW = 8


class RandomStream(np.random.Generator):
    """A generator of numpy whose normal numbers have the same bits with every C library.

    One in 4,000 lies beyond `NORMAL_TAIL`, where numpy takes the C library's logarithm: those are drawn again. An array
    holds what as many single draws would give.
    """

    def standard_normal(self, size: Any = None, dtype: Any = np.float64) -> Any:  # type: ignore[override]
        """Return numbers of the standard normal distribution, with arguments as in `numpy.random.Generator`."""
        if size is None:
            drawn: Any = super().standard_normal(None, dtype)
            return drawn if -NORMAL_TAIL < drawn < NORMAL_TAIL else self._draw_tail(drawn)
        n = size if isinstance(size, int) else math.prod(size)
        if n > _FEW:
            state = self.bit_generator.state
            numbers: Any = super().standard_normal(size, dtype)
            if np.abs(numbers).max() < NORMAL_TAIL:
                return numbers
            # Tails are rare: most parts of what has one are drawn at once after all.
            self.bit_generator.state = state
            parts = [self.standard_normal(count, dtype) for count in (n // 2, n - n // 2)]
            return np.concatenate(parts).reshape(size)
        return np.array([self.standard_normal(None, dtype) for _ in range(n)], dtype).reshape(size)

    def _draw_tail(self, drawn: float) -> float:
        while not (beyond := tail_normal(self.random(), self.random())):
            pass
        return math.copysign(beyond, drawn)


def stream(seed: int, name: str) -> RandomStream:
    """Return the random stream of one purpose, independent of all others and of their order of use.

    Args:
        seed: The scenario's seed, >= 0.
        name: `participant.purpose`, for example `fields.release`.
    """
    # The words that numpy makes of a list of whole numbers, made in less time.
    words = [seed >> shift & 0xFFFFFFFF for shift in range(0, max(seed.bit_length(), 1), 32)]
    return RandomStream(np.random.PCG64(np.array([*words, *name.encode()], np.uint32)))
