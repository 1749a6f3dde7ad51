import itertools
import math

import pytest

from gslcosim_search.reactive.spirals import CloverleafPath


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


def test_a_leaf_is_as_long_as_a_leaf_of_a_rose():
    """The length of one leaf of r = cos(2 phi) is the integral of sqrt(r^2 + (dr/dphi)^2) over a quarter turn."""
    fine = [(0.0, 0.0), *places(n_per_leaf=2000)[:2000]]
    assert math.fsum(math.dist(a, b) for a, b in itertools.pairwise(fine)) == pytest.approx(2.4221, abs=1e-3)
