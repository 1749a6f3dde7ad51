import math

import numpy as np
import pytest

from gslcosim_search.bayes.encounter_model import EncounterModel, likelihoods
from gslcosim_search.beliefs import CellGrid
from gslcosim_search.information.objectives import (
    Candidates,
    MoveTree,
    SurpriseMonitor,
    dual_control_cost,
    entrotaxis_cost,
    find_min_cost_index,
    flatten_belief,
    free_energy_cost,
    information_gain_cost,
    infotaxis_cost,
    n_step_costs,
    predict_stops,
    renyi_cost,
    space_aware_cost,
    update_belief,
)

GRID = CellGrid((0.0, 0.0), 1.0, (6, 5))
CELLS_M = GRID.centres_m()
PLACES_M = np.array([[2.5, 2.5], [3.5, 2.5], [1.5, 2.5], [2.5, 3.5], [2.5, 1.5]])


def belief(seed=3) -> np.ndarray:
    p = np.random.default_rng(seed).random(GRID.n_cells) ** 3
    return p / p.sum()


def candidates(*, n_outcomes=3, floor=0.0, power=1.0, reach_m=0.6, places_m=PLACES_M) -> Candidates:
    model = EncounterModel(
        dimensions=2, emission_per_s=2.0, diffusivity_m2_s=0.4, lifetime_s=20.0, detector_m=0.2, wind_m_s=(0.3, 0.1)
    )
    likelihood, weight, log_weight = (
        table.copy()
        for table in likelihoods(
            model.log_mean_hits(places_m, CELLS_M), n_outcomes=n_outcomes, floor=floor, power=power
        )
    )
    found = np.linalg.norm(CELLS_M[None] - places_m[:, None], axis=2) < reach_m
    for table in (likelihood, weight, log_weight):
        table[np.broadcast_to(found[:, None, :], table.shape)] = 0.0
    return Candidates(places_m=places_m, cells_m=CELLS_M, likelihood=likelihood, weight=weight, log_weight=log_weight)


def entropy_bits(p) -> float:
    return -sum(x * math.log2(x) for x in p if x > 0.0)


def by_hand(p, stops):
    """For each place the outcomes as pairs of (probability without finding the source, belief that is left)."""
    outcomes = []
    for likelihood, weight in zip(stops.likelihood, stops.weight, strict=True):
        outcomes.append([(float(p @ row), p * w / (p @ w)) for row, w in zip(likelihood, weight, strict=True)])
    return outcomes


@pytest.mark.parametrize("tempering", [{}, {"floor": 1e-2, "power": 0.4}, {"reach_m": 0.0}])
def test_each_criterion_is_its_definition_outcome_by_outcome(tempering):
    p, stops = belief(), candidates(**tempering)
    predictions = predict_stops(p, stops, alpha=0.5)
    mean_m = p @ CELLS_M
    step_m, temperature, exploration = 1.0, 0.7, 2.0
    for i, outcomes in enumerate(by_hand(p, stops)):
        place = stops.places_m[i]
        chances = [chance for chance, _ in outcomes]
        rho = [chance / sum(chances) for chance in chances]
        entropies = [entropy_bits(q) for _, q in outcomes]
        distances = [float(q @ np.abs(CELLS_M - place).sum(axis=1)) for _, q in outcomes]
        variances = [float(q @ (CELLS_M**2).sum(axis=1) - ((q @ CELLS_M) ** 2).sum()) for _, q in outcomes]
        gains = [float(sum(a * math.log2(a / b) for a, b in zip(q, p, strict=True) if a > 0)) for _, q in outcomes]
        renyi = [-2.0 * math.log2(float(np.sqrt(q * p).sum())) for _, q in outcomes]
        steps = [math.log2(d + 2 ** (h - 1) - 0.5) for d, h in zip(distances, entropies, strict=True)]

        assert infotaxis_cost(predictions)[i] == pytest.approx(np.dot(chances, entropies))
        assert space_aware_cost(predictions, step_m=step_m)[i] == pytest.approx(np.dot(chances, steps))
        assert entrotaxis_cost(predictions)[i] == pytest.approx(-entropy_bits(rho))
        assert information_gain_cost(predictions)[i] == pytest.approx(-np.dot(rho, gains))
        assert renyi_cost(predictions)[i] == pytest.approx(-np.dot(rho, renyi))
        assert free_energy_cost(predictions, step_m=step_m, temperature=temperature)[i] == pytest.approx(
            np.dot(chances, np.array(distances) + temperature * np.array(entropies))
        )
        assert dual_control_cost(predictions, stops.places_m, mean_m, exploration=exploration)[i] == pytest.approx(
            float(((place - mean_m) ** 2).sum()) + exploration * np.dot(rho, variances)
        )


def test_the_chance_to_find_the_source_is_the_mass_within_reach():
    p, stops = belief(), candidates()
    assert predict_stops(p, stops).found_frac == pytest.approx([p[GRID.shape[1] * i + j] for i, j in
                                                          ((2, 2), (3, 2), (1, 2), (2, 3), (2, 1))])  # fmt: skip


def test_the_usual_form_of_dual_control_does_not_see_the_reading():
    """|x - E'[s]|^2 + tr cov' averages to E|s - x|^2, whatever the reading tells: why ours keeps the mean of now."""
    p, stops = belief(), candidates(reach_m=0.0)
    predictions = predict_stops(p, stops)
    usual = [
        sum(
            chance * (((stops.places_m[i] - q @ CELLS_M) ** 2).sum() + predictions.variance_m2[i, h])
            for h, (chance, q) in enumerate(outcomes)
        )
        for i, outcomes in enumerate(by_hand(p, stops))
    ]
    blind = [float(p @ ((CELLS_M - place) ** 2).sum(axis=1)) for place in stops.places_m]
    assert usual == pytest.approx(blind)
    assert (predictions.predictive * predictions.square_m2).sum(axis=1) == pytest.approx(blind)


def test_a_belief_after_an_outcome_is_bayes_rule_and_ruled_out_cells_stay_so():
    p, stops = belief(), candidates(reach_m=0.0)
    assert update_belief(p, stops.log_weight[0, 1]) == pytest.approx(by_hand(p, stops)[0][1][1])
    p[3] = 0.0
    assert update_belief(p, np.zeros(p.shape))[3] == 0.0


def test_weights_far_below_what_a_number_can_hold_still_order_the_cells():
    p = np.full(3, 1.0 / 3.0)
    assert update_belief(p, np.array([-2000.0, -2001.0, -3000.0])) == pytest.approx([0.731059, 0.268941, 0.0], abs=1e-6)


def test_a_belief_that_everything_rules_out_is_left_alone():
    p = belief()
    assert update_belief(p, np.full(p.shape, -np.inf)) == pytest.approx(p)


def test_the_first_of_equal_costs_is_best():
    assert find_min_cost_index(np.array([2.0, 1.0 + 1e-12, 1.0, 3.0])) == 1


def line_tree(n_outcomes=2):
    """Five places in a row; each leads to its neighbours and to itself."""
    places_m = np.array([[x, 2.5] for x in (0.5, 1.5, 2.5, 3.5, 4.5)])
    moves = [[q for q in (i - 1, i, i + 1) if 0 <= q < 5] for i in range(5)]
    return MoveTree(candidates=candidates(n_outcomes=n_outcomes, places_m=places_m), moves=moves, start=moves[2])


def gain_by_hand(p, tree, place, depth, discount):
    gain = entropy_bits(p)
    later = 0.0
    for chance, q in by_hand(p, tree.candidates)[place]:
        gain -= chance * entropy_bits(q)
        if depth > 1:
            later += chance * max(
                gain_by_hand(q, tree, following, depth - 1, discount) for following in tree.moves[place]
            )
    return gain + discount * later


@pytest.mark.parametrize(("depth", "n_outcomes"), [(1, 3), (2, 3), (3, 2)])
def test_gains_of_several_steps_are_those_of_all_paths(depth, n_outcomes):
    p, tree = belief(), line_tree(n_outcomes)
    expected = [-gain_by_hand(p, tree, place, depth, 0.9) for place in tree.start]
    assert n_step_costs(p, tree, depth=depth, discount=0.9) == pytest.approx(expected)


def outcomes_until_alarm(chance_told, chance_true, n=400, seed=1):
    rng, monitor = np.random.default_rng(seed), SurpriseMonitor()
    chances = np.array([1.0 - chance_told, chance_told])
    return sum(monitor.add(chances, int(rng.random() < chance_true)) for _ in range(n))


def test_a_right_model_hardly_ever_alarms_and_a_wrong_one_soon_does():
    assert sum(outcomes_until_alarm(0.2, 0.2, seed=seed) > 0 for seed in range(10)) <= 3
    assert outcomes_until_alarm(0.05, 0.5) > 5


def test_no_alarm_comes_before_the_window_is_full():
    monitor = SurpriseMonitor(n_stops=20)
    assert [monitor.add(np.array([0.99, 0.01]), 1) for _ in range(20)] == [False] * 19 + [True]


def test_flattening_keeps_the_order_and_raises_the_entropy():
    p = belief()
    flat = flatten_belief(p)
    assert flat.sum() == pytest.approx(1.0)
    assert (np.argsort(flat) == np.argsort(p)).all()
    assert entropy_bits(flat) > entropy_bits(p)
