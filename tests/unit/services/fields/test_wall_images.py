"""Images at walls: the gas that a wall cuts off a filament is in the room, and not behind outlets."""

import numpy as np
import pytest
from built_gas import build_filaments
from built_rooms import build_air

from gslcosim.environment.model import Cell
from gslcosim_services.fields.mixing_ratio import (
    Walls,
    mixing_ratio_and_size_at,
    mixing_ratio_ppm_at,
    strength_ppm_m3,
)
from gslcosim_services.fields.wall_images import (
    NO_WALL,
    WallImages,
    add_imaged_filaments_at_points_inplace,
    count_cells_to_walls,
)

SIGMA_M = 0.3
# Of a filament of 0.1 m that has 10 ppm at this size.
RELEASED_PPM = 270.0
ORIGIN_M = (1.0, -2.0, 0.5)


@pytest.fixture
def room():
    """A closed box of 5 x 4 x 3 m."""
    return build_air(origin_m=ORIGIN_M)


def filament_at(offset_m):
    return build_filaments(np.add([ORIGIN_M], [offset_m]), [SIGMA_M], ppm=[RELEASED_PPM])


def imaged_ppm(points_m, filament, images, *, walls):
    add = add_imaged_filaments_at_points_inplace
    return mixing_ratio_and_size_at(points_m, filament, walls=walls, cutoff_sigma=5.0, add=add, surroundings=images)[0]


def gas_in(room, filament, images):
    """Gas in the room over that of the filament: the sum over points 0.1 m apart."""
    axes_m = [np.arange(0.05, side, 0.1) + low for side, low in zip((5, 4, 3), ORIGIN_M, strict=True)]
    points_m = np.stack(np.meshgrid(*axes_m, indexing="ij"), axis=-1).reshape(-1, 3)
    walls = Walls.of(room)
    if images is None:
        ppm = mixing_ratio_ppm_at(points_m, filament, walls=walls, cutoff_sigma=5.0)
    else:
        ppm = imaged_ppm(points_m, filament, images, walls=walls)
    return ppm.sum() * 0.1**3 / strength_ppm_m3(filament.amount_mol)[0]


@pytest.mark.parametrize("offset_m", [(0.1, 2.0, 1.5), (0.1, 3.9, 1.5), (4.8, 0.2, 2.9), (2.5, 2.0, 0.01)])
def test_gas_at_walls_edges_and_corners_is_kept(room, offset_m):
    filament = filament_at(offset_m)
    assert gas_in(room, filament, None) < 0.8
    assert gas_in(room, filament, WallImages.of(room)) == pytest.approx(1.0, abs=0.01)


@pytest.mark.parametrize(("x_m", "factor"), [(2.5, 1.0), (1e-6, 2.0)], ids=["far from walls", "at a wall"])
def test_a_filament_counts_twice_at_a_wall_and_once_far_from_it(room, x_m, factor):
    filament, points_m = filament_at((x_m, 2.0, 1.5)), np.add([ORIGIN_M], [(x_m, 2.1, 1.5)])
    plain = mixing_ratio_ppm_at(points_m, filament, walls=None, cutoff_sigma=5.0)
    imaged = imaged_ppm(points_m, filament, WallImages.of(room), walls=None)
    assert imaged == pytest.approx(factor * plain, rel=1e-6)


def test_outlets_reflect_nothing():
    occupancy = np.zeros((4, 3, 3), np.uint8)
    occupancy[3] = Cell.OUTLET
    occupancy[0, 0] = Cell.SOLID
    counts = count_cells_to_walls(occupancy)
    assert counts[1, 1, 1].tolist() == [1, NO_WALL, 1, 1, 1, 1]
    assert counts[1, 0, 0].tolist() == [0, NO_WALL, 0, 2, 0, 2]
    assert counts[3, 1, 1].tolist() == [NO_WALL] * 6


def test_behind_an_obstacle_there_is_no_image_of_its_front():
    occupancy = np.zeros((20, 16, 12), np.uint8)
    occupancy[8:10, :8] = Cell.SOLID
    room = build_air(occupancy)
    filament = build_filaments([(1.9, 1.9, 1.5)], [SIGMA_M], ppm=[RELEASED_PPM])
    points_m = np.array([[2.2, 2.4, 1.5]])
    plain = mixing_ratio_ppm_at(points_m, filament, walls=Walls.of(room), cutoff_sigma=5.0)
    imaged = imaged_ppm(points_m, filament, WallImages.of(room), walls=Walls.of(room))
    assert plain > 0
    assert imaged == pytest.approx(plain, rel=1e-3)
