"""The cells of a room as filaments meet them, and those of the same room with other doors closed."""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from gslcosim.environment.model import Cell, Closed, Environment


@dataclass(frozen=True, kw_only=True)
class RoomCells:
    """`occupancy` is (nx, ny, nz) uint8 of `Cell`; `is_open` says where all neighbours are free, see `open_cells`."""

    occupancy: NDArray[np.uint8]
    is_open: NDArray[np.uint8]

    @classmethod
    def by_doors(cls, environment: Environment) -> dict[Closed, Self]:
        """Return the cells at the start and with other doors closed; see `Environment.by_doors`."""
        found: dict[Closed, Self] = {}
        for closed, room in environment.by_doors().items():
            occupancy = np.ascontiguousarray(room.occupancy, np.uint8)
            found[closed] = cls(occupancy=occupancy, is_open=open_cells(occupancy))
        return found


def open_cells(occupancy: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return 1 where a cell and its 26 neighbours are free (the border of the grid counts as a wall), else 0."""
    is_free = np.pad(occupancy == Cell.FREE, 1, constant_values=False)
    for axis in range(3):
        ahead, behind = np.roll(is_free, 1, axis), np.roll(is_free, -1, axis)
        is_free = is_free & ahead & behind
    return np.ascontiguousarray(is_free[1:-1, 1:-1, 1:-1]).astype(np.uint8)
