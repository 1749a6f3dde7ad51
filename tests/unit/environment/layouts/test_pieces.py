"""Pieces: strips stand for what they replace, walls are whole but for their gaps, places keep apart."""

import math
from itertools import pairwise

import numpy as np
import pytest

from gslcosim.environment.layouts.families import (
    Area,
    circle_corners,
    free_places,
    rotated_corners,
    split_into_strips,
    wall_with_gaps,
)


def area_of(boxes):
    return sum((box.max_m[0] - box.min_m[0]) * (box.max_m[1] - box.min_m[1]) for box in boxes)


@pytest.mark.parametrize("angle_rad", [0.0, 0.3, math.pi / 4, 1.2, math.pi / 2])
def test_strips_of_a_turned_rectangle_have_its_area_and_leave_no_gap(angle_rad):
    boxes = split_into_strips(
        "pile", rotated_corners((3.0, 2.0), (2.4, 1.2), angle_rad), 0.0, 1.0, (1.0, 1.0, 1.0, 1.0)
    )
    assert area_of(boxes) == pytest.approx(2.4 * 1.2, rel=0.03)
    assert all(a.max_m[0] == pytest.approx(b.min_m[0]) for a, b in pairwise(boxes))
    assert len({box.name for box in boxes}) == len(boxes)


def test_strips_of_a_circle_have_its_area():
    boxes = split_into_strips("tank", circle_corners((0.0, 0.0), 2.0), 0.0, 3.0, (1.0, 1.0, 1.0, 1.0))
    assert area_of(boxes) == pytest.approx(math.pi * 4.0, rel=0.02)


def test_a_wall_is_whole_but_for_its_doors():
    area = Area(min_m=(1.0, 0.0), max_m=(1.2, 6.0))
    boxes = wall_with_gaps("wall", area, 3.0, [(1.0, 2.0), (4.0, 5.0)], 2.0)
    volume_m3 = sum(np.prod(np.subtract(box.max_m, box.min_m)) for box in boxes)
    assert volume_m3 == pytest.approx(0.2 * (6.0 * 3.0 - 2 * 1.0 * 2.0))
    assert [box.name for box in boxes] == ["wall_0", "wall_lintel_0", "wall_1", "wall_lintel_1", "wall_2"]


def test_places_keep_their_gap_to_what_is_taken():
    taken = Area(min_m=(2.0, 2.0), max_m=(3.0, 3.0))
    zone = Area(min_m=(0.0, 0.0), max_m=(5.0, 5.0))
    places = list(free_places(np.random.default_rng(1), (1.0, 0.5), zone, [taken], gap_m=0.5))
    assert places
    for place in places:
        assert place.is_apart_from(taken, 0.5)
        assert min(place.min_m) >= 0.0
        assert max(place.max_m) <= 5.0


def test_a_thing_larger_than_the_zone_has_no_place():
    zone = Area(min_m=(0.0, 0.0), max_m=(1.0, 5.0))
    assert list(free_places(np.random.default_rng(1), (2.0, 1.0), zone, [], gap_m=0.0)) == []
