import itertools
import math

import pytest

from gslcosim_search.random_stream import RandomStream
from gslcosim_search.reactive.spirals import (
    ArchimedeanSpiral,
    CloverleafPath,
    SpiralPath,
    SquareSpiral,
    arc_turn_rad,
    random_side,
    spiral_angle_rad,
    spiral_length_m,
    spiral_radius_m,
)

GAP_M = 0.6


def spiral(*, arc_m=0.1, start_rad=0.0, side=1):
    return ArchimedeanSpiral(gap_m=GAP_M, arc_m=arc_m, start_rad=start_rad, side=side)


def polar(places_m):
    return [(math.hypot(x, y), math.atan2(y, x)) for x, y in places_m]


@pytest.mark.parametrize("angle_rad", [0.0, 1.0, 7.5, 40.0])
def test_neighbouring_turns_are_a_gap_apart(angle_rad):
    inner_m, outer_m = (spiral_radius_m(GAP_M, angle_rad + turn) for turn in (0.0, 2 * math.pi))
    assert outer_m - inner_m == pytest.approx(GAP_M)


@pytest.mark.parametrize("angle_rad", [0.5, 3.0, 20.0])
def test_the_length_is_that_of_a_fine_polygon(angle_rad):
    angles = [angle_rad * i / 20_000 for i in range(20_001)]
    corners = [(GAP_M * a / math.tau * math.cos(a), GAP_M * a / math.tau * math.sin(a)) for a in angles]
    assert spiral_length_m(GAP_M, angle_rad) == pytest.approx(
        math.fsum(math.dist(a, b) for a, b in itertools.pairwise(corners)), rel=1e-6
    )


@pytest.mark.parametrize("angle_rad", [0.0, 0.5, 3.0, 20.0])
def test_the_turn_over_a_short_arc_is_the_slope_of_the_length(angle_rad):
    short_rad = 1e-6
    arc_m = spiral_length_m(GAP_M, angle_rad + short_rad) - spiral_length_m(GAP_M, angle_rad)
    assert arc_turn_rad(GAP_M, spiral_radius_m(GAP_M, angle_rad), arc_m) == pytest.approx(short_rad, rel=1e-5)


@pytest.mark.parametrize("length_m", [0.0, 1e-9, 0.05, 0.5, 3.0, 100.0, 1e6])
def test_the_angle_inverts_the_length(length_m):
    assert spiral_length_m(GAP_M, spiral_angle_rad(GAP_M, length_m)) == pytest.approx(length_m, rel=1e-9, abs=1e-15)


def test_places_of_a_spiral_are_equal_arcs_apart_and_go_outwards():
    flown = spiral(arc_m=0.5)
    places = polar(flown.next_offset_m() for _ in range(60))
    lengths_m = [spiral_length_m(GAP_M, math.tau * radius_m / GAP_M) for radius_m, _ in places]
    assert lengths_m == pytest.approx([0.5 * n for n in range(1, 61)], rel=1e-9)
    assert flown.radius_m == pytest.approx(places[-1][0])


def test_a_spiral_to_the_right_mirrors_one_to_the_left():
    left, right = spiral(side=1), spiral(side=-1)
    for _ in range(30):
        (x_left, y_left), (x_right, y_right) = left.next_offset_m(), right.next_offset_m()
        assert (x_right, y_right) == (x_left, -y_left)


def square(**changes):
    return SquareSpiral(**{"side_m": 1.0, "growth_m": 0.4, "heading_rad": 0.0, "side": 1} | changes)


def test_a_square_spiral_turns_at_right_angles_and_grows_every_second_leg():
    corners = [(0.0, 0.0)]
    flown = square()
    corners += [flown.next_offset_m() for _ in range(6)]
    legs = [(b[0] - a[0], b[1] - a[1]) for a, b in itertools.pairwise(corners)]
    assert [math.hypot(*leg) for leg in legs] == pytest.approx([1.0, 1.0, 1.4, 1.4, 1.8, 1.8])
    turns = [math.remainder(math.atan2(*b[::-1]) - math.atan2(*a[::-1]), math.tau) for a, b in itertools.pairwise(legs)]
    assert turns == pytest.approx([math.pi / 2] * 5)


def spiral_path(is_free, n_skips=3, **changes):
    return SpiralPath(square(**changes), (3.0, 4.0), is_free=is_free, n_skips=n_skips)


def test_blocked_corners_are_left_out_and_the_spiral_goes_on_behind_them():
    open_path = spiral_path(lambda place: True)
    corners = [open_path.next_place_m() for _ in range(5)]
    flown = spiral_path(lambda place: place not in corners[:3])
    assert [flown.next_place_m(), flown.next_place_m()] == corners[3:]
    assert not flown.is_blocked


def test_a_spiral_is_over_after_more_blocked_corners_than_it_may_leave_out():
    asked = []
    flown = spiral_path(lambda place: asked.append(place) is not None)
    assert flown.next_place_m() is None
    assert flown.is_blocked
    assert len(asked) == 4


def test_a_spiral_is_over_after_its_sides_or_at_its_reach():
    flown = spiral_path(lambda place: True, n_sides=3)
    assert [flown.next_place_m() is None for _ in range(5)] == [False, False, False, True, True]
    assert not flown.is_blocked
    wide = ArchimedeanSpiral(gap_m=GAP_M, arc_m=0.1, start_rad=0.0, side=1, reach_m=1.0)
    radii_m = [math.hypot(*place) for place in iter(wide.next_offset_m, None)]
    assert radii_m[-2] < 1.0 <= radii_m[-1] < 1.0 + 0.1


def test_sides_are_drawn_left_and_right_alike():
    draws = RandomStream(3)
    sides = [random_side(draws) for _ in range(1000)]
    assert set(sides) == {1, -1}
    assert abs(sum(sides)) < 120


def places(*, radius_m=1.0, upwind_rad=0.5, side=1, n_per_leaf=4):
    clover = CloverleafPath(
        centre_m=(3.0, 4.0), radius_m=radius_m, upwind_rad=upwind_rad, side=side, n_per_leaf=n_per_leaf
    )
    found = []
    while (place := clover.next_place_m()) is not None:
        found.append((place[0] - 3.0, place[1] - 4.0))
    return found


def test_each_leaf_reaches_out_by_the_radius_and_ends_at_the_centre():
    found = places(n_per_leaf=4)
    assert len(found) == 16
    for i in range(4):
        leaf = found[4 * i : 4 * i + 4]
        assert max(math.hypot(*place) for place in leaf) == pytest.approx(1.0)
        assert leaf[-1] == pytest.approx((0.0, 0.0), abs=1e-12)


@pytest.mark.parametrize("side", [1, -1])
def test_leaves_lie_upwind_to_one_side_to_the_other_and_downwind(side):
    tips = places(side=side)[1::4]
    turned = [math.remainder(math.atan2(y, x) - 0.5, math.tau) for x, y in tips]
    assert turned[:3] == pytest.approx([0.0, side * math.pi / 2, -side * math.pi / 2])
    assert abs(turned[3]) == pytest.approx(math.pi)
