"""Warehouses with racks, as in chapter 9.1 of the GSL-Bench thesis: rows, loads, and items in the aisles."""

import math
from collections.abc import Sequence

import numpy as np

from gslcosim.base.rng import stream
from gslcosim.environment.layouts.pieces import (
    GOODS_RGBA,
    SHELF_RGBA,
    STEEL_RGBA,
    VEHICLE_RGBA,
    WOOD_RGBA,
    Area,
    Rgba,
    bounding_area,
    box_above,
    free_places,
    rotated_corners,
    split_into_strips,
)
from gslcosim.environment.model import Box
from gslcosim.scenario.models.layouts import ComplexWarehouseSpec, OpeningSpec, SimpleWarehouseSpec

Racks = SimpleWarehouseSpec | ComplexWarehouseSpec

# What the thesis adds to the wider opening for the aisle between the ends of rows and the wall [m].
END_AISLE_EXTRA_M = 2.0
POST_M, SHELF_M = 0.1, 0.1
# How high each of four bays (lower near, lower far, upper near, upper far) is filled, as a share of the space below
# the next shelf. Seven loads, as many as the thesis has filled racks; the shares are chosen.
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
# Free width kept between items, and before openings.
ITEM_GAP_M, OPENING_GAP_M = 0.6, 1.5


def build_racks(layout: Racks, openings: Sequence[OpeningSpec]) -> tuple[Box, ...]:
    """Return all racks of a warehouse, those of a column `rack_i_j_k`: row, place in the row, storey."""
    places = rack_areas(layout, openings)
    n_storeys = max(1, math.floor(layout.size_m[2] / layout.rack_size_m[2] + 1e-9))
    types = rack_types(layout, len(places) * n_storeys)
    return tuple(
        box
        for i, (name, area) in enumerate(places)
        for storey in range(n_storeys)
        for box in _rack(f"rack_{name}_{storey}", area, layout.rack_size_m[2], storey, types[i * n_storeys + storey])
    )


def rack_types(layout: Racks, n_racks: int) -> tuple[int, ...]:
    """Return the type of each rack at random: below 7 is the load, 7 and 8 are empty; enough of them are filled."""
    rng = stream(layout.seed, "layout.rack_types")
    types = rng.integers(N_TYPES, size=n_racks)
    empty = np.flatnonzero(types >= len(LOADS))
    n_missing = math.ceil(layout.filled_least_frac * n_racks - 1e-9) - (n_racks - len(empty))
    if n_missing > 0:
        chosen = rng.choice(empty, size=n_missing, replace=False)
        types[chosen] = rng.integers(len(LOADS), size=n_missing)
    return tuple(int(each) for each in types)


def rack_areas(layout: Racks, openings: Sequence[OpeningSpec]) -> tuple[tuple[str, Area], ...]:
    """Return where racks stand, each with its row and its place in it: `row_place`.

    As many rows as leave the aisles, spread evenly from wall to wall; in complex warehouses those between the outer
    two are turned and stand along x.
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
        corners, bounds = _turned_footprint(rng, kind)
        for zone in (zones[first], zones[1 - first]):
            place = next(free_places(rng, bounds.size_m, zone, taken, gap_m=ITEM_GAP_M), None)
            if place is not None:
                taken.append(place)
                shift = (place.min_m[0] - bounds.min_m[0], place.min_m[1] - bounds.min_m[1])
                moved = tuple((x + shift[0], y + shift[1]) for x, y in corners)
                boxes += _item(rng, kind, f"{kind}_{number}", moved, layout.size_m[2])
                break
    return tuple(boxes)


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
    for i, share in enumerate(load):
        level, bay = divmod(i, 2)
        bay_area = (
            _area(x0 + bay * wide_m / 2, y0, wide_m / 2, deep_m)
            if is_along_x
            else _area(x0, y0 + bay * deep_m / 2, wide_m, deep_m / 2)
        )
        low_m = bottom_m + level * height_m / 2 + SHELF_M
        if share > 0:
            boxes.append(
                box_above(f"{name}_goods_{i}", bay_area, low_m, low_m + share * (height_m / 2 - SHELF_M), GOODS_RGBA)
            )
    return boxes


def _turned_footprint(rng: np.random.Generator, kind: str) -> tuple[tuple[tuple[float, float], ...], Area]:
    if kind == "pile":
        size_m = (float(rng.uniform(*PILE_M)), float(rng.uniform(*PILE_M)))
    else:
        size_m = FORKLIFT_M if kind == "forklift" else PALLET_M
    corners = rotated_corners((0.0, 0.0), size_m, float(rng.uniform(0.0, 2 * math.pi)))
    return corners, bounding_area(corners)


def _item(
    rng: np.random.Generator, kind: str, name: str, corners: Sequence[tuple[float, float]], ceiling_m: float
) -> list[Box]:
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


def _layer(
    name: str, part: str, corners: Sequence[tuple[float, float]], bottom_m: float, top_m: float, rgba: Rgba
) -> list[Box]:
    return list(split_into_strips(f"{name}_{part}", corners, bottom_m, top_m, rgba)) if top_m > bottom_m else []


def _shrunk(corners: Sequence[tuple[float, float]], share: float) -> tuple[tuple[float, float], ...]:
    x_m, y_m = (sum(corner[i] for corner in corners) / len(corners) for i in range(2))
    return tuple((x_m + share * (x - x_m), y_m + share * (y - y_m)) for x, y in corners)


# The floor before an opening, which stays clear; one on the floor or the ceiling keeps what is under it clear.
def _before(opening: OpeningSpec) -> Area:
    (x0, y0, _), (x1, y1, _) = opening.min_m, opening.max_m
    return Area(
        min_m=(x0 - OPENING_GAP_M * (x0 == x1), y0 - OPENING_GAP_M * (y0 == y1)),
        max_m=(x1 + OPENING_GAP_M * (x0 == x1), y1 + OPENING_GAP_M * (y0 == y1)),
    )


def _area(x_m: float, y_m: float, wide_m: float, deep_m: float) -> Area:
    return Area(min_m=(x_m, y_m), max_m=(x_m + wide_m, y_m + deep_m))
