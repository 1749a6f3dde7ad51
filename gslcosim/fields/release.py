"""When filaments are born: a constant rate, exact over any time and independent of the step."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

# Filament number rate * t exists at t even when the product is rounded down by its last digit.
_ROUNDING = 1e-9


@dataclass(frozen=True, kw_only=True)
class ConstantRelease:
    """Filament number j = 1, 2, … is born at j / rate: exactly `rate * t` (rounded down) are born until t.

    Nothing is carried from step to step, so nothing can drift.
    """

    filaments_per_s: float

    def n_born_by(self, time_s: float) -> int:
        """Return how many filaments are born from 0 to a time [s]."""
        return int(self.filaments_per_s * time_s + _ROUNDING)

    def births_s(self, start_s: float, end_s: float) -> NDArray[np.float64]:
        """Return the times of birth [s] after `start_s` and up to `end_s`, ascending."""
        numbers = np.arange(self.n_born_by(start_s) + 1, self.n_born_by(end_s) + 1)
        return np.minimum(numbers / self.filaments_per_s, end_s)
