import math

import pytest

from gslcosim_search.motion.legs import StuckDetector


def circle(radius_m, n=20):
    return [
        (5 + radius_m * math.cos(math.tau * i / n), 5 + radius_m * math.sin(math.tau * i / n), 2.0) for i in range(n)
    ]


@pytest.mark.parametrize(("radius_m", "is_wound_up"), [(0.0, True), (1.9, True), (2.1, False)])
def test_legs_round_a_small_circle_count_as_stuck(radius_m, is_wound_up):
    detector = StuckDetector(n_legs=20, radius_m=2.0)
    for place in circle(radius_m):
        assert not detector.is_stuck
        detector.note(place)
    assert detector.is_stuck is is_wound_up


def test_old_legs_are_forgotten():
    detector = StuckDetector(n_legs=5, radius_m=1.0)
    detector.note((100.0, 100.0))
    for _ in range(5):
        detector.note((3.0, 3.0))
    assert detector.is_stuck


def test_a_reset_detector_needs_as_many_legs_again():
    detector = StuckDetector(n_legs=3, radius_m=1.0)
    for _ in range(3):
        detector.note((3.0, 3.0))
    detector.release()
    detector.note((3.0, 3.0))
    assert not detector.is_stuck


def test_a_detector_of_no_legs_is_never_stuck():
    detector = StuckDetector(n_legs=0, radius_m=1.0)
    for _ in range(30):
        detector.note((3.0, 3.0))
    assert not detector.is_stuck
