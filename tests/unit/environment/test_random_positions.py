"""Sources placed at random: in air that can be reached, away from solids, at the heights asked for."""

import numpy as np

from gslcosim.base.rng import stream
from gslcosim.environment.layouts.layouts import build_layout
from gslcosim.environment.model import Cell
from gslcosim.environment.positions import random_free_point_m
from gslcosim.scenario.models.geometry import ComplexWarehouseSpec
from gslcosim.scenario.models.scenario import BoxSpec, LayoutSpec, WindSpec


def sealed_room():
    """A room with a closed chamber in its middle, whose air becomes solid."""
    sides = {
        "west": ((2.0, 2.0, 0.0), (2.25, 4.0, 3.0)), "east": ((3.75, 2.0, 0.0), (4.0, 4.0, 3.0)),
        "south": ((2.0, 2.0, 0.0), (4.0, 2.25, 3.0)), "north": ((2.0, 3.75, 0.0), (4.0, 4.0, 3.0)),
    }  # fmt: skip
    boxes = tuple(BoxSpec(name=name, min_m=low, max_m=high) for name, (low, high) in sides.items())
    return build_layout(LayoutSpec(size_m=(6.0, 6.0, 3.0), obstacles=boxes), WindSpec(cell_m=0.25))


def test_no_source_is_put_where_no_air_gets():
    room, rng = sealed_room(), stream(1, "test.source")
    for _ in range(300):
        x_m, y_m, z_m = random_free_point_m(room, rng)
        assert not (2.0 < x_m < 4.0 and 2.0 < y_m < 4.0)
        assert 0.5 <= z_m <= 3.0


def test_places_are_a_cell_away_from_solids_and_walls():
    room = build_layout(ComplexWarehouseSpec(), WindSpec(cell_m=0.25))
    rng = stream(1, "test.source")
    for _ in range(50):
        cell = room.grid.cell_of(np.array(random_free_point_m(room, rng)))
        for axis in range(3):
            for side in (-1, 1):
                beside = cell.copy()
                beside[axis] += side
                assert bool(room.grid.contains_cell(beside))
                assert room.occupancy[tuple(beside)] != Cell.SOLID


def test_heights_that_no_air_has_are_given_up():
    room = build_layout(LayoutSpec(size_m=(6.0, 6.0, 0.5)), WindSpec(cell_m=0.125))
    assert 0.0 < random_free_point_m(room, stream(1, "test.source"))[2] < 0.5
