import itertools
import math

import numpy as np
import pytest

from gslcosim_search.bayes.encounter_model import PlumeAssumption
from gslcosim_search.beliefs import CellGrid
from gslcosim_search.information.objectives import infotaxis_cost, predict_stops
from gslcosim_search.swarms.shared_belief import (
    LEAST_P,
    SharedBelief,
    SharedFinding,
    assigned_costs,
    belief_potential,
    langevin_step_m,
    potential_slope,
    settle_roles,
    swap_probability,
    swap_roles,
    temperature_ladder,
)

GRID = CellGrid((0.0, 0.0), 1.0, (9, 7))
DISPERSAL = PlumeAssumption(
    dimensions=2, hits_at_1m=2.0, diffusivity_m2_s=0.1, lifetime_s=60.0, room_length_m=9.0, detector_m=0.1,
    correlation_s=5.0, stop_s=2.0,
)  # fmt: skip
WIND = (0.4, 0.1)
FINE_GRID = CellGrid((0.0, 0.0), 0.5, (12, 10))
LADDER = (0.01, 0.1, 1.0)


def belief(free=None, *, power=0.5, near_m=0.5, reach_m=0.0):
    free = np.ones(GRID.shape, bool) if free is None else free
    return SharedBelief(GRID, free, DISPERSAL, floor=0.02, power=power, near_m=near_m, reach_m=reach_m)


def found(finder, number, time_s, place_m, *, hit=False):
    return SharedFinding(
        finder=finder, number=number, time_s=time_s, place_m=place_m, is_hit=hit, wind_m_s=WIND, spread_rad=0.2
    )


FINDINGS = [
    found("ada", 1, 2.0, (7.0, 3.0)),
    found("bob", 1, 2.0, (5.2, 3.4), hit=True),
    found("ada", 2, 4.0, (6.2, 3.6), hit=True),
    found("cyd", 1, 5.0, (6.3, 3.5)),
    found("bob", 2, 6.0, (4.1, 3.3)),
]


def test_the_belief_is_the_same_to_the_bit_in_whatever_order_findings_come():
    first = belief()
    for finding in FINDINGS:
        first.add(finding)
    for order in itertools.permutations(FINDINGS):
        other = belief()
        for finding in order:
            other.add(finding)
        assert np.array_equal(other.p, first.p)


def test_a_finding_that_comes_twice_counts_once():
    once = belief()
    assert once.add(FINDINGS[1])
    before = once.p
    assert not once.add(FINDINGS[1])
    assert len(once) == 1
    assert np.array_equal(once.p, before)


def test_the_second_finding_at_a_place_weighs_half_of_the_first():
    """With all powers as 1, p goes with the likelihood L to the power 1 + 1/2 for two equal findings at one place."""
    one, two = belief(power=1.0), belief(power=1.0)
    one.add(found("ada", 1, 2.0, (5.5, 3.5), hit=True))
    for number, finder in enumerate(("ada", "bob"), start=1):
        two.add(found(finder, number, 2.0 * number, (5.5, 3.5), hit=True))
    expected = one.p**1.5
    assert two.p == pytest.approx(expected / expected.sum())


def test_a_stop_searches_the_cells_within_reach():
    candidates = belief(reach_m=1.2).candidates([(4.5, 3.5)], WIND, 0.2)
    within = (np.hypot(*(GRID.centres_m() - np.array([4.5, 3.5])).T) < 1.2).nonzero()[0]
    assert candidates.likelihood[0][:, within] == pytest.approx(0.0)
    assert candidates.likelihood[0].sum(axis=0).max() == pytest.approx(1.0)


def test_with_no_plans_of_others_it_is_infotaxis():
    known = belief()
    known.add(FINDINGS[1])
    own = known.candidates([(3.0, 3.0), (6.0, 2.0)], WIND, 0.2)
    p = known.p.reshape(-1)
    assert assigned_costs(p, own, []) == pytest.approx(infotaxis_cost(predict_stops(p, own)))


@pytest.mark.parametrize("plans", [[(4.0, 3.0)], [(4.0, 3.0), (2.5, 5.0)]])
def test_the_cost_is_the_entropy_that_all_stops_together_leave(plans):
    """Against a sum over all combinations of outcomes, written out."""
    known = belief(power=1.0)
    own = known.candidates([(6.0, 2.0), (3.0, 4.0)], WIND, 0.2)
    planned = [known.candidates([plan], WIND, 0.2) for plan in plans]
    p = known.p.reshape(-1)
    for i, cost in enumerate(assigned_costs(p, own, planned)):
        expected = 0.0
        for outcomes in itertools.product((0, 1), repeat=len(plans) + 1):
            joint = p * own.likelihood[i][outcomes[-1]]
            for stop, outcome in zip(planned, outcomes):
                joint = joint * stop.likelihood[0][outcome]
            q = joint / joint.sum()
            expected += joint.sum() * -(q * np.log2(q)).sum()
        assert cost == pytest.approx(expected)


def test_where_another_goes_there_is_less_left_to_learn():
    known = belief()
    here, there = (4.0, 3.5), (4.0, 0.8)
    own = known.candidates([here, there], WIND, 0.2)
    p = known.p.reshape(-1)
    alone = assigned_costs(p, own, [])
    taken = assigned_costs(p, own, [known.candidates([here], WIND, 0.2)])
    assert taken.max() < math.log2(GRID.n_cells)
    assert taken[0] - taken[1] > alone[0] - alone[1]


def test_the_potential_falls_where_the_belief_rises_and_is_bounded_where_there_is_none():
    potential = belief_potential(np.array([0.5, 0.1, 0.0]))
    assert potential == pytest.approx([math.log(2.0), math.log(10.0), -math.log(LEAST_P)])


def test_the_slope_of_a_plane_is_exact_in_the_middle_and_at_the_rim():
    centres = FINE_GRID.centres_m().reshape(*FINE_GRID.shape, 2)
    plane = centres @ (1.5, -0.4)
    for point_m in [(3.1, 2.2), (0.0, 0.0), (5.99, 4.99), (-3.0, 50.0)]:
        assert potential_slope(plane, FINE_GRID, point_m) == pytest.approx([1.5, -0.4])


def test_the_drift_is_capped_and_keeps_its_direction():
    step = langevin_step_m(np.array([-30.0, 40.0]), np.zeros(2), temperature=0.0, mobility_m2=1.0, longest_m=0.5)
    assert step == pytest.approx([0.3, -0.4])


def test_the_noise_has_the_variance_of_its_temperature():
    noise = np.random.default_rng(1).normal(size=(4000, 2))
    steps = np.array([
        langevin_step_m(np.zeros(2), xi, temperature=0.3, mobility_m2=0.5, longest_m=1.0) for xi in noise
    ])  # fmt: skip
    assert steps.var() == pytest.approx(2.0 * 0.5 * 0.3, rel=0.05)


def test_a_colder_robot_at_the_worse_place_swaps_for_sure():
    assert swap_probability(0.01, 1.0, 5.0, 2.0) == 1.0
    assert swap_probability(1.0, 0.01, 2.0, 5.0) == 1.0
    assert swap_probability(0.01, 1.0, 5.0, 2.0, attempt=0.3) == 0.3


def test_a_colder_robot_at_the_better_place_swaps_the_less_the_better_it_stands():
    probabilities = [swap_probability(0.1, 1.0, 2.0, phi) for phi in (2.0, 2.05, 2.2, 5.0)]
    assert probabilities[0] == 1.0
    assert probabilities[1] == pytest.approx(math.exp(-9.0 * 0.05))
    assert probabilities == sorted(probabilities, reverse=True)


def test_swaps_keep_detailed_balance():
    """The weight of a state times the probability to leave it equals that of the way back."""
    tau_i, tau_j = 0.3, 1.1
    for phi_i, phi_j in [(0.2, 1.0), (1.0, 0.2), (2.0, 2.0)]:
        there = math.exp(-phi_i / tau_i - phi_j / tau_j) * swap_probability(tau_i, tau_j, phi_i, phi_j)
        back = math.exp(-phi_j / tau_i - phi_i / tau_j) * swap_probability(tau_i, tau_j, phi_j, phi_i)
        assert there == pytest.approx(back)


def test_the_ladder_rises_by_equal_factors():
    assert temperature_ladder(3, 0.01, 1.0) == pytest.approx(LADDER)
    assert temperature_ladder(1, 0.01, 1.0) == pytest.approx((0.1,))


def test_nobody_shares_a_role_and_who_has_one_of_its_own_keeps_it():
    assert settle_roles({"b": 2, "a": 0, "c": 1}, 3) == {"a": 0, "b": 2, "c": 1}
    assert settle_roles({"a": 1, "b": 1, "c": 7}, 4) == {"a": 1, "b": 0, "c": 2}


def swapped(potentials, *, is_odd=False, fraction=0.5, attempt=1.0):
    roles = {"a": 0, "b": 1, "c": 2}
    fractions = dict.fromkeys(roles, fraction)
    return swap_roles(roles, potentials, fractions, LADDER, is_odd=is_odd, attempt=attempt)


def test_neighbours_swap_in_turns_when_the_colder_stands_worse():
    worse_and_worse = {"a": 9.0, "b": 5.0, "c": 1.0}
    assert swapped(worse_and_worse) == {"a": 1, "b": 0, "c": 2}
    assert swapped(worse_and_worse, is_odd=True) == {"a": 0, "b": 2, "c": 1}


def test_roles_are_only_exchanged_never_lost():
    rng = np.random.default_rng(3)
    ladder = temperature_ladder(5, 0.01, 1.0)
    roles = {name: i for i, name in enumerate("abcde")}
    for i in range(50):
        potentials, fractions = ({name: float(rng.random()) for name in roles} for _ in range(2))
        roles = swap_roles(roles, potentials, fractions, ladder, is_odd=bool(i % 2))
        assert sorted(roles.values()) == [0, 1, 2, 3, 4]
