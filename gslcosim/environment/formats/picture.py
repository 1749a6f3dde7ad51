"""Picture of an environment from above: floor, solids by height, openings, sources, and the wind at a height."""

import io
import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from gslcosim.base.quantities import Vec3
from gslcosim.environment.model import Box, Cell, Environment, Opening

LONG_SIDE_PX, MARGIN_PX = 900, 40
ARROWS_PER_SIDE = 30
# Speeds above this percentile are drawn as long as it: jets at inlets would make all other arrows dots.
REFERENCE_PERCENTILE = 90

PAPER, FLOOR, EDGE = (24, 27, 33), (52, 57, 66), (120, 128, 140)
WIND, INLET, OUTLET, SOURCE = (150, 200, 255), (76, 160, 255), (205, 130, 255), (255, 72, 72)


def top_view_png(environment: Environment, *, sources_m: Sequence[Vec3] = (), height_m: float | None = None) -> bytes:
    """Return a PNG of an environment seen from above, x to the right and y up.

    Solids are the brighter the higher they reach; arrows are the wind at `height_m`, by default at the first source's
    height or at 2 m; blue and violet bars with arrows are inlets and outlets, red dots are sources.
    """
    if height_m is None:
        height_m = sources_m[0][2] if sources_m else 2.0
    view = _View(environment)
    for box in sorted(environment.boxes, key=lambda box: box.max_m[2]):
        # Lintels are left out, so that doors are seen.
        if box.kind == "obstacle" or (box.kind == "wall" and box.min_m[2] <= environment.grid.origin_m[2]):
            view.solid(box)
    view.outline()
    view.wind(height_m)
    for opening in environment.openings:
        view.opening(opening)
    for source_m in sources_m:
        view.source(source_m)
    file = io.BytesIO()
    view.image.save(file, format="PNG", compress_level=3)
    return file.getvalue()


class _View:
    """The picture that is being drawn; pixels from the upper left."""

    def __init__(self, environment: Environment) -> None:
        self._environment = environment
        self._low = np.array(environment.grid.origin_m[:2])
        size_m = np.array(environment.grid.max_m[:2]) - self._low
        self._scale = LONG_SIDE_PX / float(size_m.max())
        width, height = (math.ceil(side_m * self._scale) + 2 * MARGIN_PX for side_m in size_m)
        self.image = Image.new("RGB", (width, height), PAPER)
        self._draw = ImageDraw.Draw(self.image)
        self._rectangle(environment.grid.origin_m, environment.grid.max_m, fill=FLOOR)

    def solid(self, box: Box) -> None:
        low, high = self._environment.grid.origin_m, self._environment.grid.max_m
        min_m = tuple(max(a, b) for a, b in zip(box.min_m, low, strict=True))
        max_m = tuple(min(a, b) for a, b in zip(box.max_m, high, strict=True))
        if all(a < b for a, b in zip(min_m, max_m, strict=True)):
            share = 0.45 + 0.55 * (max_m[2] - low[2]) / (high[2] - low[2])
            red, green, blue = (round(255 * share * channel) for channel in box.rgba[:3])
            self._rectangle(min_m, max_m, fill=(red, green, blue))

    def outline(self) -> None:
        self._rectangle(self._environment.grid.origin_m, self._environment.grid.max_m, outline=EDGE)

    def wind(self, height_m: float) -> None:
        origins_m, vectors_m_s = _wind_at(self._environment, height_m)
        if not len(origins_m):
            return
        speeds_m_s = np.linalg.norm(vectors_m_s, axis=1)
        reference_m_s = float(np.percentile(speeds_m_s, REFERENCE_PERCENTILE))
        if reference_m_s <= 0:
            return
        lengths = LONG_SIDE_PX / ARROWS_PER_SIDE * np.minimum(speeds_m_s / reference_m_s, 1.2)
        for origin_m, vector_m_s, speed_m_s, length in zip(origins_m, vectors_m_s, speeds_m_s, lengths, strict=True):
            if length >= 2:
                self._arrow(self._pixel(origin_m), vector_m_s / speed_m_s, float(length), WIND)

    def opening(self, opening: Opening) -> None:
        is_inlet = opening.kind == "inlet"
        (x0, y0), (x1, y1) = self._pixel(opening.min_m), self._pixel(opening.max_m)
        if abs(x1 - x0) > 3 and abs(y1 - y0) > 3:
            return  # in the floor or the ceiling: from above it would cover everything
        color = INLET if is_inlet else OUTLET
        self._draw.line([(x0, y0), (x1, y1)], fill=color, width=7)
        towards = np.array(self.image.size) / 2 - ((x0 + x1) / 2, (y0 + y1) / 2)
        inward = np.array([np.sign(towards[0]), 0.0] if abs(x1 - x0) < 1 else [0.0, -np.sign(towards[1])])
        middle = ((x0 + x1) / 2, (y0 + y1) / 2)
        if opening.max_m[2] - opening.min_m[2] > self._environment.grid.cell_m * 1.5:
            self._arrow(middle, inward if is_inlet else -inward, 2 * MARGIN_PX * 0.8, color, width=4)

    def source(self, source_m: Vec3) -> None:
        self._draw.circle(self._pixel(source_m), 8, fill=SOURCE, outline=(255, 255, 255), width=2)

    # `direction` is a unit vector in the world's plane, y up; the arrow is centred on a pixel.
    def _arrow(
        self,
        centre: tuple[float, float],
        direction: NDArray[np.float64],
        length: float,
        color: tuple[int, int, int],
        width: int = 1,
    ) -> None:
        along = np.array([direction[0], -direction[1]])
        across = np.array([-along[1], along[0]])
        tip, tail = centre + along * length / 2, centre - along * length / 2
        head = max(0.3 * length, 3.0)
        barbs = [tip - along * head + side * across * 0.45 * head for side in (1, -1)]
        self._draw.line([tuple(tail), tuple(tip)], fill=color, width=width)
        self._draw.polygon([tuple(tip), *(tuple(barb) for barb in barbs)], fill=color)

    def _pixel(self, point_m: Sequence[float] | NDArray[np.float64]) -> tuple[float, float]:
        x, y = (np.asarray(point_m)[:2] - self._low) * self._scale
        return MARGIN_PX + float(x), self.image.size[1] - MARGIN_PX - float(y)

    def _rectangle(
        self,
        min_m: Sequence[float],
        max_m: Sequence[float],
        fill: tuple[int, int, int] | None = None,
        outline: tuple[int, int, int] | None = None,
    ) -> None:
        (x0, y1), (x1, y0) = self._pixel(min_m), self._pixel(max_m)
        self._draw.rectangle([x0, y0, x1, y1], fill=fill, outline=outline, width=2)


# Where arrows stand and the wind there, of the first frame in the layer of cells at a height: (n, 2) and (n, 2).
def _wind_at(environment: Environment, height_m: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    grid = environment.grid
    layer = min(max(int((height_m - grid.origin_m[2]) / grid.cell_m), 0), grid.shape[2] - 1)
    stride = max(1, round(max(grid.shape[:2]) / ARROWS_PER_SIDE))
    cells = np.argwhere(environment.occupancy[stride // 2 :: stride, stride // 2 :: stride, layer] != Cell.SOLID)
    cells = cells * stride + stride // 2
    origins_m = np.array(grid.origin_m[:2], dtype=np.float64) + (cells + 0.5) * grid.cell_m
    wind_m_s = environment.wind.velocity_m_s[0, cells[:, 0], cells[:, 1], layer, :2].astype(np.float64)
    return origins_m, wind_m_s
