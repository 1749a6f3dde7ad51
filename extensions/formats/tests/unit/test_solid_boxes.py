"""Boxes from solid cells: they hold exactly the solid cells, once each."""

import numpy as np

from gslcosim.environment.model import Grid
from gslcosim.environment.openings import voxelize
from gslcosim_formats.solid_boxes import boxes_from_solid

GRID = Grid(origin_m=(-1.0, 2.0, 0.5), cell_m=0.2, shape=(9, 7, 5))


def n_cells(box):
    return np.prod([round((high - low) / 0.2) for low, high in zip(box.min_m, box.max_m, strict=True)])


def test_boxes_hold_exactly_the_solid_cells_without_overlap():
    rng = np.random.default_rng(7)
    for share in (0.0, 0.05, 0.5, 0.95, 1.0):
        is_solid = rng.random(GRID.shape) < share
        boxes = boxes_from_solid(is_solid, GRID)
        assert (voxelize(boxes, GRID) == is_solid).all()
        assert sum(map(n_cells, boxes)) == is_solid.sum()
        assert len({box.name for box in boxes}) == len(boxes)


def test_a_straight_block_is_one_box():
    is_solid = np.zeros(GRID.shape, dtype=bool)
    is_solid[2:6, 1:4, 0:5] = True
    (box,) = boxes_from_solid(is_solid, GRID)
    assert (box.min_m, box.max_m) == ((-0.6, 2.2, 0.5), (0.2, 2.8, 1.5))
