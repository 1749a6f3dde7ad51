"""Pieces of layouts: turned and round solids as strips, walls with doors, and places that keep apart."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from gslcosim.environment.model import Box

Rgba = tuple[float, float, float, float]
Point = tuple[float, float]

WALL_RGBA: Rgba = (0.86, 0.86, 0.84, 1.0)
STEEL_RGBA: Rgba = (0.16, 0.27, 0.55, 1.0)
SHELF_RGBA: Rgba = (0.85, 0.45, 0.15, 1.0)
GOODS_RGBA: Rgba = (0.68, 0.52, 0.35, 1.0)
VEHICLE_RGBA: Rgba = (0.90, 0.70, 0.10, 1.0)
WOOD_RGBA: Rgba = (0.55, 0.38, 0.22, 1.0)
CONCRETE_RGBA: Rgba = (0.60, 0.60, 0.58, 1.0)
TANK_RGBA: Rgba = (0.80, 0.83, 0.86, 1.0)

# Turned and round things become strips of this width: as fine as the usual cell, chosen.
STRIP_M = 0.2
N_CIRCLE = 24


@dataclass(frozen=True, kw_only=True)
class Area:
    """A rectangle on the floor, world frame [m]."""

    min_m: Point
    max_m: Point

    @property
    def size_m(self) -> Point:
        """Its sides along x and y [m]."""
        return self.max_m[0] - self.min_m[0], self.max_m[1] - self.min_m[1]

    def is_apart_from(self, other: "Area", gap_m: float = 0.0) -> bool:
        """Return whether at least a gap [m] lies between the two, along x or along y."""
        return any(
            self.max_m[i] + gap_m <= other.min_m[i] + 1e-9 or other.max_m[i] + gap_m <= self.min_m[i] + 1e-9
            for i in range(2)
        )


def box_above(name: str, area: Area, bottom_m: float, top_m: float, rgba: Rgba, *, is_wall: bool = False) -> Box:
    """Return the box above an area between two heights [m]."""
    return Box(
        name=name,
        kind="wall" if is_wall else "obstacle",
        min_m=tuple(_clean(v) for v in (*area.min_m, bottom_m)),  # pyright: ignore[reportArgumentType]
        max_m=tuple(_clean(v) for v in (*area.max_m, top_m)),  # pyright: ignore[reportArgumentType]
        rgba=rgba,
    )


def rotated_corners(centre_m: Point, size_m: Point, angle_rad: float) -> tuple[Point, ...]:
    """Return the corners, counterclockwise, of a rectangle that is turned about its centre."""
    cos, sin = math.cos(angle_rad), math.sin(angle_rad)
    return tuple(
        (
            centre_m[0] + cos * sx * size_m[0] / 2 - sin * sy * size_m[1] / 2,
            centre_m[1] + sin * sx * size_m[0] / 2 + cos * sy * size_m[1] / 2,
        )
        for sx, sy in ((-1, -1), (1, -1), (1, 1), (-1, 1))
    )


def circle_corners(centre_m: Point, radius_m: float) -> tuple[Point, ...]:
    """Return the corners of a regular polygon of the same area as a circle."""
    step = 2 * math.pi / N_CIRCLE
    reach_m = radius_m * math.sqrt(step / math.sin(step))
    return tuple(
        (centre_m[0] + reach_m * math.cos(i * step), centre_m[1] + reach_m * math.sin(i * step))
        for i in range(N_CIRCLE)
    )


def bounding_area(corners_m: Sequence[Point]) -> Area:
    """Return the smallest area that holds all corners."""
    xs, ys = zip(*corners_m, strict=True)
    return Area(min_m=(min(xs), min(ys)), max_m=(max(xs), max(ys)))


def split_into_strips(
    name: str, corners_m: Sequence[Point], bottom_m: float, top_m: float, rgba: Rgba
) -> tuple[Box, ...]:
    """Return boxes `name_0`, `name_1`, … along x that together stand for a convex prism.

    Each strip is as long as the polygon is at the strip's middle, so that the area is kept to second order.
    """
    bounds = bounding_area(corners_m)
    n = max(1, round(bounds.size_m[0] / STRIP_M))
    borders = np.linspace(bounds.min_m[0], bounds.max_m[0], n + 1)
    boxes: list[Box] = []
    for i in range(n):
        low, high = _span_at((borders[i] + borders[i + 1]) / 2, corners_m)
        area = Area(min_m=(float(borders[i]), low), max_m=(float(borders[i + 1]), high))
        if high - low > 1e-6:
            boxes.append(box_above(f"{name}_{i}", area, bottom_m, top_m, rgba))
    return tuple(boxes)


def wall_with_gaps(
    name: str, area: Area, height_m: float, gaps: Sequence[tuple[float, float]], gap_height_m: float
) -> tuple[Box, ...]:
    """Return the pieces of a wall along its longer side, and the lintels above its gaps.

    Args:
        name: Of the wall; pieces are `name_0`, …, lintels `name_lintel_0`, ….
        area: The wall's footprint.
        height_m: Of the wall, from the floor.
        gaps: From and to along the longer side [m], ascending, apart from each other.
        gap_height_m: Height of the gaps; at least `height_m` means no lintel.
    """
    axis = 0 if area.size_m[0] >= area.size_m[1] else 1
    borders = [area.min_m[axis], *(border for gap in gaps for border in gap), area.max_m[axis]]
    boxes: list[Box] = []
    for i, (low, high) in enumerate(pairwise(borders)):
        if high - low < 1e-6:
            continue
        part = _part(area, axis, low, high)
        if i % 2 == 0:
            boxes.append(box_above(f"{name}_{i // 2}", part, 0.0, height_m, WALL_RGBA, is_wall=True))
        elif gap_height_m < height_m - 1e-6:
            boxes.append(box_above(f"{name}_lintel_{i // 2}", part, gap_height_m, height_m, WALL_RGBA, is_wall=True))
    return tuple(boxes)


def free_places(
    rng: np.random.Generator, size_m: Point, zone: Area, taken: Sequence[Area], *, gap_m: float = 0.0, n_tries: int = 60
) -> Iterator[Area]:
    """Yield places for a thing of a size, drawn evenly in a zone, that keep a gap [m] to all that is taken."""
    room = (zone.size_m[0] - size_m[0], zone.size_m[1] - size_m[1])
    if min(room) < 0:
        return
    for _ in range(n_tries):
        x_m = zone.min_m[0] + float(rng.random()) * room[0]
        y_m = zone.min_m[1] + float(rng.random()) * room[1]
        place = Area(min_m=(x_m, y_m), max_m=(x_m + size_m[0], y_m + size_m[1]))
        if all(place.is_apart_from(other, gap_m) for other in taken):
            yield place


def _span_at(x_m: float, corners_m: Sequence[Point]) -> tuple[float, float]:
    crossings = [
        ay + (by - ay) * (x_m - ax) / (bx - ax)
        for (ax, ay), (bx, by) in zip(corners_m, (*corners_m[1:], corners_m[0]), strict=True)
        if ax != bx and (ax - x_m) * (bx - x_m) <= 0
    ]
    return (float(min(crossings)), float(max(crossings))) if crossings else (0.0, 0.0)


def _part(area: Area, axis: int, low: float, high: float) -> Area:
    if axis == 0:
        return Area(min_m=(low, area.min_m[1]), max_m=(high, area.max_m[1]))
    return Area(min_m=(area.min_m[0], low), max_m=(area.max_m[0], high))


# Free of the last digits of sums, so that edges on borders of cells stay there.
def _clean(value_m: float) -> float:
    return round(float(value_m), 6)
