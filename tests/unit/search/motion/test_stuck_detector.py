import math

import pytest

from gslcosim.search.motion.stuck_detector import StuckDetector


def circle(radius_m, n=20):
    return [
        (5 + radius_m * math.cos(math.tau * i / n), 5 + radius_m * math.sin(math.tau * i / n), 2.0) for i in range(n)
    ]


@pytest.mark.parametrize(("radius_m", "is_wound_up"), [(0.0, True), (1.9, True), (2.1, False)])
def test_a_leash_winds_up_where_the_legs_go_round_a_small_circle(radius_m, is_wound_up):
    leash = StuckDetector(n_legs=20, radius_m=2.0)
    for place in circle(radius_m):
        assert not leash.is_stuck
        leash.note(place)
    assert leash.is_stuck is is_wound_up


def test_old_legs_are_forgotten():
    leash = StuckDetector(n_legs=5, radius_m=1.0)
    leash.note((100.0, 100.0))
    for _ in range(5):
        leash.note((3.0, 3.0))
    assert leash.is_stuck


def test_a_released_leash_needs_as_many_legs_again():
    leash = StuckDetector(n_legs=3, radius_m=1.0)
    for _ in range(3):
        leash.note((3.0, 3.0))
    leash.release()
    leash.note((3.0, 3.0))
    assert not leash.is_stuck


def test_a_leash_of_no_legs_never_winds_up():
    leash = StuckDetector(n_legs=0, radius_m=1.0)
    for _ in range(30):
        leash.note((3.0, 3.0))
    assert not leash.is_stuck
