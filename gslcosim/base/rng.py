"""Named random streams: every draw of a run comes from one seed and a name."""

import math
from typing import Any

import numpy as np

from gslcosim.base.scalar_kernels import NORMAL_TAIL, tail_normal

# So few numbers are searched faster as a list.
_FEW = 16


class RandomStream(np.random.Generator):
    """A generator of numpy whose normal numbers have the same bits with every C library.

    One in 4,000 lies beyond `NORMAL_TAIL`, where numpy takes the C library's logarithm: those are drawn again.
    """

    def standard_normal(self, size: Any = None, dtype: Any = np.float64, out: Any = None) -> Any:
        """Return numbers of the standard normal distribution, with the arguments of `numpy.random.Generator`."""
        drawn: Any = super().standard_normal(size, dtype, out)
        if size is None and out is None:
            return drawn if -NORMAL_TAIL < drawn < NORMAL_TAIL else self._draw_tail(drawn)
        numbers = drawn.reshape(-1)
        limit = float(numbers.dtype.type(NORMAL_TAIL))
        if numbers.size > _FEW or max(map(abs, numbers.tolist()), default=0.0) >= limit:
            for i in np.flatnonzero(np.abs(numbers) >= limit):
                numbers[i] = self._draw_tail(numbers[i])
        return drawn

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
    return RandomStream(np.random.PCG64([seed, *name.encode()]))
