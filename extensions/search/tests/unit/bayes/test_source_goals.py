"""Goals of a belief: information against its definition, sum by sum, and goals that are worth their way."""

import math

import numpy as np
import pytest
from briefings import briefing, observation

from gslcosim_search.bayes.belief_search import (
    GoalNavigator,
    choose_goal,
    coarsen_belief,
    expected_information_bits,
    mass_around,
)
from gslcosim_search.beliefs import CellGrid, normalised
from gslcosim_search.motion.map_navigation import MapNavigator
from gslcosim_search.random_stream import RandomStream

GRID = CellGrid((1.0, -1.0), 0.5, (6, 4))
ALL = np.ones(GRID.shape, bool)
RNG = np.random.default_rng(1)


def entropy(q):
    return 0.0 if q in (0.0, 1.0) else -q * math.log2(q) - (1.0 - q) * math.log2(1.0 - q)


def test_information_is_the_mutual_information_of_source_and_finding():
    p, chance = normalised(RNG.uniform(size=GRID.shape)), RNG.uniform(size=(11, 7))
    found = expected_information_bits(p, chance)
    for x in np.ndindex(GRID.shape):
        seen = {s: chance[s[0] - x[0] + 5, s[1] - x[1] + 3] for s in np.ndindex(GRID.shape)}
        q = sum(p[s] * seen[s] for s in seen)
        expected = entropy(q) - sum(p[s] * entropy(seen[s]) for s in seen)
        assert found[x] == pytest.approx(expected, abs=2e-9)


def test_mass_around_a_cell_is_the_sum_of_the_square_about_it():
    p = RNG.uniform(size=(7, 5))
    for reach in (0, 1, 2, 9):
        found = mass_around(p, reach)
        for i, j in np.ndindex(p.shape):
            expected = p[max(0, i - reach) : i + reach + 1, max(0, j - reach) : j + reach + 1].sum()
            assert found[i, j] == pytest.approx(expected)


def test_the_best_goal_is_the_worth_for_the_way():
    worth = np.full(GRID.shape, 0.1)
    worth[5, 3], worth[1, 0] = 1.0, 0.8
    here_m = GRID.centre_m((0, 0))
    assert choose_goal(worth, GRID, ALL, here_m, near_m=math.inf) == pytest.approx(GRID.centre_m((5, 3)))
    assert choose_goal(worth, GRID, ALL, here_m, near_m=1.0) == pytest.approx(GRID.centre_m((1, 0)))
    assert choose_goal(worth, GRID, ALL, here_m, near_m=1.0, least_m=1.0) == pytest.approx(GRID.centre_m((5, 3)))


def test_only_allowed_cells_are_goals_and_near_ones_are_when_there_are_no_others():
    worth, allowed = np.zeros(GRID.shape), np.zeros(GRID.shape, bool)
    worth[5, 3], allowed[2, 2] = 1.0, True
    here_m = GRID.centre_m((2, 2))
    assert choose_goal(worth, GRID, allowed, here_m, near_m=1.0, least_m=0.4) == pytest.approx(here_m)


def test_equal_goals_go_to_the_first():
    worth = np.ones(GRID.shape)
    assert choose_goal(worth, GRID, ALL, (0.0, 0.0), near_m=math.inf) == pytest.approx(GRID.centre_m((0, 0)))


def test_coarser_cells_hold_the_mass_of_their_block():
    p = normalised(RNG.uniform(size=(7, 5)))
    summed, grid = coarsen_belief(p, CellGrid((0.0, 0.0), 0.2, (7, 5)), least_cell_m=0.5)
    assert grid.shape == (3, 2)
    assert grid.cell_m == pytest.approx(0.6)
    assert summed[0, 0] == pytest.approx(p[:3, :3].sum())
    assert summed[2, 1] == pytest.approx(p[6:, 3:].sum())
    same, _ = coarsen_belief(p, CellGrid((0.0, 0.0), 0.5, (7, 5)), least_cell_m=0.5)
    assert np.array_equal(same, p)


def flights(known_map=None, **options):
    agent_briefing = briefing(known_map=known_map)
    made = MapNavigator(agent_briefing, RandomStream(1), cell_m=0.5, max_cells=5000, clearance_m=0.3, margin_m=0.5)
    return GoalNavigator(made, step_m=1.0, **options)


def test_a_leg_goes_a_step_towards_the_goal_or_to_it():
    goals = flights()
    here = observation(position_m=(7.0, 5.0, 2.0))
    assert goals.leg(here, (10.25, 5.25)).position_world_m[0] == pytest.approx(8.0, abs=0.02)
    near = goals.leg(here, (7.25, 5.25), hold_s=0.5)
    assert near.position_world_m == pytest.approx((7.25, 5.25, 2.0))
    assert near.hold_s == 0.5


def test_a_refused_goal_and_what_is_near_it_are_given_up_until_nothing_is_left():
    goals = flights()
    here = observation(position_m=(7.0, 5.0, 2.0))
    goals.leg(here, (10.25, 5.25))
    assert goals.is_goal((10.25, 5.25))
    goals.note_refusal(here)
    assert goals.is_goal((10.25, 5.25))
    goals.note_refusal(observation(notice="in an obstacle"))
    assert not goals.is_goal((10.25, 5.25))
    assert goals.is_goal((12.25, 5.25))
    assert not goals.is_goal((100.0, 5.0))
    everything = flights(radius_m=100.0)
    everything.leg(here, (10.25, 5.25))
    everything.note_refusal(observation(notice="in an obstacle"))
    assert everything.is_goal((10.25, 5.25))
