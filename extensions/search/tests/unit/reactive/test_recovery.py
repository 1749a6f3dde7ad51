import itertools

import pytest

from gslcosim_search.random_stream import RandomStream
from gslcosim_search.reactive.temporal_memory import (
    DOWNWIND,
    LEFT,
    RIGHT,
    STEPS,
    UPWIND,
    Backtrack,
    CastSurge,
    Circling,
    make_recovery,
    opposite_move,
)


def moves(recovery, n):
    return [recovery.next_move() for _ in range(n)]


def place_after(made):
    return sum(STEPS[move][0] for move in made), sum(STEPS[move][1] for move in made)


@pytest.mark.parametrize("move", range(4))
def test_a_move_and_its_opposite_lead_back(move):
    assert place_after([move, opposite_move(move)]) == (0, 0)


def test_backtracking_leads_to_where_the_gas_was_and_then_anywhere():
    made = [UPWIND, UPWIND, LEFT, UPWIND, RIGHT]
    recovery = Backtrack(RandomStream(1), made)
    undone = moves(recovery, len(made))
    assert undone == [LEFT, DOWNWIND, RIGHT, DOWNWIND, DOWNWIND]
    assert place_after(made + undone) == (0, 0)
    assert set(moves(recovery, 100)) == {UPWIND, DOWNWIND, LEFT, RIGHT}


@pytest.mark.parametrize("seed", range(8))
def test_circling_runs_1_2_3_steps_and_turns_to_one_side(seed):
    runs = [(move, len(list(group))) for move, group in itertools.groupby(moves(Circling(RandomStream(seed)), 21))]
    assert [length for _, length in runs] == [1, 2, 3, 4, 5, 6]
    crosses = {STEPS[a][0] * STEPS[b][1] - STEPS[a][1] * STEPS[b][0] for (a, _), (b, _) in itertools.pairwise(runs)}
    assert crosses in ({1}, {-1})


def test_circling_begins_in_any_direction_and_turns_to_either_side():
    assert {tuple(moves(Circling(RandomStream(seed)), 3)[:2]) for seed in range(64)} == {
        (a, b) for a in range(4) for b in range(4) if b not in (a, opposite_move(a))
    }


@pytest.mark.parametrize("seed", range(8))
def test_cast_surge_runs_1_2_4_steps_across_with_one_upwind_between(seed):
    first, *rest = moves(CastSurge(RandomStream(seed)), 10)
    other = opposite_move(first)
    assert first in (LEFT, RIGHT)
    assert rest == [UPWIND, other, other, UPWIND, first, first, first, first, UPWIND]


@pytest.mark.parametrize(
    ("name", "expected"), [("backtrack", Backtrack), ("circling", Circling), ("cast_surge", CastSurge)]
)
def test_a_recovery_is_found_by_its_name(name, expected):
    assert isinstance(make_recovery(name, RandomStream(1), []), expected)
