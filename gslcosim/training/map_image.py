"""Map image of an environment: obstacles, the path so far, the vehicle and the source."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from gslcosim.base.quantities import Vec3
from gslcosim.environment.model import Cell, Environment

LONG_SIDE_PX = 480
_AIR, _SOLID = (255, 255, 255), (120, 120, 125)
_PATH, _VEHICLE, _SOURCE = (0, 114, 178), (213, 94, 0), (0, 158, 115)
_DOT_PX = 6


@dataclass
class MapImage:
    """Draws an agent over the plan of its room.

    Args:
        environment: The room.
        height_m: The height at which it is cut.
        sources_m: Where the sources are, world frame [m].
    """

    environment: Environment
    height_m: float
    sources_m: Sequence[Vec3]
    _path: list[tuple[float, float]] = field(default_factory=list[tuple[float, float]])

    def __post_init__(self) -> None:
        grid = self.environment.grid
        level = int(np.clip((self.height_m - grid.origin_m[2]) / grid.cell_m, 0, grid.shape[2] - 1))
        is_free = self.environment.occupancy[:, :, level] != Cell.SOLID
        self._scale = LONG_SIDE_PX / (max(grid.shape[:2]) * grid.cell_m)
        size = (round(grid.shape[0] * grid.cell_m * self._scale), round(grid.shape[1] * grid.cell_m * self._scale))
        cells = np.array([_SOLID, _AIR], np.uint8)[is_free.T[::-1].astype(np.int64)]
        self._plan = Image.fromarray(cells).resize(size, Image.Resampling.NEAREST)

    def move_to(self, position_m: Vec3) -> None:
        """Take note of where the agent is, world frame [m]."""
        self._path.append(self._pixel(position_m))

    def pixels(self) -> NDArray[np.uint8]:
        """Return the picture, (height, width, 3), y upwards as on a map."""
        picture = self._plan.copy()
        draw = ImageDraw.Draw(picture)
        for source_m in self.sources_m:
            _dot(draw, self._pixel(source_m), _SOURCE)
        if len(self._path) > 1:
            draw.line(self._path, fill=_PATH, width=2)
        if self._path:
            _dot(draw, self._path[-1], _VEHICLE)
        return np.asarray(picture)

    def _pixel(self, position_m: Vec3) -> tuple[float, float]:
        x_m, y_m = (position_m[axis] - self.environment.grid.origin_m[axis] for axis in (0, 1))
        return x_m * self._scale, self._plan.height - y_m * self._scale


def _dot(draw: ImageDraw.ImageDraw, place: tuple[float, float], colour: tuple[int, int, int]) -> None:
    x, y = place
    draw.ellipse((x - _DOT_PX, y - _DOT_PX, x + _DOT_PX, y + _DOT_PX), fill=colour)
