"""Layouts: walls, openings and obstacles of a room, and everything that can be wrong with them."""

import pytest

from gslcosim.base.errors import ScenarioError
from gslcosim.environment.layouts.layouts import build_layout, find_room_problems
from gslcosim.environment.model import WALL_NAMES
from gslcosim.scenario.models.scenario import BoxSpec, LayoutSpec, OpeningSpec, WindSpec

UNIFORM = WindSpec(solver="uniform")


def opening(min_m, max_m):
    return OpeningSpec(min_m=min_m, max_m=max_m)


def box(name, min_m=(5.0, 3.0, 0.0), max_m=(6.0, 4.0, 2.0)):
    return BoxSpec(name=name, min_m=min_m, max_m=max_m)


SHELF = box("shelf", (1.0, 3.0, 0.0), (2.0, 4.0, 2.0))


@pytest.mark.parametrize(
    ("layout", "wind", "problem"),
    [
        ({"size_m": (15.0, 15.1, 8.0)}, {},
         "layout.size_m[1]: expected a whole number of the 0.2 m cells of wind.cell_m, was 15.1 m, "
         "which is 75.5 cells. Nearest: 15 m or 15.2 m; or wind.cell_m 0.1."),
        ({"size_m": (15.0, 15.001, 8.0)}, {}, "Nearest: 15 m or 15.2 m."),
        ({"size_m": (15.0, 15.0, 0.05)}, {}, "layout.size_m[2]: "),
        ({"size_m": (1e3, 1e3, 100.0)}, {"cell_m": 0.01},
         "wind.cell_m: expected cells that divide the room into at most 2e+08, was 0.01 m, which makes 1e+14. "),
        ({"outlet": opening((14.0, 1.0, 0.0), (14.0, 2.0, 2.0))}, {}, "was [14, 1, 0] to [14, 2, 2] m"),
        ({"inlet": opening((0.0, 14.0, 0.0), (0.0, 16.0, 2.0))}, {},
         "layout.inlet: expected y inside the face, from 0 to 15 m, was 14 to 16 m"),
        ({"inlet": opening((15.0, 13.0, 0.0), (15.0, 14.0, 2.0))}, {"solver": "uniform"}, "which overlap"),
        ({}, {"inlet_velocity_m_s": (-1.0, 0.0, 0.0)}, "wind.inlet_velocity_m_s: expected a wind that enters the room "
         "through the inlet on x_min, with a part along +x"),
        ({}, {"inlet_velocity_m_s": (0.0, 1.0, 0.0)}, "wind.inlet_velocity_m_s: "),
        ({"obstacles": (box("shelf", (14.0, 3.0, 0.0), (16.0, 4.0, 2.0)),)}, {},
         "was 14 to 16 m. Cut it to 14 to 15 m."),
        ({"obstacles": (SHELF, box("floor"))}, {}, "layout.obstacles[1].name: "),
        ({"obstacles": (SHELF, box("shelf"))}, {}, "was shelf"),
    ],
)  # fmt: skip
def test_what_cannot_be_built_is_refused_with_its_place_and_a_remedy(layout, wind, problem):
    (found,) = find_room_problems(LayoutSpec(**layout), WindSpec(**wind))
    assert problem in str(found)


def test_walls_close_the_box_of_air_on_all_sides_without_reaching_into_it():
    plan = build_layout(LayoutSpec(size_m=(6.0, 5.0, 3.0), wall_m=0.25), UNIFORM)
    assert tuple(box.name for box in plan.boxes) == WALL_NAMES
    outer = {"min": (-0.25, -0.25, -0.25), "max": (6.25, 5.25, 3.25)}
    assert tuple(min(box.min_m[axis] for box in plan.boxes) for axis in range(3)) == outer["min"]
    assert tuple(max(box.max_m[axis] for box in plan.boxes) for axis in range(3)) == outer["max"]
    for box in plan.boxes:
        inside = [min(box.max_m[a], plan.grid.max_m[a]) - max(box.min_m[a], 0.0) for a in range(3)]
        assert min(inside) <= 0.0
    volume_m3 = sum(
        (b.max_m[0] - b.min_m[0]) * (b.max_m[1] - b.min_m[1]) * (b.max_m[2] - b.min_m[2]) for b in plan.boxes
    )
    # Boxes do not overlap: together they are the outer box less the air.
    assert volume_m3 == pytest.approx(6.5 * 5.5 * 3.5 - 6.0 * 5.0 * 3.0)


def test_the_thesis_room_has_its_openings_in_opposite_corners_in_whole_cells():
    plan = build_layout(LayoutSpec(), WindSpec())
    inlet, outlet = plan.openings
    assert (inlet.kind, inlet.min_m, inlet.max_m) == ("inlet", (0.0, 0.0, 0.0), (0.0, 1.6, 2.4))
    assert inlet.velocity_m_s == (1.0, 0.0, 0.0)
    assert (outlet.kind, outlet.min_m, outlet.max_m) == ("outlet", (15.0, 13.4, 0.0), (15.0, 15.0, 2.4))
    assert [notice.split(" is taken as ")[1] for notice in plan.notices] == [
        "[0, 0, 0] to [0, 1.6, 2.4] m, which is whole cells of 0.2 m.",
        "[15, 13.4, 0] to [15, 15, 2.4] m, which is whole cells of 0.2 m.",
    ]


def test_openings_of_whole_cells_stay_and_are_not_mentioned():
    layout = LayoutSpec(
        inlet=opening((0.0, 0.4, 0.2), (0.0, 1.4, 2.0)), outlet=opening((3.0, 2.0, 8.0), (5.0, 4.0, 8.0))
    )
    plan = build_layout(layout, WindSpec())
    assert [(o.min_m, o.max_m) for o in plan.openings] == [
        ((0.0, 0.4, 0.2), (0.0, 1.4, 2.0)),
        ((3.0, 2.0, 8.0), (5.0, 4.0, 8.0)),
    ]
    assert plan.notices == ()


def test_an_opening_smaller_than_a_cell_becomes_one_cell():
    plan = build_layout(LayoutSpec(inlet=opening((0.0, 1.04, 1.01), (0.0, 1.06, 1.05))), WindSpec())
    assert plan.openings[0].min_m == pytest.approx((0.0, 1.0, 1.0))
    assert plan.openings[0].max_m == pytest.approx((0.0, 1.2, 1.2))


def test_openings_that_share_an_edge_are_allowed():
    layout = LayoutSpec(
        inlet=opening((0.0, 0.0, 0.0), (0.0, 2.0, 2.0)), outlet=opening((0.0, 2.0, 0.0), (0.0, 4.0, 2.0))
    )
    assert find_room_problems(layout, WindSpec()) == []


def test_still_air_and_uniform_wind_may_have_any_direction():
    assert find_room_problems(LayoutSpec(), WindSpec(inlet_velocity_m_s=(0.0, 0.0, 0.0))) == []
    assert find_room_problems(LayoutSpec(), WindSpec(solver="uniform", inlet_velocity_m_s=(-1.0, 0.0, 0.0))) == []


def test_all_problems_come_in_one_error():
    floor = box("floor", (-1.0, 3.0, 0.0), (2.0, 4.0, 20.0))
    with pytest.raises(ScenarioError) as error:
        build_layout(LayoutSpec(size_m=(15.1, 15.0, 8.0), obstacles=(floor,)), WindSpec())
    assert len(str(error.value).splitlines()) == 4
