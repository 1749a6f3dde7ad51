"""What every core knows of the room: geometry, occupancy and wind, read-only."""

from dataclasses import dataclass
from enum import IntEnum
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from gslcosim.environment.grid import Grid, Vec3


class Cell(IntEnum):
    """What a cell of the occupancy grid holds; the numbers are GADEN's."""

    FREE = 0
    SOLID = 1
    OUTLET = 2


@dataclass(frozen=True, kw_only=True)
class Box:
    """A named solid, axis-aligned box, corners in the world frame [m]."""

    name: str
    kind: Literal["wall", "floor", "ceiling", "obstacle"]
    min_m: Vec3
    max_m: Vec3
    rgba: tuple[float, float, float, float] = (0.6, 0.6, 0.62, 1.0)


@dataclass(frozen=True, kw_only=True)
class Opening:
    """An inlet, an outlet, or a side where the outdoors go on: a flat box on the boundary of the air, world frame [m].

    `velocity_m_s` is the inlet's; zero for the others.
    """

    name: str
    kind: Literal["inlet", "outlet", "open"]
    min_m: Vec3
    max_m: Vec3
    velocity_m_s: Vec3 = (0.0, 0.0, 0.0)


@dataclass(frozen=True, kw_only=True)
class Light:
    """A lamp that shines down, for pictures and cameras; world frame [m]."""

    name: str
    position_m: Vec3


@dataclass(frozen=True, kw_only=True)
class WindFrames:
    """Wind at cell centres of the environment's grid over time.

    `velocity_m_s` is (t, nx, ny, nz, 3) float32, world frame; one frame means steady wind.
    Frame i holds from i * period_s on; after the last frame time loops, unless `is_looping` is false: then it stays.
    """

    velocity_m_s: NDArray[np.float32]
    period_s: float = 1.0
    is_looping: bool = True

    def frame_at(self, time_s: float) -> int:
        """Return the index of the frame that holds at a time [s]."""
        n_frames = self.velocity_m_s.shape[0]
        index = int(time_s / self.period_s + 1e-9)
        return index % n_frames if self.is_looping else min(index, n_frames - 1)


@dataclass(frozen=True, kw_only=True)
class Environment:
    """A room with its wind. The grid covers the air exactly; walls lie outside it unless an importer says otherwise.

    `occupancy` is (nx, ny, nz) uint8 of `Cell`; OUTLET marks free cells that touch an outlet.
    `content_hash` identifies everything in here.
    """

    name: str
    grid: Grid
    occupancy: NDArray[np.uint8]
    wind: WindFrames
    boxes: tuple[Box, ...]
    openings: tuple[Opening, ...]
    content_hash: str
    lights: tuple[Light, ...] = ()
