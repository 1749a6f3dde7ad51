import itertools
import math

import pytest

from gslcosim_search.random_stream import RandomStream
from gslcosim_search.reactive.cast_and_surge import (
    BlankMemory,
    CastSequence,
    PlaneCastSequence,
    cast_length_m,
    find_side,
    oblique_surge_end_m,
    side_or_random,
    surge_end_m,
)

WIDTH_M = 0.75
GROWTHS = {"growing": [1, 2, 3, 4, 5], "fixed": [1, 2, 2, 2, 2], "doubling": [1, 2, 4, 8, 16]}
HERE_M = (3.0, 4.0, 2.0)


def turns_of(sequence):
    turns = []
    while (turn_m := sequence.next_turn_m()) is not None:
        turns.append(turn_m)
    return turns


def cast(*, upwind_rad=0.3, side=1, growth="growing", n_legs=5, anchor_m=(3.0, 4.0)):
    return CastSequence(
        anchor_m=anchor_m, upwind_rad=upwind_rad, side=side, width_m=WIDTH_M, growth=growth, n_legs=n_legs
    )


@pytest.mark.parametrize("growth", GROWTHS)
def test_legs_of_a_cast_grow_as_they_are_called(growth):
    assert [cast_length_m(WIDTH_M, n, growth) for n in range(5)] == [WIDTH_M * times for times in GROWTHS[growth]]
    turns = [cast().anchor_m, *turns_of(cast(growth=growth))]
    flown_m = [math.dist(a, b) for a, b in itertools.pairwise(turns)]
    assert flown_m == pytest.approx([WIDTH_M * times for times in GROWTHS[growth]])


@pytest.mark.parametrize("upwind_rad", [0.0, 0.3, 2.0, -3.0])
@pytest.mark.parametrize("side", [1, -1])
def test_a_cast_stays_on_the_line_across_the_wind_that_it_began_with(upwind_rad, side):
    for i, (x_m, y_m) in enumerate(turns_of(cast(upwind_rad=upwind_rad, side=side))):
        along_m = (x_m - 3.0) * math.cos(upwind_rad) + (y_m - 4.0) * math.sin(upwind_rad)
        assert along_m == pytest.approx(0.0, abs=1e-12)
        assert find_side((x_m, y_m), (3.0, 4.0), upwind_rad) == (side if i % 2 == 0 else -side)


def test_a_cast_in_the_plane_crosses_both_ways_and_grows_after_a_round():
    sequence = PlaneCastSequence(
        anchor_m=(3.0, 4.0, 2.0), upwind_rad=0.0, side=-1, lift=1, width_m=0.75, height_m=0.5, n_legs=8
    )
    offsets = [(-(y - 4.0), z - 2.0) for _, y, z in turns_of(sequence)]
    expected = [(0.75, 0), (-0.75, 0), (0, 0.5), (0, -0.5), (1.5, 0), (-1.5, 0), (0, 1), (0, -1)]
    assert offsets == [pytest.approx(offset) for offset in expected]


@pytest.mark.parametrize("upwind_rad", [0.0, 0.7, math.pi, -2.0])
def test_a_place_on_the_line_upwind_is_on_neither_side(upwind_rad):
    on_line_m = (5.0 * math.cos(upwind_rad), 5.0 * math.sin(upwind_rad))
    assert find_side(on_line_m, (0.0, 0.0), upwind_rad) == 0
    assert {side_or_random(on_line_m, (0.0, 0.0), upwind_rad, RandomStream(seed)) for seed in range(20)} == {1, -1}


def test_a_known_side_costs_no_draw():
    draws = RandomStream(1)
    assert side_or_random((0.0, 1.0), (0.0, 0.0), 0.0, draws) == 1
    assert draws.fraction() == RandomStream(1).fraction()


def memory(**changes):
    return BlankMemory(**({"first_s": 5.0, "least_s": 1.0, "most_s": 20.0} | changes))


def test_the_memory_is_as_long_as_the_last_blank():
    blanks = memory()
    assert blanks.memory_s == 5.0
    for time_s, expected_s in ((10.0, 5.0), (13.0, 3.0), (20.0, 7.0)):
        blanks.note_hit(time_s)
        assert blanks.memory_s == expected_s
    assert not blanks.is_lost(26.9)
    assert blanks.is_lost(27.1)


def test_the_memory_keeps_within_its_bounds():
    blanks = memory()
    blanks.note_hit(0.0)
    blanks.note_hit(0.1)
    assert blanks.memory_s == 1.0
    blanks.note_hit(100.0)
    assert blanks.memory_s == 20.0
    assert memory(first_s=100.0).memory_s == 20.0


def test_hits_close_together_are_no_blank():
    blanks = memory(shortest_blank_s=0.5)
    for time_s in (0.0, 4.0, 4.1, 4.2):
        blanks.note_hit(time_s)
    assert blanks.memory_s == 4.0
    assert blanks.blank_s(5.2) == pytest.approx(1.0)


def in_wind_frame(place_m, upwind_rad):
    dx_m, dy_m = place_m[0] - HERE_M[0], place_m[1] - HERE_M[1]
    c, s = math.cos(upwind_rad), math.sin(upwind_rad)
    return dx_m * c + dy_m * s, dy_m * c - dx_m * s


@pytest.mark.parametrize("upwind_rad", [0.0, 0.7, -2.5, math.pi])
def test_a_surge_without_a_place_of_gas_goes_straight_upwind(upwind_rad):
    assert in_wind_frame(surge_end_m(HERE_M, None, upwind_rad, 0.8), upwind_rad) == pytest.approx((0.8, 0.0))


@pytest.mark.parametrize("upwind_rad", [0.0, 0.7, -2.5, math.pi])
def test_a_surge_ends_on_the_line_upwind_through_the_gas_and_loses_no_way(upwind_rad):
    gas_m = (3.4, 3.1, 2.0)
    along_m, across_m = in_wind_frame(surge_end_m(HERE_M, gas_m, upwind_rad, 0.8), upwind_rad)
    assert along_m == pytest.approx(0.8)
    assert across_m == pytest.approx(in_wind_frame(gas_m, upwind_rad)[1])


@pytest.mark.parametrize("slant_rad", [0.3, -0.3, 1.2])
def test_a_slanted_leg_has_its_length_and_its_angle_to_upwind(slant_rad):
    along_m, across_m = in_wind_frame(oblique_surge_end_m(HERE_M, None, 0.7, slant_rad, 0.8), 0.7)
    assert math.hypot(along_m, across_m) == pytest.approx(0.8)
    assert math.atan2(across_m, along_m) == pytest.approx(slant_rad)
