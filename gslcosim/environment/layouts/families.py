"""Families of layouts (warehouses, buildings, plants outdoors, wind tunnels) and the pieces they consist of."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from gslcosim.base import elementary
from gslcosim.base.rng import stream
from gslcosim.environment.model import Box, Grid, Opening
from gslcosim.scenario.models.geometry import (
    ClutteredRoomsSpec,
    ComplexWarehouseSpec,
    HomeSpec,
    OfficeSpec,
    OpeningSpec,
    PlantSpec,
    SimpleWarehouseSpec,
    WindTunnelSpec,
)

Rgba = tuple[float, float, float, float]
Point = tuple[float, float]
Gap = tuple[float, float]
Wall = tuple["Area", list[Gap]]
Racks = SimpleWarehouseSpec | ComplexWarehouseSpec

WALL_RGBA: Rgba = (0.86, 0.86, 0.84, 1.0)
STEEL_RGBA: Rgba = (0.16, 0.27, 0.55, 1.0)
SHELF_RGBA: Rgba = (0.85, 0.45, 0.15, 1.0)
GOODS_RGBA: Rgba = (0.68, 0.52, 0.35, 1.0)
VEHICLE_RGBA: Rgba = (0.90, 0.70, 0.10, 1.0)
WOOD_RGBA: Rgba = (0.55, 0.38, 0.22, 1.0)
CONCRETE_RGBA: Rgba = (0.60, 0.60, 0.58, 1.0)
TANK_RGBA: Rgba = (0.80, 0.83, 0.86, 1.0)

# Width of the strips that stand for turned and round shapes; chosen, as fine as the usual cell.
STRIP_M = 0.2
N_CIRCLE = 24

# Footprint and height of furniture [m], usual sizes.
DESK = ("desk", (1.6, 0.8), 0.75, WOOD_RGBA)
FURNITURE: tuple[tuple[str, Point, float, Rgba], ...] = (
    ("bed", (1.6, 2.0), 0.5, GOODS_RGBA),
    ("sofa", (2.0, 0.9), 0.8, STEEL_RGBA),
    ("table", (1.4, 0.8), 0.75, WOOD_RGBA),
    ("wardrobe", (1.2, 0.6), 2.0, WOOD_RGBA),
)
CLUTTER_SIDE_M, CLUTTER_HEIGHT_M = (0.4, 1.0), (0.4, 2.0)
# Free floor kept around furniture, and on both sides of doors.
FURNITURE_GAP_M, DOOR_GAP_M = 0.6, 0.9

# Chosen: a small storage tank, a shed; clearance between them and to the boundary.
TANK_RADIUS_M, TANK_HEIGHT_M = (1.2, 2.4), (3.0, 6.0)
BUILDING_SIDE_M, BUILDING_HEIGHT_M = (4.0, 8.0), (2.5, 5.0)
PLANT_GAP_M = 2.0

# The thesis adds this to the wider opening for the aisle between the ends of rows and the wall [m].
END_AISLE_EXTRA_M = 2.0
POST_M, SHELF_M = 0.1, 0.1
# Fill height of each of four bays (lower near, lower far, upper near, upper far), as a fraction of the space below
# the next shelf. Seven loads, as many as the thesis has filled racks; the fractions are chosen.
LOADS = (
    (0.95, 0.95, 0.95, 0.95),
    (0.95, 0.95, 0.6, 0.6),
    (0.6, 0.95, 0.95, 0.35),
    (0.95, 0.0, 0.6, 0.95),
    (0.35, 0.6, 0.0, 0.95),
    (0.95, 0.6, 0.35, 0.0),
    (0.6, 0.6, 0.95, 0.6),
)
# The two empty racks: with both shelves, and with the upper one only.
EMPTY_SHELVES = ((0, 1), (1,))
N_TYPES = len(LOADS) + len(EMPTY_SHELVES)

FORKLIFT_M, FORKLIFT_HEIGHTS_M = (1.2, 2.4), (1.1, 2.2)
PILE_M, PILE_HEIGHT_M = (1.0, 1.8), (0.6, 1.8)
PALLET_M, PALLET_HEIGHT_M = (0.8, 1.2), 0.15
# Clearance between items, and in front of openings.
ITEM_GAP_M, OPENING_GAP_M = 0.6, 1.5
# Draws before a place is given up.
N_TRIES = 60


@dataclass(frozen=True, kw_only=True)
class Area:
    """A rectangle on the floor, world frame [m]."""

    min_m: Point
    max_m: Point

    @property
    def size_m(self) -> Point:
        """Its sides along x and y [m]."""
        return self.max_m[0] - self.min_m[0], self.max_m[1] - self.min_m[1]

    @property
    def long_axis(self) -> int:
        """Axis of the longer side: 0 is x, 1 is y."""
        return 0 if self.size_m[0] >= self.size_m[1] else 1

    def is_apart_from(self, other: "Area", gap_m: float = 0.0) -> bool:
        """Return whether the two are at least a gap [m] apart, along x or along y."""
        return any(
            self.max_m[i] + gap_m <= other.min_m[i] + 1e-9 or other.max_m[i] + gap_m <= self.min_m[i] + 1e-9
            for i in range(2)
        )


def build_racks(layout: Racks, openings: Sequence[OpeningSpec]) -> tuple[Box, ...]:
    """Return all racks of a warehouse, named `rack_i_j_k`: row, place in the row, storey."""
    places = rack_areas(layout, openings)
    n_storeys = max(1, math.floor(layout.size_m[2] / layout.rack_size_m[2] + 1e-9))
    types = rack_types(layout, len(places) * n_storeys)
    return tuple(
        box
        for i, (name, area) in enumerate(places)
        for storey in range(n_storeys)
        for box in _rack(f"rack_{name}_{storey}", area, layout.rack_size_m[2], storey, types[i * n_storeys + storey])
    )


def build_items(layout: ComplexWarehouseSpec, openings: Sequence[OpeningSpec]) -> tuple[Box, ...]:
    """Return forklifts, piles and pallets, turned by any angle, in the end aisles and clear of the openings."""
    rng = stream(layout.seed, "layout.items")
    x_m, y_m, _ = layout.size_m
    depth_m = min([end_aisle_m(layout, openings), *(area.min_m[1] for _, area in rack_areas(layout, openings))])
    zones = (_area(0.0, 0.0, x_m, depth_m), _area(0.0, y_m - depth_m, x_m, depth_m))
    taken = [_before(opening) for opening in openings]
    kinds = ["forklift"] * layout.n_forklifts + ["pile"] * layout.n_piles + ["pallet"] * layout.n_pallets
    boxes: list[Box] = []
    for i, kind in enumerate(kinds):
        number = i - kinds.index(kind)
        first = int(rng.integers(2))
        size_m = FORKLIFT_M if kind == "forklift" else PALLET_M
        if kind == "pile":
            size_m = float(rng.uniform(*PILE_M)), float(rng.uniform(*PILE_M))
        corners = rotated_corners((0.0, 0.0), size_m, float(rng.uniform(0.0, 2 * math.pi)))
        bounds = bounding_area(corners)
        for zone in (zones[first], zones[1 - first]):
            place = next(free_places(rng, bounds.size_m, zone, taken, gap_m=ITEM_GAP_M), None)
            if place is not None:
                taken.append(place)
                shift = (place.min_m[0] - bounds.min_m[0], place.min_m[1] - bounds.min_m[1])
                moved = tuple((x + shift[0], y + shift[1]) for x, y in corners)
                boxes += _item(rng, kind, f"{kind}_{number}", moved, layout.size_m[2])
                break
    return tuple(boxes)


def build_office(layout: OfficeSpec) -> tuple[Box, ...]:
    """Return walls, doors and desks of an office; the corridor runs along x in the middle."""
    rng = stream(layout.seed, "layout.office")
    x_m, y_m, z_m = layout.size_m
    rooms = [room for side in (0, 1) for room in _office_rooms(layout, side)]
    solid_from_m = l_shape_from_m(layout)
    kept = [room for room in rooms if room.min_m[1] < y_m / 2 or room.min_m[0] < solid_from_m - 1e-9]
    walls = [wall for side in (0, 1) for wall in _corridor_walls(layout, side, rng)]
    inner = [room for room in kept if room.max_m[0] < x_m - 1e-9]
    walls += [(_cut(room, 0, room.max_m[0] - layout.partition_m, room.max_m[0]), []) for room in inner]
    boxes = _walls(walls, z_m, layout.door_m[1])
    if solid_from_m < x_m:
        outside = Area(min_m=(solid_from_m, _corridor_sides_m(layout)[1]), max_m=(x_m, y_m))
        boxes.append(box_above("outside", outside, 0.0, z_m, CONCRETE_RGBA, is_wall=True))
    if layout.has_furniture:
        name, size_m, height_m, rgba = DESK
        taken = _floor_of(walls)
        for i, room in enumerate(kept):
            boxes += _furnish(rng, f"{name}_{i}", size_m, room, taken, min(height_m, z_m), rgba)
    return tuple(boxes)


def build_home(layout: HomeSpec) -> tuple[Box, ...]:
    """Return walls, doors and furniture of a flat divided at random."""
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
        taken = _floor_of(walls)
        for i, room in enumerate(rooms):
            name, size_m, height_m, rgba = FURNITURE[int(rng.integers(len(FURNITURE)))]
            boxes += _furnish(rng, f"{name}_{i}", size_m, room, taken, min(height_m, z_m), rgba)
    return tuple(boxes)


def build_cluttered_rooms(layout: ClutteredRoomsSpec) -> tuple[Box, ...]:
    """Return walls with passages between a grid of rooms, all of them reachable, and clutter."""
    rng = stream(layout.seed, "layout.cluttered_rooms")
    z_m = layout.size_m[2]
    has_passage = _passages(layout, rng)
    walls: list[Wall] = []
    for (room, axis), is_open in has_passage.items():
        area = _wall_between(layout, room, axis)
        walls.append((area, [_gap_in(area, layout.passage_m, rng)] if is_open else []))
    boxes = _walls(walls, z_m, z_m)
    taken = _floor_of(walls)
    floor = Area(min_m=(0.0, 0.0), max_m=layout.size_m[:2])
    for i in range(layout.n_clutter):
        side_m = float(rng.uniform(*CLUTTER_SIDE_M)), float(rng.uniform(*CLUTTER_SIDE_M))
        height_m = min(float(rng.uniform(*CLUTTER_HEIGHT_M)), z_m)
        boxes += _furnish(rng, f"clutter_{i}", side_m, floor, taken, height_m, GOODS_RGBA)
    return tuple(boxes)


def build_plant(layout: PlantSpec) -> tuple[Box, ...]:
    """Return the buildings and tanks of a plant, without those that find no place."""
    rng = stream(layout.seed, "layout.plant")
    x_m, y_m, z_m = layout.size_m
    zone = Area(min_m=(PLANT_GAP_M, PLANT_GAP_M), max_m=(x_m - PLANT_GAP_M, y_m - PLANT_GAP_M))
    taken: list[Area] = []
    boxes: list[Box] = []
    for i in range(layout.n_buildings):
        sides_m = float(rng.uniform(*BUILDING_SIDE_M)), float(rng.uniform(*BUILDING_SIDE_M))
        height_m = min(float(rng.uniform(*BUILDING_HEIGHT_M)), 0.8 * z_m)
        for place in list(free_places(rng, sides_m, zone, taken, gap_m=PLANT_GAP_M))[:1]:
            taken.append(place)
            boxes.append(box_above(f"building_{i}", place, 0.0, height_m, CONCRETE_RGBA))
    for i in range(layout.n_tanks):
        radius_m = float(rng.uniform(*TANK_RADIUS_M))
        height_m = min(float(rng.uniform(*TANK_HEIGHT_M)), 0.8 * z_m)
        for place in list(free_places(rng, (2 * radius_m, 2 * radius_m), zone, taken, gap_m=PLANT_GAP_M))[:1]:
            taken.append(place)
            centre_m = (place.min_m[0] + radius_m, place.min_m[1] + radius_m)
            boxes += split_into_strips(f"tank_{i}", circle_corners(centre_m, radius_m), 0.0, height_m, TANK_RGBA)
    return tuple(boxes)


def build_wind_tunnel(layout: WindTunnelSpec) -> tuple[Box, ...]:
    """Return the blocks of a wind tunnel, in a row along its centre line."""
    x_m, y_m, z_m = layout.size_m
    side_m = min(layout.block_m, 0.6 * y_m)
    first_m = min(2 * layout.block_m, x_m / 4)
    boxes: list[Box] = []
    for i in range(layout.n_blocks):
        low_m = first_m + i * (side_m + layout.gap_m)
        if low_m + side_m <= x_m:
            area = Area(min_m=(low_m, (y_m - side_m) / 2), max_m=(low_m + side_m, (y_m + side_m) / 2))
            boxes.append(box_above(f"block_{i}", area, 0.0, min(side_m, z_m), STEEL_RGBA))
    return tuple(boxes)


def log_profile(inlet: Opening, layout: PlantSpec, grid: Grid) -> tuple[Opening, ...]:
    """Return an inlet divided into one for each layer of cells, with the wind of a neutral surface layer.

    u(z) = u_ref ln((z + z0) / z0) / ln((z_ref + z0) / z0)      z0 roughness, z the layer's middle above the ground
    [m/s] = [m/s]: the logarithms' arguments are lengths over lengths.

    Source:
        Richards and Hoxey 1993, doi:10.1016/0167-6105(93)90124-7, equation 1, whose height is measured from -z0.
    Held by:
        tests/unit/environment/layouts/test_outdoors.py
    """
    low, high = (round((corner[2] - grid.origin_m[2]) / grid.cell_m) for corner in (inlet.min_m, inlet.max_m))
    z0 = layout.roughness_m
    scale = elementary.log((layout.reference_height_m + z0) / z0)
    layers: list[Opening] = []
    for k in range(low, high):
        factor = elementary.log(((k + 0.5) * grid.cell_m + z0) / z0) / scale
        bottom_m, top_m = (round(grid.origin_m[2] + i * grid.cell_m, 9) for i in (k, k + 1))
        u_m_s, v_m_s, w_m_s = inlet.velocity_m_s
        layers.append(
            Opening(
                name=f"{inlet.name}_{k}",
                kind="inlet",
                min_m=(inlet.min_m[0], inlet.min_m[1], bottom_m),
                max_m=(inlet.max_m[0], inlet.max_m[1], top_m),
                velocity_m_s=(u_m_s * factor, v_m_s * factor, w_m_s * factor),
            )
        )
    return tuple(layers)


def l_shape_from_m(layout: OfficeSpec) -> float:
    """Return the x at which the upper side of an office ends [m]; its whole length for a rectangle."""
    if layout.outline == "rectangle" or layout.rooms_per_side < 2:
        return layout.size_m[0]
    return layout.size_m[0] * ((layout.rooms_per_side + 1) // 2) / layout.rooms_per_side


def rack_types(layout: Racks, n_racks: int) -> tuple[int, ...]:
    """Return a random type for each rack: below 7 the index of the load, 7 and 8 empty; enough of them are filled."""
    rng = stream(layout.seed, "layout.rack_types")
    types = rng.integers(N_TYPES, size=n_racks)
    empty = np.flatnonzero(types >= len(LOADS))
    n_missing = math.ceil(layout.filled_least_frac * n_racks - 1e-9) - (n_racks - len(empty))
    if n_missing > 0:
        chosen = rng.choice(empty, size=n_missing, replace=False)
        types[chosen] = rng.integers(len(LOADS), size=n_missing)
    return tuple(int(each) for each in types)


def rack_areas(layout: Racks, openings: Sequence[OpeningSpec]) -> tuple[tuple[str, Area], ...]:
    """Return the areas of racks, each with its row and its place in it: `row_place`.

    As many rows as the aisles allow, spread evenly from wall to wall; in complex warehouses the inner rows are turned
    and stand along x.
    """
    across_m, along_m, _ = layout.rack_size_m
    x_m, y_m, _ = layout.size_m
    end_m = end_aisle_m(layout, openings)
    n_rows = _n_that_fit(x_m, across_m, layout.rack_aisle_m)
    n_places = max(0, math.floor((y_m - 2 * end_m) / along_m + 1e-9))
    first_y_m = (y_m - n_places * along_m) / 2
    pitch_m = (x_m - across_m) / (n_rows - 1) if n_rows > 1 else 0.0
    is_turned = isinstance(layout, ComplexWarehouseSpec) and n_rows > 2
    rows = (0, n_rows - 1) if is_turned else range(n_rows)
    areas = [
        (f"{row}_{place}", _area(row * pitch_m, first_y_m + place * along_m, across_m, along_m))
        for row in rows
        for place in range(n_places)
    ]
    if is_turned and isinstance(layout, ComplexWarehouseSpec):
        areas += _turned_rows(layout, end_m, n_rows - 2)
    return tuple(areas)


def end_aisle_m(layout: Racks, openings: Sequence[OpeningSpec]) -> float:
    """Return the width of the aisle between the ends of rows and the wall [m], by default the thesis's."""
    widest_m = max(opening.max_m[1] - opening.min_m[1] for opening in openings)
    return layout.end_aisle_m or widest_m + END_AISLE_EXTRA_M


def _n_that_fit(length_m: float, width_m: float, gap_m: float) -> int:
    return max(0, math.floor((length_m + gap_m) / (width_m + gap_m) + 1e-9))


def _turned_rows(layout: ComplexWarehouseSpec, end_m: float, n_inner: int) -> list[tuple[str, Area]]:
    across_m, along_m, _ = layout.rack_size_m
    x_m, y_m, _ = layout.size_m
    n_rows = min(n_inner, _n_that_fit(y_m - 2 * end_m, across_m, layout.rack_aisle_m))
    n_places = max(0, math.floor((x_m - 2 * across_m - 2 * layout.side_aisle_m) / along_m + 1e-9))
    pitch_m = across_m + layout.rack_aisle_m
    first_y_m = (y_m - (n_rows - 1) * pitch_m - across_m) / 2
    first_x_m = (x_m - n_places * along_m) / 2
    return [
        (f"turned_{row}_{place}", _area(first_x_m + place * along_m, first_y_m + row * pitch_m, along_m, across_m))
        for row in range(n_rows)
        for place in range(n_places)
    ]


def _rack(name: str, area: Area, height_m: float, storey: int, rack_type: int) -> list[Box]:
    bottom_m = storey * height_m
    is_empty = rack_type >= len(LOADS)
    (x0, y0), (x1, y1) = area.min_m, area.max_m
    boxes = [
        box_above(f"{name}_post_{i}", _area(x, y, POST_M, POST_M), bottom_m, bottom_m + height_m, STEEL_RGBA)
        for i, (x, y) in enumerate((x, y) for x in (x0, x1 - POST_M) for y in (y0, y1 - POST_M))
    ]
    for level in EMPTY_SHELVES[rack_type - len(LOADS)] if is_empty else (0, 1):
        shelf_m = bottom_m + level * height_m / 2
        boxes.append(box_above(f"{name}_shelf_{level}", area, shelf_m, shelf_m + SHELF_M, SHELF_RGBA))
    if not is_empty:
        boxes += _goods(name, area, bottom_m, height_m, LOADS[rack_type])
    return boxes


def _goods(name: str, area: Area, bottom_m: float, height_m: float, load: Sequence[float]) -> list[Box]:
    boxes: list[Box] = []
    (x0, y0), (wide_m, deep_m) = area.min_m, area.size_m
    is_along_x = wide_m > deep_m
    for i, fill_frac in enumerate(load):
        level, bay = divmod(i, 2)
        bay_area = (
            _area(x0 + bay * wide_m / 2, y0, wide_m / 2, deep_m)
            if is_along_x
            else _area(x0, y0 + bay * deep_m / 2, wide_m, deep_m / 2)
        )
        low_m = bottom_m + level * height_m / 2 + SHELF_M
        if fill_frac > 0:
            top_m = low_m + fill_frac * (height_m / 2 - SHELF_M)
            boxes.append(box_above(f"{name}_goods_{i}", bay_area, low_m, top_m, GOODS_RGBA))
    return boxes


def _item(rng: np.random.Generator, kind: str, name: str, corners: Sequence[Point], ceiling_m: float) -> list[Box]:
    if kind == "pallet":
        return _layer(name, "deck", corners, 0.0, PALLET_HEIGHT_M, WOOD_RGBA)
    if kind == "forklift":
        body_m, mast_m = FORKLIFT_HEIGHTS_M
        mast = _shrunk(corners, 0.5)
        return [
            *_layer(name, "body", corners, 0.0, min(body_m, ceiling_m), VEHICLE_RGBA),
            *_layer(name, "cabin", mast, min(body_m, ceiling_m), min(mast_m, ceiling_m), STEEL_RGBA),
        ]
    top_m = min(float(rng.uniform(*PILE_HEIGHT_M)), ceiling_m)
    return [
        *_layer(name, "base", corners, 0.0, top_m / 2, GOODS_RGBA),
        *_layer(name, "top", _shrunk(corners, float(rng.uniform(0.5, 0.9))), top_m / 2, top_m, GOODS_RGBA),
    ]


def _layer(name: str, part: str, corners: Sequence[Point], bottom_m: float, top_m: float, rgba: Rgba) -> list[Box]:
    return list(split_into_strips(f"{name}_{part}", corners, bottom_m, top_m, rgba)) if top_m > bottom_m else []


def _shrunk(corners: Sequence[Point], scale: float) -> tuple[Point, ...]:
    x_m, y_m = (sum(corner[i] for corner in corners) / len(corners) for i in range(2))
    return tuple((x_m + scale * (x - x_m), y_m + scale * (y - y_m)) for x, y in corners)


# The floor in front of an opening, or below one in the ceiling, which stays clear.
def _before(opening: OpeningSpec) -> Area:
    (x0, y0, _), (x1, y1, _) = opening.min_m, opening.max_m
    return Area(
        min_m=(x0 - OPENING_GAP_M * (x0 == x1), y0 - OPENING_GAP_M * (y0 == y1)),
        max_m=(x1 + OPENING_GAP_M * (x0 == x1), y1 + OPENING_GAP_M * (y0 == y1)),
    )


def _area(x_m: float, y_m: float, wide_m: float, deep_m: float) -> Area:
    return Area(min_m=(x_m, y_m), max_m=(x_m + wide_m, y_m + deep_m))


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


# A gap at random in a wall, away from its ends; narrower in short walls.
def _gap_in(area: Area, width_m: float, rng: np.random.Generator) -> Gap:
    axis = area.long_axis
    width_m = min(width_m, 0.8 * area.size_m[axis])
    margin_m = min(0.4, (area.size_m[axis] - width_m) / 2)
    low_m, high_m = area.min_m[axis] + margin_m, area.max_m[axis] - margin_m - width_m
    start_m = low_m + float(rng.random()) * (high_m - low_m)
    return start_m, start_m + width_m


# Clear floor on both sides of each gap.
def _clear_at_gaps(walls: Sequence[Wall]) -> list[Area]:
    return [_cut(_grown(area, DOOR_GAP_M), area.long_axis, *gap) for area, gaps in walls for gap in gaps]


# The floor that furniture must leave to walls and doors.
def _floor_of(walls: Sequence[Wall]) -> list[Area]:
    return [*(area for area, _ in walls), *_clear_at_gaps(walls)]


def _grown(area: Area, by_m: float) -> Area:
    (x0, y0), (x1, y1) = area.min_m, area.max_m
    return Area(min_m=(x0 - by_m, y0 - by_m), max_m=(x1 + by_m, y1 + by_m))


# One piece of furniture in a zone, in either orientation, if it finds a place, which is then taken.
def _furnish(
    rng: np.random.Generator, name: str, size_m: Point, zone: Area, taken: list[Area], height_m: float, rgba: Rgba
) -> list[Box]:
    if rng.random() < 0.5:
        size_m = (size_m[1], size_m[0])
    place = next(free_places(rng, size_m, zone, taken, gap_m=0.1), None)
    if place is None:
        return []
    taken.append(_grown(place, FURNITURE_GAP_M))
    return [box_above(name, place, 0.0, height_m, rgba)]


# Ways to divide the largest room that can be divided: its index, the two rooms, and the wall with its door.
def _splits(
    layout: HomeSpec, rng: np.random.Generator, rooms: Sequence[Area], walls: Sequence[Wall]
) -> Iterator[tuple[int, list[Area], Wall]]:
    doors = _clear_at_gaps(walls)
    for i in sorted(range(len(rooms)), key=lambda i: (-rooms[i].size_m[0] * rooms[i].size_m[1], i)):
        room = rooms[i]
        axis = room.long_axis
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


# True for each wall with a passage; a wall is named by the room below it and the axis across it. The walls of a random
# spanning tree of the rooms have passages, and some of the others.
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


def box_above(name: str, area: Area, bottom_m: float, top_m: float, rgba: Rgba, *, is_wall: bool = False) -> Box:
    """Return the box above an area between two heights [m]."""
    # Without the rounding errors of sums, so that edges on cell borders stay there.
    x0, y0, z0, x1, y1, z1 = (round(float(each_m), 6) for each_m in (*area.min_m, bottom_m, *area.max_m, top_m))
    kind = "wall" if is_wall else "obstacle"
    return Box(name=name, kind=kind, min_m=(x0, y0, z0), max_m=(x1, y1, z1), rgba=rgba)


def rotated_corners(centre_m: Point, size_m: Point, angle_rad: float) -> tuple[Point, ...]:
    """Return the corners, counterclockwise, of a rectangle turned about its centre."""
    cos, sin = elementary.cos(angle_rad), elementary.sin(angle_rad)
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
    reach_m = radius_m * math.sqrt(step / elementary.sin(step))
    return tuple(
        (centre_m[0] + reach_m * elementary.cos(i * step), centre_m[1] + reach_m * elementary.sin(i * step))
        for i in range(N_CIRCLE)
    )


def bounding_area(corners_m: Sequence[Point]) -> Area:
    """Return the smallest area that holds all corners."""
    xs, ys = zip(*corners_m, strict=True)
    return Area(min_m=(min(xs), min(ys)), max_m=(max(xs), max(ys)))


def split_into_strips(
    name: str, corners_m: Sequence[Point], bottom_m: float, top_m: float, rgba: Rgba
) -> tuple[Box, ...]:
    """Return boxes `name_0`, `name_1`, … along x that together approximate a convex prism.

    Each strip has the polygon's length at the strip's middle, so that the area is exact to second order.
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
    name: str, area: Area, height_m: float, gaps: Sequence[Point], gap_height_m: float
) -> tuple[Box, ...]:
    """Return the pieces of a wall along its longer side, and the lintels above its gaps.

    Args:
        name: Of the wall; pieces are `name_0`, …, lintels `name_lintel_0`, ….
        area: The wall's footprint.
        height_m: Of the wall, from the floor.
        gaps: Start and end along the longer side [m], ascending, without overlap.
        gap_height_m: Height of the gaps; at least `height_m` means no lintel.
    """
    axis = area.long_axis
    borders = [area.min_m[axis], *(border for gap in gaps for border in gap), area.max_m[axis]]
    boxes: list[Box] = []
    for i, (low, high) in enumerate(pairwise(borders)):
        if high - low < 1e-6:
            continue
        part = _cut(area, axis, low, high)
        if i % 2 == 0:
            boxes.append(box_above(f"{name}_{i // 2}", part, 0.0, height_m, WALL_RGBA, is_wall=True))
        elif gap_height_m < height_m - 1e-6:
            boxes.append(box_above(f"{name}_lintel_{i // 2}", part, gap_height_m, height_m, WALL_RGBA, is_wall=True))
    return tuple(boxes)


def free_places(
    rng: np.random.Generator, size_m: Point, zone: Area, taken: Sequence[Area], *, gap_m: float
) -> Iterator[Area]:
    """Yield places of a size, drawn evenly in a zone, at least a gap [m] away from all taken areas."""
    room = (zone.size_m[0] - size_m[0], zone.size_m[1] - size_m[1])
    if min(room) < 0:
        return
    for _ in range(N_TRIES):
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
