import pytest

from gslcosim_search.senses.stop_and_measure import BestProximity, local_maxima, proximity_index


def test_peaks_are_above_what_is_before_and_not_below_what_is_after():
    assert local_maxima([5.0, 1.0, 3.0, 2.0, 4.0, 4.0, 4.0, 1.0, 9.0]) == [3.0, 4.0]
    assert local_maxima([1.0, 2.0]) == local_maxima([]) == []


def test_the_index_of_a_constant_is_its_mean_by_its_weight():
    assert proximity_index([2.0] * 20, 0.1) == pytest.approx(1.0)
    assert proximity_index([], 0.1) == 0.0


def test_bursts_count_more_than_the_same_gas_without():
    calm, bursts = [1.0] * 20, [0.0, 2.0] * 10
    assert sum(calm) == sum(bursts)
    assert proximity_index(calm, 0.1) == pytest.approx(0.5)
    # Nine peaks of 2 that are no end.
    assert proximity_index(bursts, 0.1) == pytest.approx(0.5 + 0.1 * 18.0)


@pytest.mark.parametrize("factor", [0.0, 0.5, 7.0])
def test_the_index_is_in_proportion_to_the_gas(factor):
    samples = [0.3, 1.0, 0.2, 0.8, 0.1]
    scaled = [factor * sample for sample in samples]
    assert proximity_index(scaled, 0.1) == pytest.approx(factor * proximity_index(samples, 0.1))


def test_the_best_is_halved_after_more_than_three_misses_in_a_row():
    best = BestProximity(n_misses=3)
    assert best.is_better(8.0)
    assert [best.is_better(1.0) for _ in range(3)] == [False] * 3
    assert best.best == 8.0
    assert not best.is_better(1.0)
    assert best.best == 4.0
    assert best.is_better(5.0)


def test_a_better_stop_forgets_the_misses():
    best = BestProximity(n_misses=1)
    best.is_better(8.0)
    best.is_better(1.0)
    best.is_better(9.0)
    best.is_better(1.0)
    assert best.best == 9.0


def test_without_gas_no_stop_is_better():
    best = BestProximity()
    assert not any(best.is_better(0.0) for _ in range(20))
