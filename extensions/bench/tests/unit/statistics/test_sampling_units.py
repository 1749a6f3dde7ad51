"""What is drawn of a suite, and how sure that makes its figures."""

import math

import numpy as np
import pytest

from gslcosim.base.errors import ShapeError
from gslcosim_bench.statistics.rates import lift_over_units, rate_over_units, rates_over_units, wilson
from gslcosim_bench.statistics.sampling_units import compute_means, find_sampling_units


def nested(n_rooms, n_plumes, n_flights):
    """Return room, plume within the room, and case of each flight; cases are starts, the same in all plumes."""
    room = np.repeat(np.arange(n_rooms), n_plumes * n_flights)
    plume = np.tile(np.repeat(np.arange(n_plumes), n_flights), n_rooms)
    start = np.tile(np.arange(n_flights), n_rooms * n_plumes)
    return room, plume, room * n_flights + start


@pytest.mark.parametrize(
    ("shape", "level", "freedom"),
    [((6, 2, 2), "rooms", 5), ((5, 2, 2), "plumes", 5), ((1, 6, 1), "plumes", 5), ((2, 2, 5), "flights", 10),
     ((1, 1, 9), "flights", 8)],
)  # fmt: skip
def test_the_highest_level_with_enough_units_is_drawn(shape, level, freedom):
    units = find_sampling_units(*nested(*shape))
    assert (units.level, units.freedom) == (level, freedom)
    assert (units.n_rooms, units.n_plumes) == (shape[0], shape[0] * shape[1])
    assert (units.clusters is None) == (level == "flights")


def test_equal_seeds_of_gas_in_two_rooms_are_two_plumes():
    units = find_sampling_units(list("aaabbb"), [7, 8, 9] * 2, ["c"] * 6)
    assert units.n_plumes == 6


def test_nothing_and_labels_of_other_lengths():
    assert find_sampling_units([], [], []).n == 0
    with pytest.raises(ShapeError, match="plumes 1"):
        find_sampling_units([1, 2], [1], [1, 2])


def test_means_are_those_of_cases_and_errors_those_of_rooms():
    """Cochran's error of a ratio, by hand: of seven rooms, two of them with a flight more."""
    rng = np.random.default_rng(0)
    room = np.array([0, 0, 1, 1, 2, 2, 2, 3, 3, 4, 4, 5, 5, 5, 6, 6])
    case = np.array([0, 1, 2, 3, 4, 5, 5, 6, 7, 8, 9, 10, 11, 11, 12, 13])
    values = rng.normal(size=(16, 2))
    values[3, 1] = math.nan
    means = compute_means(values, find_sampling_units(room, np.zeros(16), case), case)
    by_case = [np.nanmean(values[case == c, 0]) for c in range(14)]
    of_room = [np.mean([by_case[c] for c in np.unique(case[room == r])]) for r in range(7)]
    assert means.value[0] == pytest.approx(np.mean(by_case))
    assert means.standard_error[0] == pytest.approx(np.std(of_room, ddof=1) / math.sqrt(7))
    assert means.value[1] == pytest.approx(np.mean([values[case == c, 1].mean() for c in range(14) if c != 3]))
    assert means.n.tolist() == [16, 15]


def test_where_nothing_differs_one_flight_might_have():
    means = compute_means(np.zeros((12, 1)), find_sampling_units(*nested(6, 2, 1)), None)
    assert means.standard_error == pytest.approx([1 / 12])


def test_rates_of_single_flights_have_wilsons_interval():
    units = find_sampling_units(*nested(1, 1, 20))
    for k in (0, 7, 20):
        ours, expected = rate_over_units(np.arange(20) < k, units), wilson(k, 20)
        assert (ours.value, ours.low, ours.high, ours.n) == pytest.approx(
            (expected.value, expected.low, expected.high, 20)
        )
    assert math.isnan(rate_over_units(np.zeros(0, dtype=bool), find_sampling_units([], [], [])).value)


@pytest.mark.parametrize("n_rooms", [8, 30])
def test_rates_over_rooms_hold_that_of_all_rooms(n_rooms):
    """Rooms of which some are hard: 0.2 or 0.8; intervals of single flights hold 0.5 in less than 70 % of suites."""
    rng, n = np.random.default_rng(n_rooms), 400
    room, plume, case = nested(n_rooms, 2, 5)
    rate = np.where(rng.random((n_rooms, n)) < 0.5, 0.2, 0.8)[room]
    outcomes = rng.random(rate.shape) < rate
    _, low, high = rates_over_units(outcomes, find_sampling_units(room, plume, case))
    held = np.mean((low <= 0.5) & (high >= 0.5))
    assert abs(held - 0.95) < 3.0 * math.sqrt(0.95 * 0.05 / n) + 0.01
    single = [wilson(int(k), len(room)) for k in outcomes.sum(axis=0)]
    assert np.mean([each.low <= 0.5 <= each.high for each in single]) < 0.7


def test_lift_over_rooms_holds_the_truth():
    """Rooms in which all come near the place by luck, and rooms in which none does: luck of a room is in both."""
    rng, n, held = np.random.default_rng(5), 300, 0
    room, plume, case = nested(12, 2, 4)
    is_luck = plume == 1
    units = find_sampling_units(room, plume, case)
    for _ in range(n):
        luck = rng.uniform(0.0, 0.5, 12)[room]
        found = lift_over_units(rng.random(len(room)) < np.where(is_luck, luck, luck + 0.3), is_luck, units)
        held += found.low <= 0.3 <= found.high
    assert abs(held / n - 0.95) < 3.0 * math.sqrt(0.95 * 0.05 / n) + 0.01
