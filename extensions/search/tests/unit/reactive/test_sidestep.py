import math

import pytest

from gslcosim_search.reactive.silkmoth import Sidestep


def test_it_turns_until_the_way_is_free_and_keeps_the_turn():
    step = Sidestep(side=1, keep_s=3.0)
    turns = []
    for time_s, is_refused in ((0.0, False), (2.0, True), (4.0, True), (6.0, False), (6.9, False), (7.1, False)):
        step.note(time_s, is_refused=is_refused)
        turns.append(step.turn_rad / (math.pi / 4))
    assert turns == pytest.approx([0, 1, 2, 2, 2, 0])


@pytest.mark.parametrize("side", [1, -1])
def test_from_a_corner_every_direction_is_tried_within_eight_refusals(side):
    step = Sidestep(side=side, keep_s=1.0)
    tried = set()
    for i in range(8):
        step.note(2.0 * i, is_refused=True)
        tried.add(round(math.degrees(step.turn_rad)) % 360)
    assert tried == set(range(0, 360, 45))
