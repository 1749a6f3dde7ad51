import math

import pytest

from gslcosim_services.referee.metrics import directness, distance_m, find_nearest, movement_overhead

START, SOURCE = (0.0, 0.0, 0.0), (3.0, 4.0, 12.0)  # 13 m apart


def test_distance_is_euclidean_in_three_dimensions():
    assert distance_m(START, SOURCE) == 13.0


def test_nearest_takes_the_first_of_equals():
    assert find_nearest((0.0, 0.0, 0.0), [(2.0, 0.0, 0.0), (0.0, 1.0, 0.0), (1.0, 0.0, 0.0)]) == (0.0, 1.0, 0.0)


def test_the_best_flight_has_no_overhead_and_double_the_way_has_one():
    assert movement_overhead(12.0, 12.0) == 0.0
    assert movement_overhead(24.0, 12.0) == 1.0


@pytest.mark.parametrize("shortest_m", [None, 0.0])
def test_overhead_is_absent_without_a_shortest_way(shortest_m):
    assert movement_overhead(5.0, shortest_m) is None


def test_a_straight_flight_to_or_past_the_source_has_directness_one():
    assert directness(START, SOURCE, SOURCE, 13.0) == pytest.approx(1.0)
    assert directness(START, (6.0, 8.0, 24.0), SOURCE, 26.0) == pytest.approx(1.0)


def test_a_straight_flight_away_has_directness_minus_one_and_across_zero():
    assert directness(START, (-3.0, -4.0, -12.0), SOURCE, 13.0) == pytest.approx(-1.0)
    assert directness(START, (4.0, -3.0, 0.0), SOURCE, 5.0) == pytest.approx(0.0)


def test_a_zigzag_at_60_degrees_has_directness_one_half():
    """The thesis's sum over parts: each part of length r makes r cos(60 degrees) of progress."""
    n_legs, leg_m = 10, 0.8
    legs_m = [
        (leg_m * math.cos(math.radians(60)), (-1) ** i * leg_m * math.sin(math.radians(60))) for i in range(n_legs)
    ]
    end_m = (sum(x for x, _ in legs_m), sum(y for _, y in legs_m), 0.0)
    assert directness(START, end_m, (100.0, 0.0, 0.0), n_legs * leg_m) == pytest.approx(0.5)


@pytest.mark.parametrize(("source_m", "path_length_m"), [(START, 5.0), (SOURCE, 0.0)])
def test_directness_is_absent_without_a_direction_or_a_path(source_m, path_length_m):
    assert directness(START, (1.0, 0.0, 0.0), source_m, path_length_m) is None
