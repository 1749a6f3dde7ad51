import math

import numpy as np
import pytest

from gslcosim.contract.messages import Bounds
from gslcosim_search.motion.legs import LegSpace
from gslcosim_search.random_stream import RandomStream
from gslcosim_search.reactive.random_walks import LevyWalk, RunAndTumble, power_law_length_m

ROOM = LegSpace.within(Bounds(min_m=(0.0, 0.0, 0.0), max_m=(15.0, 10.0, 8.0)), 0.3)
MIDDLE_M = (7.0, 5.0, 4.0)


def directions(walk: RunAndTumble, keeps, start_m=MIDDLE_M) -> list[float]:
    ends_m = [walk.next_end_m(start_m, keeps=keep) for keep in keeps]
    return [math.atan2(y - start_m[1], x - start_m[0]) for x, y, *_ in ends_m]


def test_a_run_keeps_its_direction_and_a_tumble_does_not():
    first, kept, drawn, again = directions(RunAndTumble(ROOM, RandomStream(1), leg_m=1.0), [False, True, False, True])
    assert kept == first
    assert drawn != first
    assert again == drawn


def test_a_run_that_meets_a_wall_draws_and_keeps_what_was_drawn():
    walk = RunAndTumble(ROOM, RandomStream(2), leg_m=1.0)
    directions(walk, [False])
    walk._direction = (0.0, None)
    (bounced,) = directions(walk, [True], (14.5, 5.0))
    assert abs(bounced) > 1.0
    assert directions(walk, [True]) == pytest.approx([bounced], abs=0.002)


def test_a_run_may_turn():
    walk = RunAndTumble(ROOM, RandomStream(1), leg_m=1.0)
    (first,) = directions(walk, [False])
    x_m, y_m = walk.next_end_m(MIDDLE_M, keeps=True, turn_rad=0.5)
    assert math.remainder(math.atan2(y_m - 5.0, x_m - 7.0) - first, math.tau) == pytest.approx(0.5, abs=0.003)


def test_legs_have_their_length_and_headings_are_uniform():
    walk = RunAndTumble(ROOM, RandomStream(3), leg_m=0.8)
    ends_m = np.array([walk.next_end_m(MIDDLE_M, keeps=False) for _ in range(2000)]) - MIDDLE_M[:2]
    assert np.hypot(*ends_m.T) == pytest.approx(0.8, abs=0.002)
    counts, _ = np.histogram(np.arctan2(*ends_m.T), bins=8, range=(-math.pi, math.pi))
    assert ((counts - 250.0) ** 2 / 250.0).sum() < 24.3  # chi squared, 7 degrees of freedom, 0.1 %


def test_a_walk_in_space_keeps_heading_and_climb_together():
    walk = RunAndTumble(ROOM, RandomStream(5), leg_m=1.0, most_climb_m=0.3)
    drawn = [np.subtract(walk.next_end_m(MIDDLE_M, keeps=False), MIDDLE_M) for _ in range(300)]
    assert np.subtract(walk.next_end_m(MIDDLE_M, keeps=True), MIDDLE_M) == pytest.approx(drawn[-1])
    climbs_m = [step[2] for step in drawn]
    assert -0.3 <= min(climbs_m) < -0.28
    assert 0.28 < max(climbs_m) <= 0.3


def test_a_walker_outside_the_margin_that_finds_no_leg_goes_inside():
    narrow = LegSpace.within(Bounds(min_m=(0.0, 0.0, 0.0), max_m=(2.0, 2.0, 2.0)), 0.9)
    assert RunAndTumble(narrow, RandomStream(1), leg_m=3.0).next_end_m((0.1, 1.0, 1.0), keeps=False) == (0.9, 1.0)
    walk = RunAndTumble(narrow, RandomStream(1), leg_m=3.0, most_climb_m=0.1)
    assert walk.next_end_m((0.1, 1.0, 0.2), keeps=True) == (0.9, 1.0, 0.9)


@pytest.mark.parametrize("exponent", [1.0, 1.5, 2.0, 3.0])
def test_lengths_follow_the_truncated_power_law(exponent):
    """The distribution function F(l) = (l^q - a^q) / (b^q - a^q) of a drawn length is the number it was drawn with."""
    a_m, b_m, q = 1.0, 20.0, 1.0 - exponent
    for u in (0.0, 0.25, 0.5, 0.9, 0.999):
        length_m = power_law_length_m(u, exponent=exponent, least_m=a_m, most_m=b_m)
        share = (
            math.log(length_m / a_m) / math.log(b_m / a_m)
            if exponent == 1.0
            else (length_m**q - a_m**q) / (b_m**q - a_m**q)
        )
        assert share == pytest.approx(u, abs=1e-12)
        assert a_m <= length_m <= b_m


def test_a_levy_walk_stays_inside_and_has_short_and_long_legs():
    walk, here_m, lengths_m = LevyWalk(ROOM, RandomStream(6), exponent=2.0, least_m=1.0), MIDDLE_M[:2], []
    for _ in range(500):
        end_m = walk.next_end_m(here_m)
        assert ROOM.contains(end_m)
        lengths_m.append(math.dist(here_m, end_m))
        here_m = end_m
    assert min(lengths_m) >= 0.5 - 0.001
    assert max(lengths_m) > 6.0
    assert np.median(lengths_m) < 2.1
