import math
from itertools import pairwise

import numpy as np
import pytest

from gslcosim.contract.messages import Bounds
from gslcosim_search.motion.coverage import lawnmower_path_m
from gslcosim_search.motion.legs import LegSpace


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


def test_lanes_run_along_the_longer_side():
    (ax, ay), (bx, by) = lawnmower_path_m(room((12.0, 7.0, 3.0)), 1.8, (0.0, 0.0))[:2]
    assert (ay, abs(bx - ax)) == (by, 11.0)
    (ax, ay), (bx, by) = lawnmower_path_m(room((7.0, 12.0, 3.0)), 1.8, (0.0, 0.0))[:2]
    assert (ax, abs(by - ay)) == (bx, 11.0)


def test_a_room_without_width_is_one_lane():
    assert lawnmower_path_m(room((0.8, 6.0, 2.0)), 1.8, (0.0, 0.0)) == ((0.4, 0.5), (0.4, 5.5))
