"""The plan view: what is solid where, the lines around cells, openings and arrows."""

import dataclasses

import numpy as np
import pytest

from gslcosim.environment.model import Opening
from gslcosim.environment.plan_view import (
    MAX_LENGTH_SPACINGS,
    PlanView,
    arrow_vectors,
    scale_of_arrows,
    space_arrows,
    visible_boxes,
)

CRATE = ("crate", (1.0, 1.0, 0.0), (5.0, 3.0, 2.0))


def test_a_crate_is_solid_at_its_height_and_below_a_greater_one(make_room):
    room = make_room(obstacles=[CRATE])
    low, high = PlanView.of(room, 1.0), PlanView.of(room, 3.0)
    inside = room.grid.cell_of(np.array([3.0, 2.0, 0.0]))[:2]
    assert low.solid[tuple(inside)]
    assert not low.below.any()
    assert not high.solid.any()
    np.testing.assert_array_equal(high.below, low.solid)


@pytest.mark.parametrize("height_m", [-5.0, 100.0])
def test_heights_outside_the_room_cut_its_nearest_layer(make_room, height_m):
    room = make_room()
    assert PlanView.of(room, height_m).layer == (0 if height_m < 0 else room.grid.shape[2] - 1)


@pytest.mark.parametrize("bits", [0, 1, 0b1001, 0xFFFFF, 0x5A5A5, 0x0F3C9, 0x86420])
def test_the_border_of_cells_is_as_long_as_their_free_sides(make_room, bits):
    plan = PlanView.of(make_room(), 1.0)
    cells = np.zeros(plan.solid.shape, dtype=bool)
    cells[:5, :4] = np.array([bits >> i & 1 for i in range(20)], dtype=bool).reshape(5, 4)
    padded = np.pad(cells, 1)
    n_sides = sum(int((np.diff(padded, axis=axis)).sum()) for axis in (0, 1))
    lines_m = plan.outline_m(cells)
    lengths_m = np.abs(np.diff(lines_m, axis=1)).sum()
    assert lengths_m == pytest.approx(n_sides * plan.grid.cell_m)
    assert np.all((lines_m[:, 0] == lines_m[:, 1]).sum(axis=1) == 1), "straight along x or y"


def test_the_border_of_a_block_is_its_four_sides(make_room):
    room = make_room(obstacles=[CRATE])
    plan = PlanView.of(room, 1.0)
    lines_m = plan.outline_m(plan.solid)
    assert {tuple(sorted(map(tuple, line.round(6).tolist()))) for line in lines_m} == {
        ((1.0, 1.0), (1.0, 3.0)), ((5.0, 1.0), (5.0, 3.0)), ((1.0, 1.0), (5.0, 1.0)), ((1.0, 3.0), (5.0, 3.0)),
    }  # fmt: skip


def seen_opening(make_room, min_m, max_m):
    room = make_room()
    opening = Opening(name="vent", kind="inlet", min_m=min_m, max_m=max_m)
    (seen,) = PlanView.of(dataclasses.replace(room, openings=(opening,)), 1.0).openings
    return seen, room.grid.max_m


def test_an_opening_at_a_side_is_a_line_and_looks_into_the_room(make_room):
    _, (x_m, y_m, _) = seen_opening(make_room, (0.0, 0.0, 0.0), (0.0, 1.0, 1.0))
    for low, high, inward in (
        ((0.0, 1.0, 0.0), (0.0, 2.0, 1.0), (1.0, 0.0)),
        ((x_m, 1.0, 0.0), (x_m, 2.0, 1.0), (-1.0, 0.0)),
        ((1.0, 0.0, 0.0), (2.0, 0.0, 1.0), (0.0, 1.0)),
        ((1.0, y_m, 0.0), (2.0, y_m, 1.0), (0.0, -1.0)),
    ):
        seen, _ = seen_opening(make_room, low, high)
        assert (seen.is_at_side, seen.inward) == (True, inward)
        assert seen.path_m() == [low[:2], high[:2]]


def test_an_opening_in_the_ceiling_is_a_rectangle(make_room):
    """Its diagonal would look like a wall across the room."""
    seen, _ = seen_opening(make_room, (1.0, 1.0, 5.0), (3.0, 2.0, 5.0))
    assert not seen.is_at_side
    assert seen.path_m() == [(1.0, 1.0), (3.0, 1.0), (3.0, 2.0), (1.0, 2.0), (1.0, 1.0)]


def test_walls_around_the_room_are_not_to_be_seen_in_it(make_room):
    room = make_room(obstacles=[CRATE])
    assert [box.name for box in visible_boxes(room)] == ["crate"]


def test_arrows_stand_in_air_and_go_with_the_speed(make_room):
    plan = PlanView.of(make_room(obstacles=[CRATE]), 1.0)
    cells, spacing = space_arrows(~plan.solid, 15)
    assert not plan.solid[cells[:, 0], cells[:, 1]].any()
    assert max(plan.solid.shape) / spacing == pytest.approx(15, abs=1)
    winds_m_s = np.array([[1.0, 0.0], [0.0, 0.5], [0.0, 0.0], [30.0, 40.0]])
    scale = scale_of_arrows(np.linalg.norm(winds_m_s[:3], axis=-1), spacing_m=2.0)
    arrows_m = arrow_vectors(winds_m_s, 2.0, scale)
    np.testing.assert_allclose(np.linalg.norm(arrows_m[1]), 0.5 * np.linalg.norm(arrows_m[0]))
    np.testing.assert_allclose(np.linalg.norm(arrows_m[3]), MAX_LENGTH_SPACINGS * 2.0)
    assert not arrows_m[2].any()
    assert scale_of_arrows(np.zeros(4), 2.0) == 0.0
