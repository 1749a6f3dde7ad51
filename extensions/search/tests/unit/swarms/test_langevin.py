import math

import numpy as np
import pytest

from gslcosim_search.beliefs import CellGrid
from gslcosim_search.swarms.shared_belief import (
    LEAST_P,
    belief_potential,
    langevin_step_m,
    potential_slope,
    settle_roles,
    swap_probability,
    swap_roles,
    temperature_ladder,
)

GRID = CellGrid((0.0, 0.0), 0.5, (12, 10))
LADDER = (0.01, 0.1, 1.0)


def test_the_potential_falls_where_the_belief_rises_and_is_bounded_where_there_is_none():
    potential = belief_potential(np.array([0.5, 0.1, 0.0]))
    assert potential == pytest.approx([math.log(2.0), math.log(10.0), -math.log(LEAST_P)])


def test_the_slope_of_a_plane_is_exact_in_the_middle_and_at_the_rim():
    centres = GRID.centres_m().reshape(*GRID.shape, 2)
    plane = centres @ (1.5, -0.4)
    for point_m in [(3.1, 2.2), (0.0, 0.0), (5.99, 4.99), (-3.0, 50.0)]:
        assert potential_slope(plane, GRID, point_m) == pytest.approx([1.5, -0.4])


def test_a_grid_of_one_cell_has_no_slope():
    assert potential_slope(np.ones((1, 1)), CellGrid((0.0, 0.0), 1.0, (1, 1)), (0.5, 0.5)) == pytest.approx([0.0, 0.0])


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


def test_who_stands_well_keeps_its_role_and_nothing_is_tried_without_attempts():
    assert swapped({"a": 1.0, "b": 5.0, "c": 9.0}) == {"a": 0, "b": 1, "c": 2}
    assert swapped({"a": 9.0, "b": 5.0, "c": 1.0}, attempt=0.0) == {"a": 0, "b": 1, "c": 2}


def test_roles_are_only_exchanged_never_lost():
    rng = np.random.default_rng(3)
    ladder = temperature_ladder(5, 0.01, 1.0)
    roles = {name: i for i, name in enumerate("abcde")}
    for i in range(50):
        potentials, fractions = ({name: float(rng.random()) for name in roles} for _ in range(2))
        roles = swap_roles(roles, potentials, fractions, ladder, is_odd=bool(i % 2))
        assert sorted(roles.values()) == [0, 1, 2, 3, 4]
