"""Outdoor layouts: plants with tanks and buildings, and wind tunnels."""

import math

from gslcosim.base.quantities import Vec3
from gslcosim.base.rng import stream
from gslcosim.environment.grid import Grid
from gslcosim.environment.layouts.pieces import (
    CONCRETE_RGBA,
    STEEL_RGBA,
    TANK_RGBA,
    Area,
    box_above,
    circle_corners,
    free_places,
    split_into_strips,
)
from gslcosim.environment.model import Box, Opening
from gslcosim.scenario.models.layouts import OpeningSpec, PlantSpec, WindTunnelSpec

# Chosen: a small storage tank, a shed; width kept between them and to the boundary.
TANK_RADIUS_M, TANK_HEIGHT_M = (1.2, 2.4), (3.0, 6.0)
BUILDING_SIDE_M, BUILDING_HEIGHT_M = (4.0, 8.0), (2.5, 5.0)
PLANT_GAP_M = 2.0


def build_plant(layout: PlantSpec) -> tuple[Box, ...]:
    """Return the buildings and tanks of a plant; those for which there is no place are left out."""
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
    """Return the blocks of a wind tunnel, in a row along its middle line."""
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


def whole_face(size_m: Vec3, axis: int, *, is_upper: bool) -> OpeningSpec:
    """Return an opening as large as one face of the room; `axis` 0, 1, 2 is x, y, z."""
    low, high = [0.0, 0.0, 0.0], [*size_m]
    (low if is_upper else high)[axis] = size_m[axis] if is_upper else 0.0
    return OpeningSpec(min_m=(low[0], low[1], low[2]), max_m=(high[0], high[1], high[2]))


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
    scale = math.log((layout.reference_height_m + z0) / z0)
    layers: list[Opening] = []
    for k in range(low, high):
        share = math.log(((k + 0.5) * grid.cell_m + z0) / z0) / scale
        bottom_m, top_m = (round(grid.origin_m[2] + i * grid.cell_m, 9) for i in (k, k + 1))
        u_m_s, v_m_s, w_m_s = inlet.velocity_m_s
        layers.append(
            Opening(
                name=f"{inlet.name}_{k}",
                kind="inlet",
                min_m=(inlet.min_m[0], inlet.min_m[1], bottom_m),
                max_m=(inlet.max_m[0], inlet.max_m[1], top_m),
                velocity_m_s=(u_m_s * share, v_m_s * share, w_m_s * share),
            )
        )
    return tuple(layers)
