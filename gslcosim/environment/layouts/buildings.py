"""Buildings: offices along a corridor, flats divided at random, and rooms joined by random passages."""

from collections.abc import Iterator, Sequence

import numpy as np

from gslcosim.base.rng import stream
from gslcosim.environment.layouts.pieces import (
    CONCRETE_RGBA,
    GOODS_RGBA,
    STEEL_RGBA,
    WOOD_RGBA,
    Area,
    Rgba,
    box_above,
    free_places,
    wall_with_gaps,
)
from gslcosim.environment.model import Box
from gslcosim.scenario.models.layouts import ClutteredRoomsSpec, HomeSpec, OfficeSpec

Gap = tuple[float, float]
Wall = tuple[Area, list[Gap]]

# Footprint and height of furniture [m], usual sizes.
DESK = ("desk", (1.6, 0.8), 0.75, WOOD_RGBA)
FURNITURE: tuple[tuple[str, tuple[float, float], float, Rgba], ...] = (
    ("bed", (1.6, 2.0), 0.5, GOODS_RGBA),
    ("sofa", (2.0, 0.9), 0.8, STEEL_RGBA),
    ("table", (1.4, 0.8), 0.75, WOOD_RGBA),
    ("wardrobe", (1.2, 0.6), 2.0, WOOD_RGBA),
)
CLUTTER_SIDE_M, CLUTTER_HEIGHT_M = (0.4, 1.0), (0.4, 2.0)
# Free floor kept around furniture, and on both sides of doors.
FURNITURE_GAP_M, DOOR_GAP_M = 0.6, 0.9


def build_office(layout: OfficeSpec) -> tuple[Box, ...]:
    """Return walls, doors and desks of an office; the corridor runs along x in the middle."""
    rng = stream(layout.seed, "layout.office")
    x_m, y_m, z_m = layout.size_m
    rooms = [room for side in (0, 1) for room in _office_rooms(layout, side)]
    solid_from_m = l_shape_from_m(layout)
    kept = [room for room in rooms if room.min_m[1] < y_m / 2 or room.min_m[0] < solid_from_m - 1e-9]
    walls = [wall for side in (0, 1) for wall in _corridor_walls(layout, side, rng)]
    walls += [(_east_wall(room, layout.partition_m), []) for room in kept if room.max_m[0] < x_m - 1e-9]
    boxes = _walls(walls, z_m, layout.door_m[1])
    if solid_from_m < x_m:
        outside = Area(min_m=(solid_from_m, _corridor_sides_m(layout)[1]), max_m=(x_m, y_m))
        boxes.append(box_above("outside", outside, 0.0, z_m, CONCRETE_RGBA, is_wall=True))
    if layout.has_furniture:
        doors = [_before_gap(area, gap) for area, gaps in walls for gap in gaps]
        boxes += _desks(rng, kept, [*doors, *(area for area, _ in walls)], z_m)
    return tuple(boxes)


def l_shape_from_m(layout: OfficeSpec) -> float:
    """Return from which x on the upper side of an office is not part of it [m]; its whole length for a rectangle."""
    if layout.outline == "rectangle" or layout.rooms_per_side < 2:
        return layout.size_m[0]
    return layout.size_m[0] * ((layout.rooms_per_side + 1) // 2) / layout.rooms_per_side


def build_home(layout: HomeSpec) -> tuple[Box, ...]:
    """Return walls, doors and furniture of a flat that was divided at random."""
    rng = stream(layout.seed, "layout.home")
    x_m, y_m, z_m = layout.size_m
    rooms = [Area(min_m=(0.0, 0.0), max_m=(x_m, y_m))]
    walls: list[Wall] = []
    while len(rooms) < layout.n_rooms:
        split = next(_splits(layout, rng, rooms, walls), None)
        if split is None:
            break
        i, parts, wall = split
        rooms[i : i + 1] = parts
        walls.append(wall)
    boxes = _walls(walls, z_m, layout.door_m[1])
    if layout.has_furniture:
        taken = [*(area for area, _ in walls), *(_before_gap(area, gap) for area, gaps in walls for gap in gaps)]
        for i, room in enumerate(rooms):
            name, size_m, height_m, rgba = FURNITURE[int(rng.integers(len(FURNITURE)))]
            boxes += _furnish(rng, f"{name}_{i}", size_m, room, taken, min(height_m, z_m), rgba)
    return tuple(boxes)


def build_cluttered_rooms(layout: ClutteredRoomsSpec) -> tuple[Box, ...]:
    """Return walls with passages between a grid of rooms, all of which can be reached, and clutter."""
    rng = stream(layout.seed, "layout.cluttered_rooms")
    z_m = layout.size_m[2]
    has_passage = _passages(layout, rng)
    walls: list[Wall] = []
    for (room, axis), is_open in has_passage.items():
        area = _wall_between(layout, room, axis)
        walls.append((area, [_gap_in(area, layout.passage_m, rng)] if is_open else []))
    boxes = _walls(walls, z_m, z_m)
    taken = [*(area for area, _ in walls), *(_before_gap(area, gap) for area, gaps in walls for gap in gaps)]
    floor = Area(min_m=(0.0, 0.0), max_m=layout.size_m[:2])
    for i in range(layout.n_clutter):
        side_m = float(rng.uniform(*CLUTTER_SIDE_M)), float(rng.uniform(*CLUTTER_SIDE_M))
        height_m = min(float(rng.uniform(*CLUTTER_HEIGHT_M)), z_m)
        boxes += _furnish(rng, f"clutter_{i}", side_m, floor, taken, height_m, GOODS_RGBA)
    return tuple(boxes)


def _walls(walls: Sequence[Wall], height_m: float, gap_height_m: float) -> list[Box]:
    return [
        box
        for i, (area, gaps) in enumerate(walls)
        for box in wall_with_gaps(f"partition_{i}", area, height_m, sorted(gaps), gap_height_m)
    ]


# The inner faces of the corridor's walls: y of the lower and of the upper [m].
def _corridor_sides_m(layout: OfficeSpec) -> tuple[float, float]:
    middle_m = layout.size_m[1] / 2
    return middle_m - layout.corridor_m / 2, middle_m + layout.corridor_m / 2


def _office_rooms(layout: OfficeSpec, side: int) -> list[Area]:
    low_m, high_m = _corridor_sides_m(layout)
    y0, y1 = (0.0, low_m) if side == 0 else (high_m, layout.size_m[1])
    width_m = layout.size_m[0] / layout.rooms_per_side
    return [Area(min_m=(i * width_m, y0), max_m=((i + 1) * width_m, y1)) for i in range(layout.rooms_per_side)]


def _corridor_walls(layout: OfficeSpec, side: int, rng: np.random.Generator) -> Iterator[Wall]:
    low_m, high_m = _corridor_sides_m(layout)
    y0 = low_m - layout.partition_m if side == 0 else high_m
    end_m = layout.size_m[0] if side == 0 else l_shape_from_m(layout)
    for room in _office_rooms(layout, side):
        if room.max_m[0] <= end_m + 1e-9:
            area = Area(min_m=(room.min_m[0], y0), max_m=(room.max_m[0], y0 + layout.partition_m))
            yield area, [_gap_in(area, layout.door_m[0], rng)]


def _east_wall(room: Area, thickness_m: float) -> Area:
    x_m = room.max_m[0]
    return Area(min_m=(x_m - thickness_m, room.min_m[1]), max_m=(x_m, room.max_m[1]))


# A gap of a width somewhere in a wall, away from its ends; as wide as is possible in short walls.
def _gap_in(area: Area, width_m: float, rng: np.random.Generator) -> Gap:
    axis = 0 if area.size_m[0] >= area.size_m[1] else 1
    width_m = min(width_m, 0.8 * area.size_m[axis])
    margin_m = min(0.4, (area.size_m[axis] - width_m) / 2)
    low_m, high_m = area.min_m[axis] + margin_m, area.max_m[axis] - margin_m - width_m
    start_m = low_m + float(rng.random()) * (high_m - low_m)
    return start_m, start_m + width_m


def _before_gap(area: Area, gap: Gap) -> Area:
    if area.size_m[0] >= area.size_m[1]:
        return Area(min_m=(gap[0], area.min_m[1] - DOOR_GAP_M), max_m=(gap[1], area.max_m[1] + DOOR_GAP_M))
    return Area(min_m=(area.min_m[0] - DOOR_GAP_M, gap[0]), max_m=(area.max_m[0] + DOOR_GAP_M, gap[1]))


def _desks(rng: np.random.Generator, rooms: Sequence[Area], taken: Sequence[Area], ceiling_m: float) -> list[Box]:
    name, size_m, height_m, rgba = DESK
    keep_clear = list(taken)
    return [
        box
        for i, room in enumerate(rooms)
        for box in _furnish(rng, f"{name}_{i}", size_m, room, keep_clear, min(height_m, ceiling_m), rgba)
    ]


# One thing in a zone, either way round, if there is a place for it; the place is then taken.
def _furnish(
    rng: np.random.Generator,
    name: str,
    size_m: tuple[float, float],
    zone: Area,
    taken: list[Area],
    height_m: float,
    rgba: Rgba,
) -> list[Box]:
    if rng.random() < 0.5:
        size_m = (size_m[1], size_m[0])
    place = next(free_places(rng, size_m, zone, taken, gap_m=0.1), None)
    if place is None:
        return []
    (x0, y0), (x1, y1), gap_m = place.min_m, place.max_m, FURNITURE_GAP_M
    taken.append(Area(min_m=(x0 - gap_m, y0 - gap_m), max_m=(x1 + gap_m, y1 + gap_m)))
    return [box_above(name, place, 0.0, height_m, rgba)]


# Ways to divide the largest room that can be divided: its index, the two rooms, and the wall with its door.
def _splits(
    layout: HomeSpec, rng: np.random.Generator, rooms: Sequence[Area], walls: Sequence[Wall]
) -> Iterator[tuple[int, list[Area], Wall]]:
    doors = [_before_gap(area, gap) for area, gaps in walls for gap in gaps]
    for i in sorted(range(len(rooms)), key=lambda i: (-rooms[i].size_m[0] * rooms[i].size_m[1], i)):
        room = rooms[i]
        axis = 0 if room.size_m[0] >= room.size_m[1] else 1
        slack_m = room.size_m[axis] - 2 * layout.least_room_m - layout.partition_m
        for _ in range(20 if slack_m >= 0 else 0):
            at_m = room.min_m[axis] + layout.least_room_m + float(rng.random()) * slack_m
            wall = _cut(room, axis, at_m, at_m + layout.partition_m)
            # A wall that ends at a door would close it.
            if all(wall.is_apart_from(door) for door in doors):
                parts = [
                    _cut(room, axis, room.min_m[axis], at_m),
                    _cut(room, axis, at_m + layout.partition_m, room.max_m[axis]),
                ]
                yield i, parts, (wall, [_gap_in(wall, layout.door_m[0], rng)])


def _cut(room: Area, axis: int, low_m: float, high_m: float) -> Area:
    if axis == 0:
        return Area(min_m=(low_m, room.min_m[1]), max_m=(high_m, room.max_m[1]))
    return Area(min_m=(room.min_m[0], low_m), max_m=(room.max_m[0], high_m))


# For each wall, named by the room below it and the axis across it: whether it has a passage. A random spanning tree
# of the rooms has one, and some of the others.
def _passages(layout: ClutteredRoomsSpec, rng: np.random.Generator) -> dict[tuple[tuple[int, int], int], bool]:
    nx, ny = layout.n_rooms
    rooms = [(i, j) for i in range(nx) for j in range(ny)]
    walls = [((i, j), axis) for i, j in rooms for axis, last in ((0, i == nx - 1), (1, j == ny - 1)) if not last]
    group = {room: n for n, room in enumerate(rooms)}
    has_passage: dict[tuple[tuple[int, int], int], bool] = {}
    for index in rng.permutation(len(walls)):
        (i, j), axis = walls[int(index)]
        first, second = group[i, j], group[(i + 1, j) if axis == 0 else (i, j + 1)]
        has_passage[(i, j), axis] = first != second or float(rng.random()) < layout.extra_passage_frac
        group = {room: first if each == second else each for room, each in group.items()}
    return {wall: has_passage[wall] for wall in walls}


def _wall_between(layout: ClutteredRoomsSpec, room: tuple[int, int], axis: int) -> Area:
    widths_m = [layout.size_m[i] / layout.n_rooms[i] for i in range(2)]
    low = [room[i] * widths_m[i] for i in range(2)]
    high = [(room[i] + 1) * widths_m[i] for i in range(2)]
    half_m = layout.partition_m / 2
    low[axis], high[axis] = high[axis] - half_m, high[axis] + half_m
    return Area(min_m=(low[0], low[1]), max_m=(high[0], high[1]))
