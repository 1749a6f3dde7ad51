"""Occupancy: voxel rule, sealed pockets, outlets, and rooms that no air can pass."""

import numpy as np
import pytest

from gslcosim.environment.grid_kernels import reachable_cells
from gslcosim.environment.layouts.layouts import build_layout, find_room_problems
from gslcosim.environment.model import Box, Cell, Grid
from gslcosim.environment.openings import voxelize
from gslcosim.scenario.models.scenario import BoxSpec, LayoutSpec, WindSpec

GRID = Grid(origin_m=(0.0, 0.0, 0.0), cell_m=0.5, shape=(8, 6, 4))


def solid_cells(min_m, max_m):
    box = Box(name="box", kind="obstacle", min_m=min_m, max_m=max_m)
    return [tuple(map(int, cell)) for cell in np.argwhere(voxelize([box], GRID))]


def layout(*obstacles, size_m=(4.0, 3.0, 2.0)):
    specs = tuple(BoxSpec(name=f"box_{i}", min_m=low, max_m=high) for i, (low, high) in enumerate(obstacles))
    return LayoutSpec(size_m=size_m, obstacles=specs)


def room(*obstacles, size_m=(4.0, 3.0, 2.0), cell_m=0.2):
    return build_layout(layout(*obstacles, size_m=size_m), WindSpec(cell_m=cell_m))


def test_a_cell_is_solid_when_its_centre_lies_in_a_box():
    rng = np.random.default_rng(8)
    centres = GRID.centres_m()
    for _ in range(100):
        low = rng.random(3) * (3.0, 2.0, 1.0)
        high = low + 0.5 + rng.random(3)
        box = Box(name="box", kind="obstacle", min_m=tuple(low), max_m=tuple(high))
        assert (voxelize([box], GRID) == ((centres >= low) & (centres < high)).all(axis=-1)).all()


def test_a_plate_thinner_than_a_cell_still_takes_one_cell():
    assert solid_cells((1.05, 0.5, 0.0), (1.1, 1.0, 0.5)) == [(2, 1, 0)]
    assert solid_cells((1.45, 0.5, 0.0), (1.53, 1.0, 0.5)) == [(2, 1, 0)]


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_boxes_that_only_touch_the_grid_from_outside_take_no_cell(axis):
    low, high = [0.0, 0.0, 0.0], list(GRID.max_m)
    low[axis], high[axis] = -0.01, 0.0
    assert solid_cells(tuple(low), tuple(high)) == []
    low[axis], high[axis] = GRID.max_m[axis], GRID.max_m[axis] + 0.01
    assert solid_cells(tuple(low), tuple(high)) == []


def test_the_cells_that_touch_the_outlet_are_marked_one_layer_deep():
    plan = room()
    outlet = plan.openings[1]
    # 1.2 of 3 m wide, 1.2 of 2 m high, in cells of 0.2 m.
    assert outlet.min_m == pytest.approx((4.0, 1.8, 0.0))
    expected = np.zeros(plan.grid.shape, dtype=bool)
    expected[-1, 9:, :6] = True
    assert ((plan.occupancy == Cell.OUTLET) == expected).all()


def test_solid_cells_in_front_of_an_outlet_stay_solid():
    plan = room(((3.0, 2.6, 0.0), (4.0, 3.0, 1.0)))
    layer = plan.occupancy[-1]
    assert (layer[13:, :5] == Cell.SOLID).all()
    assert (layer[9:13, :6] == Cell.OUTLET).all()


def test_air_that_no_opening_reaches_becomes_solid():
    plates = [
        ((1.0, 1.0, 0.0), (2.0, 1.2, 1.2)), ((1.0, 1.8, 0.0), (2.0, 2.0, 1.2)),
        ((1.0, 1.2, 0.0), (1.2, 1.8, 1.2)), ((1.8, 1.2, 0.0), (2.0, 1.8, 1.2)),
    ]  # fmt: skip
    lid = ((1.0, 1.0, 1.0), (2.0, 2.0, 1.2))
    open_box, closed_box = room(*plates).occupancy, room(*plates, lid).occupancy
    assert (open_box[6:9, 6:9, :6] == Cell.FREE).all()
    assert (closed_box[5:10, 5:10, :6] == Cell.SOLID).all()
    assert (closed_box == Cell.SOLID).sum() == 5 * 5 * 6


def test_flood_fill_passes_faces_and_not_edges():
    is_open = np.zeros((3, 4, 5), dtype=bool)
    is_open[0, 0, 0] = is_open[0, 0, 1] = is_open[0, 1, 1] = is_open[1, 2, 1] = is_open[2, 3, 4] = True
    is_reached = reachable_cells(is_open, np.array([[0, 0, 0]]))
    assert [tuple(map(int, c)) for c in np.argwhere(is_reached)] == [(0, 0, 0), (0, 0, 1), (0, 1, 1)]


def test_flood_fill_from_a_solid_seed_reaches_nothing():
    assert not reachable_cells(np.zeros((2, 3, 4), dtype=bool), np.array([[1, 1, 1]])).any()


@pytest.mark.parametrize(
    ("obstacle", "problem"),
    [
        (((0.0, 0.0, 0.0), (0.2, 2.0, 2.0)), "inlet"),
        (((2.0, 0.0, 0.0), (2.05, 3.0, 2.0)), "the inlet's part has 1500 of 2850 free cells"),
    ],
    ids=["in front of the inlet", "across the room"],
)
def test_an_obstacle_that_stops_the_air_is_refused(obstacle, problem):
    (found,) = find_room_problems(layout(obstacle), WindSpec(cell_m=0.2))
    assert found.where == "environment.layout.obstacles"
    assert problem in str(found)


def test_a_gap_of_one_cell_lets_the_air_through():
    assert find_room_problems(layout(((2.0, 0.0, 0.0), (2.05, 2.8, 2.0))), WindSpec(cell_m=0.2)) == []
