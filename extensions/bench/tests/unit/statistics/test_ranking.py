"""Entries compared in one family: what follows from what, false findings among equals, and coverage together."""

import math

import numpy as np
import pytest
from scipy import stats

from gslcosim_bench.statistics.ranking import compare_entries
from gslcosim_bench.statistics.sampling_units import find_sampling_units


def single(n):
    """Return units of n flights in one room and one plume."""
    return find_sampling_units(np.zeros(n), np.zeros(n), np.zeros(n))


def times(n=80, seed=0):
    rng = np.random.default_rng(seed)
    case = rng.normal(150.0, 50.0, n)
    return np.stack([case + rng.normal(mean, 10.0, n) for mean in (0.0, 0.5, 20.0)], axis=1)


def compared(values, *, lower_is_better=True, units=None, **how):
    units = single(len(values)) if units is None else units
    return compare_entries({"x": values}, ranked_by="x", lower_is_better=lower_is_better, units=units, **how)


def test_what_may_be_a_tie_shares_its_places():
    assert compared(times()).ranks == ((1, 2), (1, 2), (3, 3))
    assert compared(-times(), lower_is_better=False).ranks == ((1, 2), (1, 2), (3, 3))
    assert compared(times()[:, ::-1]).ranks == ((3, 3), (1, 2), (1, 2))


def test_verdicts_intervals_p_and_ranks_say_the_same():
    rng = np.random.default_rng(1)
    for seed in range(20):
        values = rng.normal(np.linspace(0.0, 1.0, 5), 1.0, (16, 5))
        found = compared(values, seed=seed, n_signs=500)
        for pair in found.pairs:
            assert (pair.verdict != 0) == (pair.p <= 0.05) == (not pair.differences["x"].holds_zero)
            assert pair.differences["x"].value == pytest.approx(np.mean(values[:, pair.a] - values[:, pair.b]))
        worse = [pair.b if pair.verdict > 0 else pair.a for pair in found.pairs if pair.verdict]
        assert [low for low, _ in found.ranks] == [1 + worse.count(i) for i in range(5)]


def test_two_entries_alone_have_students_interval_or_a_wider_one():
    values = times()[:, :2]
    pair = compared(values).pairs[0]
    student = stats.ttest_rel(values[:, 0], values[:, 1])
    low, high = student.confidence_interval()
    assert pair.differences["x"].low == pytest.approx(low, rel=0.05)
    assert pair.differences["x"].low <= low
    assert pair.differences["x"].high >= high
    assert pair.p == pytest.approx(student.pvalue, abs=0.03)


def test_five_rooms_or_fewer_show_nothing_and_six_show_what_holds_in_all():
    """Of all patterns of signs of five, two make 6 %."""
    values = np.stack([np.full(24, 1.0) + 0.01 * np.arange(24), np.zeros(24)], axis=1)
    for n_rooms, verdict in ((5, 0), (6, 1)):
        room = np.arange(24) * n_rooms // 24
        units = find_sampling_units(room, np.zeros(24), room)
        some = units if n_rooms == 6 else find_sampling_units(np.arange(24) // 4, np.zeros(24), room).select(
            np.arange(20)
        )  # fmt: skip
        found = compared(values[: len(some.unit)], units=some, lower_is_better=False)
        assert some.level == "rooms"
        assert found.pairs[0].verdict == verdict


def test_flights_of_one_room_are_one_observation():
    """Eight rooms, each flown thirty times, say no more than eight flights."""
    rng = np.random.default_rng(4)
    room = np.repeat(np.arange(8), 30)
    values = np.stack([rng.normal(0.1, 0.3, 8)[room] + rng.normal(0, 0.01, 240), np.zeros(240)], axis=1)
    assert compared(values, lower_is_better=False).ranks[1] == (2, 2)
    units = find_sampling_units(room, room, room)
    assert compared(values, lower_is_better=False, units=units).ranks == ((1, 2), (1, 2))


def test_each_case_counts_the_same():
    values = np.stack([np.array([1.0, 1.0, 1.0, 0.0]), np.zeros(4)], axis=1)
    cases = np.array([0, 0, 0, 1])
    assert compared(values, cases=cases).pairs[0].differences["x"].value == pytest.approx(0.5)


def test_entries_without_results_come_last_and_pairs_without_flights_are_left_out():
    values = times()
    values[:, 0] = math.nan
    assert compared(values).ranks == ((3, 3), (1, 1), (2, 2))
    apart = np.array([[1.0, math.nan], [math.nan, 2.0]])
    assert (compared(apart).pairs, compared(apart).ranks) == ((), ((1, 2), (1, 2)))
    assert compared(np.zeros((4, 1))).ranks == ((1, 1),)


def test_a_flight_that_one_entry_lacks_is_no_pair():
    values = times()
    values[:30, 2] = math.nan
    found = {(pair.a, pair.b): pair.differences["x"] for pair in compared(values).pairs}
    assert [found[pair].n for pair in ((0, 1), (0, 2), (1, 2))] == [80, 50, 50]
    assert found[0, 2].value == pytest.approx(np.mean(values[30:, 0] - values[30:, 2]))


def test_equal_flights_are_no_certainty():
    found = compared(np.ones((10, 2)), limit=1.0).pairs[0]
    assert (found.verdict, found.p, found.a_better.value) == (0, 1.0, 0.5)
    assert -0.3 < found.differences["x"].low < -0.2
    assert 0.2 < found.differences["x"].high < 0.3


def suite(rng, quality, n_rooms):
    """Return successes and units of a suite: rooms, plumes and flights, each with its own effect on each entry."""
    n_entries, room = len(quality), np.repeat(np.arange(n_rooms), 4)
    plume = np.arange(4 * n_rooms) // 2
    rate = quality + rng.uniform(-0.15, 0.15, n_rooms)[room, None] + rng.uniform(-0.1, 0.1, (n_rooms, n_entries))[room]
    rate = rate + rng.uniform(-0.05, 0.05, (2 * n_rooms, n_entries))[plume]
    success = rng.random(rate.shape) < rate
    score = success * (1.0 - 0.5 * rng.random(rate.shape))
    return {"score": score, "success": success.astype(float)}, find_sampling_units(room, plume, plume), plume


@pytest.mark.parametrize(("n_entries", "n_rooms"), [(2, 6), (12, 30)])
def test_equal_entries_seldom_get_other_than_the_first_rank_however_many_there_are(n_entries, n_rooms):
    """A leader against each next one gave more than one rank in half of the suites with 6, and two thirds with 12."""
    rng, n_suites, split = np.random.default_rng([6, n_entries]), 100, 0
    for seed in range(n_suites):
        figures, units, cases = suite(rng, np.full(n_entries, 0.5), n_rooms)
        found = compare_entries(
            figures, ranked_by="score", lower_is_better=False, units=units, cases=cases, seed=seed, n_signs=400
        )
        split += len(set(found.ranks)) > 1
    assert split <= stats.binom.ppf(0.999, n_suites, 0.05)


@pytest.mark.parametrize("n_rooms", [8, 20])
def test_all_intervals_together_hold_known_differences_and_ranks_the_true_order(n_rooms):
    rng, n_suites, quality = np.random.default_rng([7, n_rooms]), 150, np.linspace(0.35, 0.65, 6)
    held, ranked = 0, 0
    for seed in range(n_suites):
        figures, units, cases = suite(rng, quality, n_rooms)
        found = compare_entries(
            figures, ranked_by="score", lower_is_better=False, units=units, cases=cases, seed=seed, n_signs=400
        )
        held += all(
            estimate.low <= scale * (quality[pair.a] - quality[pair.b]) <= estimate.high
            for pair in found.pairs
            for estimate, scale in ((pair.differences["success"], 1.0), (pair.differences["score"], 0.75))
        )
        ranked += all(low <= 6 - i <= high for i, (low, high) in enumerate(found.ranks))
    assert held >= stats.binom.ppf(0.001, n_suites, 0.95)
    assert ranked >= stats.binom.ppf(0.001, n_suites, 0.95)


def test_equal_entries_seldom_differ_where_one_room_has_a_quarter_of_the_weight():
    """Eleven of 42 cases in one of twenty rooms; with a t of units of one weight, one suite in six had a verdict."""
    room = np.concatenate([np.zeros(10, dtype=int), np.arange(20), np.arange(8, 20)])
    case, rng, n_suites, found = np.arange(42), np.random.default_rng(8), 150, 0
    units = find_sampling_units(room, case, case)
    for seed in range(n_suites):
        values = rng.normal(0.0, 1.0, (20, 5))[room] + rng.normal(0.0, 0.5, (42, 5))
        pairs = compared(values, lower_is_better=False, units=units, cases=case, seed=seed, n_signs=400).pairs
        found += any(pair.verdict for pair in pairs)
    assert found <= stats.binom.ppf(0.999, n_suites, 0.05)
