"""The null of a flight is chosen in the others: no luck of its own, no loss where one null is plainly the best."""

import numpy as np
import pytest

from gslcosim.base.errors import ShapeError
from gslcosim_bench.statistics.nulls import best_null_elsewhere
from gslcosim_bench.statistics.ranking import estimate_family
from gslcosim_bench.statistics.sampling_units import find_sampling_units


def test_the_null_of_a_flight_is_the_one_that_is_best_in_the_others_of_its_group():
    left, right, both = [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]
    # With a flight of the right one taken away, the left one is ahead by two; without one of its own, they are equal.
    success = np.array([left, left, left, right, right, both] + [right] * 5)
    groups = np.array([0] * 6 + [7] * 5)
    expected = [0.5, 0.5, 0.5, 0.0, 0.0, 1.0] + [1.0] * 5
    assert best_null_elsewhere(success, [groups]).tolist() == expected


def test_a_scenario_of_few_flights_takes_the_null_of_its_family_or_of_all():
    """Scenario 0 has five flights; 1 to 5 one each, in a family; 6 one, in a family of its own."""
    left, right = [1.0, 0.0], [0.0, 1.0]
    success = np.array([left] * 5 + [right] * 5 + [[1.0, 0.0]])
    scenarios, families = np.array([0] * 5 + [1, 2, 3, 4, 5, 6]), np.array([0] * 5 + [1] * 5 + [2])
    found = best_null_elsewhere(success, [scenarios, families])
    assert found[:10].tolist() == [1.0] * 10
    assert found[10] == 0.5  # all ten others: a tie
    assert best_null_elsewhere(success, [scenarios])[5:10].tolist() == [0.0] * 5


def test_equal_nulls_give_their_own_rate_where_the_better_one_of_the_same_flights_gives_more():
    """Of two nulls that succeed in half of five flights, the better one seems to succeed in 62 %."""
    rng = np.random.default_rng(5)
    success = (rng.random((20_000, 2)) < 0.5).astype(float)
    groups = np.repeat(np.arange(4_000), 5)
    found = best_null_elsewhere(success, [groups]).mean()
    luckier = success.reshape(4_000, 5, 2).mean(axis=1).max(axis=1).mean()
    assert found == pytest.approx(0.5, abs=0.01)
    assert luckier > 0.6


def test_a_null_that_is_plainly_better_is_taken():
    rng = np.random.default_rng(6)
    success = (rng.random((20_000, 2)) < [0.05, 0.6]).astype(float)
    found = best_null_elsewhere(success, [np.repeat(np.arange(2_000), 10)]).mean()
    assert found == pytest.approx(0.6, abs=0.015)


def test_nulls_that_have_not_flown_are_left_out():
    success = np.array([[np.nan, 1.0], [0.0, 0.0], [0.0, np.nan], [np.nan, np.nan]])
    found = best_null_elsewhere(success, [])
    assert found[:2].tolist() == [1.0, 0.0]
    assert found[2] == 0.0
    assert np.isnan(found[3])


def test_one_flight_alone_has_the_mean_of_all_nulls():
    assert best_null_elsewhere(np.array([[0.0, 1.0]]), [np.array([3])]).tolist() == [0.5]


def test_success_without_nulls_is_refused():
    with pytest.raises(ShapeError, match="a column for each null"):
        best_null_elsewhere(np.zeros((3, 0)), [])


def test_intervals_of_a_family_hold_together_and_draw_whole_rooms():
    """Eight equal columns whose rooms have effects of their own: all intervals hold zero in 95 of 100 suites."""
    rng, n_suites, n_rooms, n_flights = np.random.default_rng(7), 300, 12, 5
    rooms = np.repeat(np.arange(n_rooms), n_flights)
    units = find_sampling_units(rooms, np.arange(len(rooms)), rooms)
    held = 0
    for _ in range(n_suites):
        effect = rng.normal(0.0, 0.2, (n_rooms, 8))[rooms]
        estimates, p = estimate_family(effect + rng.normal(0.0, 0.3, effect.shape), units, rooms, n_signs=400)
        held += all(each.low <= 0.0 <= each.high for each in estimates)
        assert ((p <= 0.05) == np.array([not each.low <= 0.0 <= each.high for each in estimates])).all()
    assert 0.92 <= held / n_suites <= 0.99


def test_a_family_finds_a_column_that_differs():
    rng = np.random.default_rng(8)
    rooms = np.repeat(np.arange(20), 5)
    units = find_sampling_units(rooms, np.arange(100), rooms)
    values = rng.normal(0.0, 0.3, (100, 3)) + np.array([0.0, 0.4, -0.4])
    estimates, p = estimate_family(values, units, rooms)
    assert estimates[1].low > 0.2
    assert estimates[2].high < -0.2
    assert p[1:].max() < 0.01 < p[0]
