import pytest

from gslcosim_services.referee.metrics import directness, find_nearest, movement_overhead

START, SOURCE = (0.0, 0.0, 0.0), (3.0, 4.0, 12.0)  # 13 m apart


def test_nearest_takes_the_first_of_equals():
    assert find_nearest((0.0, 0.0, 0.0), [(2.0, 0.0, 0.0), (0.0, 1.0, 0.0), (1.0, 0.0, 0.0)]) == (0.0, 1.0, 0.0)


def test_the_best_flight_has_no_overhead_and_double_the_way_has_one():
    assert movement_overhead(12.0, 12.0) == 0.0
    assert movement_overhead(24.0, 12.0) == 1.0


@pytest.mark.parametrize("shortest_m", [None, 0.0])
def test_overhead_is_absent_without_a_shortest_way(shortest_m):
    assert movement_overhead(5.0, shortest_m) is None


@pytest.mark.parametrize(("source_m", "path_length_m"), [(START, 5.0), (SOURCE, 0.0)])
def test_directness_is_absent_without_a_direction_or_a_path(source_m, path_length_m):
    assert directness(START, (1.0, 0.0, 0.0), source_m, path_length_m) is None
