import math

import numpy as np
import pytest
from scipy import optimize, stats

from gslcosim.base.errors import ShapeError
from gslcosim_bench.statistics.difficulty import (
    contact_difficulty,
    distance_difficulty,
    fit_rasch,
    geometric_difficulty,
    grades,
    plume_legibility,
    wind_difficulty,
)


def simulated(n_cells=12, n_entries=5, n=20, seed=0):
    rng = np.random.default_rng(seed)
    difficulty, ability = rng.normal(0, 1.2, n_cells), rng.normal(0.3, 1.0, n_entries)
    p = 1 / (1 + np.exp(difficulty[:, None] - ability))
    return rng.binomial(n, p), np.full((n_cells, n_entries), n), difficulty


@pytest.mark.extras
def test_an_almost_free_fit_is_the_logistic_regression_of_statsmodels():
    import statsmodels.api as sm

    successes, trials, _ = simulated()
    ours = fit_rasch(successes, trials, prior_sd=1e4)
    cell, entry = (index.ravel() for index in np.indices(successes.shape))
    design = np.concatenate([-np.eye(12)[cell], np.eye(5)[entry][:, 1:]], axis=1)
    counts = np.stack([successes.ravel(), (trials - successes).ravel()], axis=1)
    theirs = sm.GLM(counts, design, family=sm.families.Binomial()).fit()
    assert ours.difficulty == pytest.approx(theirs.params[:12] - theirs.params[:12].mean(), abs=1e-5)
    assert ours.ability[1:] - ours.ability[0] == pytest.approx(theirs.params[12:], abs=1e-5)
    contrast = np.eye(12) - 1 / 12
    errors = np.sqrt(np.diag(contrast @ theirs.cov_params()[:12, :12] @ contrast.T))
    assert ours.difficulty_error == pytest.approx(errors, rel=1e-4)


def test_the_penalised_fit_is_the_maximum_that_scipy_finds():
    successes, trials, _ = simulated(5, 3, 6, seed=3)

    def cost(place):
        logit = place[5:] - place[:5, None]
        return -np.sum(successes * logit - trials * np.logaddexp(0, logit)) + np.sum(place**2) / (2 * 3.0**2)

    best = optimize.minimize(cost, np.zeros(8), method="BFGS", options={"gtol": 1e-8}).x
    ours = fit_rasch(successes, trials)
    assert ours.difficulty == pytest.approx(best[:5] - best[:5].mean(), abs=1e-4)
    assert ours.ability == pytest.approx(best[5:] - best[:5].mean(), abs=1e-4)


def test_cells_and_entries_with_all_or_nothing_stay_finite():
    successes = np.array([[0, 0, 0], [10, 10, 10], [0, 5, 10]])
    ours = fit_rasch(successes, np.full((3, 3), 10))
    assert np.all(np.isfinite(ours.difficulty_error))
    assert ours.difficulty[0] > ours.difficulty[2] > ours.difficulty[1]
    assert list(ours.is_informative) == [False, False, True]


def test_an_entry_that_did_not_run_a_cell_does_not_count_there():
    successes, trials = np.array([[8, 0], [2, 3]]), np.array([[10, 0], [10, 10]])
    ours = fit_rasch(successes, trials)
    assert ours.difficulty[1] > ours.difficulty[0]
    assert ours.ability[1] > ours.ability[0]


def test_counts_that_are_none_are_refused():
    with pytest.raises(ShapeError, match="0 to the number of trials"):
        fit_rasch(np.array([[3]]), np.array([[2]]))
    with pytest.raises(ShapeError, match="one shape"):
        fit_rasch(np.zeros((2, 2)), np.zeros((2, 3)))


def test_thirds_are_easy_medium_and_hard():
    assert grades(np.array([3.0, 1.0, 2.0])) == ["hard", "easy", "medium"]
    assert grades(np.arange(6.0)) == ["easy"] * 2 + ["medium"] * 2 + ["hard"] * 2
    assert grades(np.array([0.0, 0.0, 0.0, 5.0])) == ["medium", "medium", "medium", "hard"]
    assert grades(np.array([0.0, 0.0, 1.0, 5.0])) == ["easy", "easy", "medium", "hard"]
    assert grades(np.arange(4.0)) == ["easy", "medium", "medium", "hard"]
    assert grades(np.zeros(5)) == ["medium"] * 5
    assert grades(np.array([])) == []


def test_hand_computed_explanations():
    assert geometric_difficulty(0.2) == pytest.approx(0.8)
    contacts_s = np.array([20.0, 100.0, 150.0, math.nan, math.inf])
    assert contact_difficulty(contacts_s, 300.0) == pytest.approx(0.6)
    assert distance_difficulty(12.0, 24.0) == pytest.approx(0.5)
    legible = plume_legibility(np.array([1.0, -1.0, 2.0, 0.0]), np.array([0.1, 0.3, 0.2, 0.2]))
    assert legible == pytest.approx(0.5 * 0.8)
    assert math.isnan(contact_difficulty(np.array([]), 300.0))
    assert math.isnan(plume_legibility(np.array([]), np.array([])))


def test_wind_difficulty_is_scipys_circular_standard_deviation():
    direction_rad = np.random.default_rng(2).normal(3.0, 0.4, 100)
    assert wind_difficulty(toward(direction_rad)) == pytest.approx(stats.circstd(direction_rad) / math.pi)
    assert wind_difficulty(toward(np.full(4, 1.0))) == pytest.approx(0.0, abs=1e-7)
    assert wind_difficulty(toward(np.array([0.0, math.pi]))) == 1.0
    assert math.isnan(wind_difficulty(np.empty((0, 2))))


def test_wind_that_turns_in_time_counts_as_wind_that_turns_along_the_way():
    direction_rad = np.random.default_rng(3).normal(1.0, 0.7, (20, 50))
    means = toward(direction_rad.reshape(-1)).reshape(20, 50, 2).mean(axis=1)
    assert wind_difficulty(means) == pytest.approx(wind_difficulty(toward(direction_rad.reshape(-1))))


def toward(direction_rad):
    return np.stack([np.cos(direction_rad), np.sin(direction_rad)], axis=-1)
