"""Races: whatever the draws prefer, scores are not biased, and intervals hold at all times together."""

from itertools import pairwise

import numpy as np
import pytest
from scipy import stats

from gslcosim.base.errors import ShapeError
from gslcosim_bench.statistics.racing import PlaceRace, find_place, replay_race, weigh_flights

N_CASES, FLIGHTS = 12, 4
CASES = np.repeat([f"case {i}" for i in range(N_CASES)], FLIGHTS)
N_RACES = 150


def draw_scores(rng, quality):
    hard = rng.normal(0.0, 0.2, N_CASES).repeat(FLIGHTS)[:, None]
    rate = np.clip(quality + hard, 0.02, 0.98)
    return (rng.random((len(CASES), len(quality))) < rate) * (1.0 - 0.5 * rng.random((len(CASES), len(quality))))


def holds(told, score):
    return all(each.low - 1e-9 <= score <= each.high + 1e-9 for each in told)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["usual", "better where others disagree", "worse where others disagree"])
def test_intervals_hold_at_all_times_together(kind):
    """An entry whose results go with what draws prefer would be misjudged by a plain mean of its runs."""
    n_held, plain, truth = 0, [], []
    for seed in range(N_RACES):
        rng = np.random.default_rng([5, seed])
        scores = draw_scores(rng, np.array([0.2, 0.35, 0.5, 0.65, 0.4]))
        if kind != "usual":
            spread = scores[:, :4].std(axis=1)
            is_mixed = spread > np.median(spread)
            scores[:, 4] = (is_mixed if kind.startswith("better") else ~is_mixed) * 0.9
        score = float(weigh_flights(CASES) @ scores[:, 4])
        told = replay_race(scores, 4, CASES, seed=seed, budget=16)
        n_held += holds(told, score)
        plain.append(told[-1].score)
        truth.append(score)
    assert n_held >= stats.binom.ppf(0.001, N_RACES, 0.95)
    error = np.array(plain) - np.array(truth)
    assert abs(error.mean()) < 0.03


def test_a_whole_race_ends_at_the_true_place():
    rng = np.random.default_rng(1)
    scores = draw_scores(rng, np.array([0.1, 0.3, 0.5, 0.7]))
    means = weigh_flights(CASES) @ scores
    for entry in range(4):
        told = replay_race(scores, entry, CASES, seed=3, budget=len(CASES), batch=5)
        end, place = told[-1], find_place(means[entry], np.delete(means, entry))
        assert (end.first, end.place, end.last, end.n_flown) == (place, place, place, len(CASES))
        assert end.score == pytest.approx(means[entry])
        widths = [each.high - each.low for each in told]
        assert all(a >= b for a, b in pairwise(widths))


def test_a_clear_place_is_known_early():
    """An entry that always succeeds, and one that never does, among middling ones."""
    rng = np.random.default_rng(2)
    scores = np.column_stack([draw_scores(rng, np.array([0.4, 0.5, 0.45])), np.ones(len(CASES)), np.zeros(len(CASES))])
    for entry, place in ((3, 1), (4, 5)):
        end = replay_race(scores, entry, CASES, seed=0, budget=16)[-1]
        assert (end.first, end.place, end.last) == (place, place, place)


def test_a_race_repeats_itself_and_draws_each_flight_once():
    scores = draw_scores(np.random.default_rng(3), np.array([0.3, 0.5, 0.6]))
    races = [replay_race(scores, 0, CASES, seed=seed, budget=20) for seed in (1, 1, 2)]
    assert races[0] == races[1] != races[2]
    race, drawn = PlaceRace(scores[:, 1:], CASES, seed=1, budget=20), []
    while race.n_left:
        drawn += (batch := race.draw(7))
        race.record([float(scores[i, 0]) for i in batch])
    assert sorted(drawn) == list(range(len(CASES)))


def test_draws_prefer_flights_in_which_entries_disagree():
    """Others agree in the first half of the cases: fewer of the first draws are there."""
    rng = np.random.default_rng(4)
    others = np.tile([0.0, 1.0, 0.0, 1.0], (len(CASES), 1))
    half = len(CASES) // 2
    others[:half] = np.repeat(rng.random((half, 1)) < 0.5, 4, axis=1)
    n_first = sum(i < half for seed in range(400) for i in first_draws(others, seed))
    assert n_first < stats.binom.ppf(0.01, 1600, 0.5)


def first_draws(others, seed):
    race = PlaceRace(others, CASES, seed=seed, budget=16)
    # Known results, so that predictions follow the entries where they agree.
    for _ in range(2):
        race.record([float(others[i, 1]) for i in race.draw(4)])
    return race.draw(4)


def test_places_are_shared_by_equal_scores():
    table = np.array([0.5, 0.3, 0.3, 0.0])
    assert [find_place(score, table) for score in (0.6, 0.5, 0.3, 0.1, 0.0)] == [1, 1, 2, 4, 4]


def test_each_case_weighs_the_same():
    weights = weigh_flights(np.array(["a", "a", "a", "b"]))
    assert weights.tolist() == pytest.approx([1 / 6, 1 / 6, 1 / 6, 1 / 2])


def test_what_is_no_score_is_refused():
    scores = draw_scores(np.random.default_rng(3), np.array([0.3, 0.5]))
    for others, cases, budget, text in (
        (scores + 1.0, CASES, 4, "a score from 0 to 1"),
        (scores[:, :0], CASES, 4, "at least one entry"),
        (scores, CASES[1:], 4, "48 cases"),
        (scores, CASES, 0, "at least one flight"),
    ):
        with pytest.raises(ShapeError, match=text):
            PlaceRace(others, cases, seed=1, budget=budget)
    race = PlaceRace(scores, CASES, seed=1, budget=4)
    race.draw(2)
    with pytest.raises(ShapeError, match="results of 2 flights first"):
        race.draw(2)
    for results in ([0.5], [0.5, 1.5], [0.5, float("nan")]):
        with pytest.raises(ShapeError, match="expected 2 scores"):
            race.record(results)
