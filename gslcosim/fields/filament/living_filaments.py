"""Room for a number of filaments, a row each."""

import numpy as np
from numpy.typing import NDArray


class LivingFilaments:
    """Places, sizes, births and sources of filaments; the first n rows are in use."""

    def __init__(self, capacity: int) -> None:
        self.capacity = capacity
        self.position_m = np.zeros((capacity, 3))
        self.sigma_m = np.zeros(capacity)
        self.birth_steps = np.zeros(capacity)
        self.filament_id = np.zeros(capacity, np.int64)
        self.source_index = np.zeros(capacity, np.int32)

    def keep(self, is_kept: NDArray[np.bool_]) -> int:
        """Keep some of the first n filaments, (n,), in their order, as the first rows; return how many."""
        kept = np.flatnonzero(is_kept)
        n = len(kept)
        for column in (self.position_m, self.sigma_m, self.birth_steps, self.filament_id, self.source_index):
            column[:n] = column[kept]
        return n

    def grown(self, capacity: int, n: int) -> "LivingFilaments":
        """Return a table with more room, and the same first n filaments."""
        table = LivingFilaments(capacity)
        table.position_m[:n] = self.position_m[:n]
        table.sigma_m[:n] = self.sigma_m[:n]
        table.birth_steps[:n] = self.birth_steps[:n]
        table.filament_id[:n] = self.filament_id[:n]
        table.source_index[:n] = self.source_index[:n]
        return table
