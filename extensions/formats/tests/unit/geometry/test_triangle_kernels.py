"""Triangles on a grid: cells and borders they touch, lines between centres that they cross."""

import numpy as np
import pytest

from gslcosim_formats.geometry.cell_kernels import (
    BORDER,
    TOUCHED,
    find_crossings,
    is_overlapping,
    mark_touched_inplace,
)

HALF = np.full(3, 0.5)


def points_of(corners, n=60):
    u, v = np.meshgrid(np.linspace(0, 1, n), np.linspace(0, 1, n))
    u, v = u[u + v <= 1], v[u + v <= 1]
    return corners[0] + u[:, None] * (corners[1] - corners[0]) + v[:, None] * (corners[2] - corners[0])


def test_a_triangle_overlaps_a_box_when_one_of_its_points_lies_in_it():
    rng = np.random.default_rng(3)
    n_overlapping = 0
    for _ in range(300):
        corners, half = rng.normal(scale=1.2, size=(3, 3)), rng.uniform(0.2, 0.9, size=3)
        found = is_overlapping(corners, np.zeros(3), half)
        inside = (np.abs(points_of(corners)) <= half).all(axis=1).any()
        # Samples miss the smallest overlaps only.
        grown = (np.abs(points_of(corners)) <= half + 0.15).all(axis=1).any()
        assert inside <= found <= grown
        n_overlapping += found
    assert 50 < n_overlapping < 250


@pytest.mark.parametrize("axis", range(3))
def test_a_triangle_that_only_its_normal_separates_does_not_overlap(axis):
    corners = np.eye(3)[np.roll(range(3), axis)] * 3.2
    assert is_overlapping(corners, HALF, HALF * 1.2)
    assert not is_overlapping(corners, HALF, HALF)


def test_marks_are_those_of_testing_every_cell():
    rng = np.random.default_rng(5)
    shape = (9, 7, 5)
    for _ in range(40):
        corners = rng.uniform(-2, 9, size=(1, 3, 3))
        marks = np.zeros(shape, np.uint8)
        mark_touched_inplace(marks, corners)
        expected = [is_overlapping(corners[0], np.array(cell) + 0.5, np.full(3, 0.499)) for cell in np.ndindex(shape)]
        assert ((marks & TOUCHED).reshape(-1) == expected).all()


@pytest.mark.parametrize("axis", range(3))
def test_a_surface_on_a_border_touches_the_border_and_no_cell(axis):
    a, b = (axis + 1) % 3, (axis + 2) % 3
    corners = np.zeros((2, 3, 3))
    corners[:, :, axis] = 3.0
    corners[0][:, [a, b]] = ((0, 0), (2, 0), (2, 2))
    corners[1][:, [a, b]] = ((0, 0), (2, 2), (0, 2))
    marks = np.zeros((6, 6, 6), np.uint8)
    mark_touched_inplace(marks, corners)
    expected = np.zeros((6, 6, 6), np.uint8)
    np.moveaxis(expected, (axis, a, b), (0, 1, 2))[2, :2, :2] = BORDER << axis
    assert (marks == expected).all()


def crossings_of(triangles, shape):
    shape, none = np.array(shape), np.empty(0, np.int64)
    n = find_crossings(triangles, shape, none, none, np.empty(0))
    links, owners, places = np.empty(n, np.int64), np.empty(n, np.int64), np.empty(n)
    assert find_crossings(triangles, shape, links, owners, places) == n
    return links, owners, places


def test_crossings_say_between_which_centres_and_where():
    # A plane at x = 2.6 of a grid with three side lengths, larger than the grid.
    triangle = np.array([[[2.6, -9, -9], [2.6, 30, -9], [2.6, -9, 30]]])
    links, owners, places = crossings_of(triangle, (5, 4, 3))
    i, j, k = np.unravel_index(links, (5, 4, 3))
    assert set(i) == {2}
    assert sorted(zip(j, k, strict=True)) == [(j, k) for j in range(4) for k in range(3)]
    assert set(owners) == {0}
    assert places == pytest.approx(np.full(12, 2.6))


def test_every_line_through_two_triangles_of_a_slanted_plane_is_crossed():
    def height(x, y):
        return 2.3 + 0.21 * x - 0.13 * y

    corners = [(x, y, height(x, y)) for x, y in ((-1, -1), (7, -1), (7, 7), (-1, 7))]
    triangles = np.array([[corners[0], corners[1], corners[2]], [corners[0], corners[2], corners[3]]])
    links, _, places = crossings_of(triangles, (6, 6, 6))
    along_z = links >= 2 * 216
    i, j, _ = np.unravel_index(links[along_z] - 2 * 216, (6, 6, 6))
    assert set(zip(i.tolist(), j.tolist(), strict=True)) == {(a, b) for a in range(6) for b in range(6)}
    assert places[along_z] == pytest.approx(height(i + 0.5, j + 0.5), abs=1e-3)
