import itertools
import math
from itertools import pairwise

import numpy as np
import pytest

from gslcosim.contract.messages import Bounds
from gslcosim_search.motion.coverage import CoverageGrid, lawnmower_path_m
from gslcosim_search.motion.legs import LegSpace

ROOM = LegSpace(min_m=(0.5, 0.5, 0.5), max_m=(9.5, 6.5, 3.5))


def tour(squares, start_m, upwind_rad, n):
    here_m, places = start_m, []
    for _ in range(n):
        here_m = squares.next_place_m(here_m, upwind_rad)
        squares.note(here_m)
        places.append(here_m)
    return places


def test_a_tour_comes_near_to_every_place_of_the_room():
    squares = CoverageGrid(ROOM, edge_m=1.5)
    places = tour(squares, (5.0, 3.0), 0.0, squares.n_unseen)
    assert squares.n_unseen == 0
    grid = [(0.5 + 0.25 * i, 0.5 + 0.25 * j) for i in range(37) for j in range(25)]
    assert max(min(math.dist(a, b) for b in places) for a in grid) <= 1.5 / math.sqrt(2) + 1e-9


@pytest.mark.parametrize(("upwind_rad", "axis"), [(0.0, 1), (math.pi, 1), (math.pi / 2, 0), (-math.pi / 2, 0)])
def test_lanes_lie_across_the_wind(upwind_rad, axis):
    squares = CoverageGrid(ROOM, edge_m=1.5)
    places = tour(squares, (0.5, 0.5), upwind_rad, squares.n_unseen)
    steps = [(abs(b[0] - a[0]), abs(b[1] - a[1])) for a, b in itertools.pairwise(places)]
    n_across = sum(step[axis] > step[1 - axis] for step in steps)
    assert n_across > 0.7 * len(steps)


def test_what_was_passed_is_left_out_and_what_is_skipped_too():
    squares = CoverageGrid(ROOM, edge_m=1.5)
    n = squares.n_unseen
    first_m = squares.next_place_m((0.5, 0.5), 0.0)
    squares.note((first_m[0] + 0.3, first_m[1] - 0.3, 2.0))
    second_m = squares.next_place_m((0.5, 0.5), 0.0)
    assert second_m != first_m
    squares.skip(second_m)
    assert squares.next_place_m((0.5, 0.5), 0.0) not in (first_m, second_m)
    assert squares.n_unseen == n - 2


def test_when_all_is_seen_the_tour_begins_again():
    squares = CoverageGrid(ROOM, edge_m=3.0)
    n = squares.n_unseen
    tour(squares, (0.5, 0.5), None, n)
    squares.next_place_m((0.5, 0.5), None)
    assert squares.n_unseen == n


def room(size_m=(15.0, 15.0, 8.0), margin_m=0.5) -> LegSpace:
    return LegSpace.within(Bounds(min_m=(0.0, 0.0, 0.0), max_m=size_m), margin_m)


def distances_m(places_m, bends_m):
    """Distance of each place from the nearest piece of a path."""
    nearest = np.full(len(places_m), np.inf)
    for a, b in pairwise(np.array(bends_m)):
        t = np.clip((places_m - a) @ (b - a) / max((b - a) @ (b - a), 1e-12), 0.0, 1.0)
        nearest = np.minimum(nearest, np.hypot(*(places_m - a - t[:, None] * (b - a)).T))
    return nearest


@pytest.mark.parametrize("size_m", [(15.0, 15.0, 8.0), (12.0, 7.3, 3.0), (4.0, 9.9, 3.0), (1.2, 6.0, 2.0)])
def test_every_place_of_the_floor_is_near_the_path(size_m):
    bends_m = lawnmower_path_m(room(size_m), 1.8, (3.0, 3.0))
    x_m, y_m = np.meshgrid(np.linspace(0, size_m[0], 60), np.linspace(0, size_m[1], 60))
    places_m = np.stack([x_m.ravel(), y_m.ravel()], axis=1)
    assert distances_m(places_m, bends_m).max() <= math.hypot(0.9, 0.5)
    inside = room(size_m, 0.501)
    is_inside = np.array([inside.contains(place) for place in places_m])
    assert distances_m(places_m[is_inside], bends_m).max() <= 0.9 if is_inside.any() else True


@pytest.mark.parametrize(
    ("start_m", "corner_m"),
    [((3, 3), (0.5, 0.5)), ((12, 3), (14.5, 0.5)), ((12, 12), (14.5, 14.5)), ((3, 12), (0.5, 14.5))],
)
def test_it_begins_in_the_nearest_corner(start_m, corner_m):
    assert lawnmower_path_m(room(), 1.8, start_m)[0] == corner_m
