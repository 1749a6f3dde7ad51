"""Pictures of a room from above: scale in pixels, painter of plan views, and picture in an environment's folder."""

import io
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from gslcosim.base.quantities import Vec3
from gslcosim.environment.model import Box, Environment
from gslcosim.environment.plan_view import PlanView, arrow_vectors, scale_of_arrows, space_arrows

Rgb = tuple[int, int, int]

LONG_SIDE_PX, MARGIN_PX = 900, 40
ARROWS_PER_SIDE = 30
_OPENING_PX, _FLOW_ARROW_PX = 7, 64
# Shorter arrows are invisible.
_MIN_ARROW_PX = 2.0

PAPER, FLOOR, EDGE = (24, 27, 33), (52, 57, 66), (120, 128, 140)
WIND, INLET, OUTLET, SOURCE = (150, 200, 255), (76, 160, 255), (205, 130, 255), (255, 72, 72)


@dataclass(frozen=True, kw_only=True)
class PixelScale:
    """Transform from the plan to a picture: x to the right and y up, while pixels count from the upper left.

    Attributes:
        size_px: Width and height of the picture.
        room_px: Width and height of the room in it.
        origin_px: Pixel of the room's lower left corner.
        origin_m: That corner, world frame [m].
        px_per_m: Pixels per metre.
    """

    size_px: tuple[int, int]
    room_px: tuple[int, int]
    origin_px: tuple[float, float]
    origin_m: tuple[float, float]
    px_per_m: float

    @classmethod
    def fit(cls, plan: PlanView, size_px: tuple[int, int], margin_px: int = 0) -> "PixelScale":
        """Return the scale at which a plan fills a picture within a margin, centred."""
        x0, x1, y0, y1 = plan.extent_m
        length_m, width_m = x1 - x0, y1 - y0
        px_per_m = min((size_px[0] - 2 * margin_px) / length_m, (size_px[1] - 2 * margin_px) / width_m)
        left, bottom = (size_px[0] - length_m * px_per_m) / 2, (size_px[1] + width_m * px_per_m) / 2
        return cls(
            size_px=size_px,
            room_px=(round(length_m * px_per_m), round(width_m * px_per_m)),
            origin_px=(left, bottom),
            origin_m=(x0, y0),
            px_per_m=px_per_m,
        )

    @classmethod
    def for_long_side(cls, plan: PlanView, long_side_px: int, margin_px: int = 0) -> "PixelScale":
        """Return the scale of a picture with a number of pixels along the room's longer side, and a margin around."""
        x0, x1, y0, y1 = plan.extent_m
        px_per_m = long_side_px / max(x1 - x0, y1 - y0)
        width, height = (round(side_m * px_per_m) + 2 * margin_px for side_m in (x1 - x0, y1 - y0))
        return cls.fit(plan, (width, height), margin_px)

    def pixel(self, place_m: Sequence[float] | NDArray[np.floating]) -> tuple[float, float]:
        """Return the pixel, right and down, of a place [m] in the room."""
        (left, bottom), (x0, y0) = self.origin_px, self.origin_m
        return left + (float(place_m[0]) - x0) * self.px_per_m, bottom - (float(place_m[1]) - y0) * self.px_per_m

    @property
    def corner_px(self) -> tuple[int, int]:
        """Upper left pixel of the room."""
        return round(self.origin_px[0]), round(self.origin_px[1] - self.room_px[1])


class PlanPainter:
    """Painter of a plan view: each call draws over the ones before.

    Args:
        plan: The plan.
        scale: Size of the picture, and place of the plan in it.
        paper: Colour around the room.
    """

    def __init__(self, plan: PlanView, scale: PixelScale, paper: Rgb) -> None:
        self.plan, self.scale, self._grid = plan, scale, plan.room.grid
        self.image = Image.new("RGB", scale.size_px, paper)
        self._draw = ImageDraw.Draw(self.image)

    def floor(self, color: Rgb) -> None:
        """Fill the room."""
        self.image.paste(color, self._room_box())

    def picture(self, rgb: NDArray[np.uint8]) -> None:
        """Fill the room with an (nx, ny, 3) picture of equal cells, smoothed."""
        pixels = Image.fromarray(np.ascontiguousarray(np.swapaxes(rgb, 0, 1)[::-1]))
        self.image.paste(pixels.resize(self.scale.room_px, Image.Resampling.BILINEAR), self.scale.corner_px)

    def cells(self, cells: NDArray[np.bool_], color: Rgb) -> None:
        """Fill some of the (nx, ny) cells."""
        if cells.any():
            mask = Image.fromarray((cells.T[::-1] * 255).astype(np.uint8))
            self.image.paste(color, self._room_box(), mask.resize(self.scale.room_px, Image.Resampling.NEAREST))

    def cell_outline(self, cells: NDArray[np.bool_], color: Rgb) -> None:
        """Draw the border of some of the (nx, ny) cells."""
        for line_m in self.plan.outline_m(cells):
            self._draw.line([self.scale.pixel(end_m) for end_m in line_m], fill=color)

    def box(self, box: Box) -> None:
        """Fill the part of a box inside the room with its colour, the brighter the higher its top."""
        low, high = self._grid.origin_m, self._grid.max_m
        min_m = tuple(max(a, b) for a, b in zip(box.min_m, low, strict=True))
        max_m = tuple(min(a, b) for a, b in zip(box.max_m, high, strict=True))
        if all(a < b for a, b in zip(min_m, max_m, strict=True)):
            share = 0.45 + 0.55 * (max_m[2] - low[2]) / (high[2] - low[2])
            red, green, blue = (round(255 * share * channel) for channel in box.rgba[:3])
            (x0, y1), (x1, y0) = self.scale.pixel(min_m), self.scale.pixel(max_m)
            self._draw.rectangle([x0, y0, x1, y1], fill=(red, green, blue))

    def outline(self, color: Rgb, width: int = 1) -> None:
        """Draw a line around the room."""
        x0, y0, x1, y1 = self._room_box()
        self._draw.rectangle([x0 - width, y0 - width, x1 + width - 1, y1 + width - 1], outline=color, width=width)

    def openings(self, inlet: Rgb, outlet: Rgb, *, width: int, flow_arrow_px: float = 0.0) -> None:
        """Draw openings at the sides as lines, and those in floor and ceiling as thin rectangles.

        Args:
            inlet: Colour of inlets.
            outlet: Colour of all others.
            width: Width of the lines [pixels].
            flow_arrow_px: Length of the arrows in the direction of the air [pixels]; 0: none.
        """
        for seen in self.plan.openings:
            color = inlet if seen.is_inlet else outlet
            path = [self.scale.pixel(place_m) for place_m in seen.path_m()]
            self._draw.line(path, fill=color, width=width if seen.is_at_side else 1)
            # A slit along the floor, or open sky along a whole side, has no room for an arrow.
            is_tall = seen.opening.max_m[2] - seen.opening.min_m[2] > self._grid.cell_m * 1.5
            if flow_arrow_px and seen.is_at_side and is_tall:
                middle = np.mean(path, axis=0)
                direction = np.array(seen.inward) if seen.is_inlet else -np.array(seen.inward)
                self._arrow(middle, direction * flow_arrow_px, color, width=4)

    def wind(self, velocity_m_s: NDArray[np.floating], color: Rgb, per_side: int) -> None:
        """Draw arrows along the wind, the longer the faster.

        Args:
            velocity_m_s: (nx, ny, nz, 3) wind, world frame [m/s].
            color: Colour of the arrows.
            per_side: Arrows along the longer side.
        """
        cells, spacing = space_arrows(~self.plan.solid, per_side)
        winds_m_s = velocity_m_s[cells[:, 0], cells[:, 1], self.plan.layer, :2].astype(np.float64)
        cell_m = self._grid.cell_m
        middles_m = np.array(self._grid.origin_m[:2]) + (cells + spacing / 2 - spacing // 2) * cell_m
        spacing_px = spacing * cell_m * self.scale.px_per_m
        scale = scale_of_arrows(np.linalg.norm(winds_m_s, axis=-1), spacing_px)
        for middle_m, vector in zip(middles_m, arrow_vectors(winds_m_s, spacing_px, scale), strict=True):
            if np.hypot(*vector) >= _MIN_ARROW_PX:
                self._arrow(np.array(self.scale.pixel(middle_m)), vector, color)

    def dot(self, place_m: Sequence[float], radius_px: int, **look: object) -> None:
        """Draw a circle around a place [m]; `look` has the keywords of Pillow's `circle`."""
        self._draw.circle(self.scale.pixel(place_m), radius_px, **look)  # pyright: ignore[reportArgumentType]

    # `vector` [pixels] has y up; the arrow is centred on a pixel.
    def _arrow(self, centre: NDArray[np.floating], vector: NDArray[np.floating], color: Rgb, width: int = 1) -> None:
        along = np.array([vector[0], -vector[1]])
        length = float(np.hypot(*along))
        along = along / length
        across = np.array([-along[1], along[0]])
        tip, tail = centre + along * length / 2, centre - along * length / 2
        head = max(0.22 * length, 3.0)
        barbs = [tip - along * head + side * across * 0.45 * head for side in (1, -1)]
        self._draw.line([tuple(tail), tuple(tip)], fill=color, width=width)
        self._draw.polygon([tuple(tip), *(tuple(barb) for barb in barbs)], fill=color)

    def _room_box(self) -> tuple[int, int, int, int]:
        (left, upper), (width, height) = self.scale.corner_px, self.scale.room_px
        return left, upper, left + width, upper + height


def top_view_png(environment: Environment, *, sources_m: Sequence[Vec3] = ()) -> bytes:
    """Return a PNG of an environment from above, x to the right and y up.

    Solids are the brighter the higher they are; arrows are the wind at the first source's height, or at 2 m; blue and
    violet bars with arrows are inlets and outlets, red dots are sources.
    """
    plan = PlanView.of(environment, sources_m[0][2] if sources_m else 2.0)
    painter = PlanPainter(plan, PixelScale.for_long_side(plan, LONG_SIDE_PX, MARGIN_PX), PAPER)
    painter.floor(FLOOR)
    for box in sorted(environment.boxes, key=lambda box: box.max_m[2]):
        # Lintels would hide doors.
        if box.kind == "obstacle" or (box.kind == "wall" and box.min_m[2] <= environment.grid.origin_m[2]):
            painter.box(box)
    painter.outline(EDGE, width=2)
    painter.wind(environment.wind.velocity_m_s[0], WIND, ARROWS_PER_SIDE)
    painter.openings(INLET, OUTLET, width=_OPENING_PX, flow_arrow_px=_FLOW_ARROW_PX)
    for source_m in sources_m:
        painter.dot(source_m, 8, fill=SOURCE, outline=(255, 255, 255), width=2)
    file = io.BytesIO()
    painter.image.save(file, format="PNG", compress_level=3)
    return file.getvalue()
