import itertools
import json
import math

import numpy as np
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
    TemporalMemory,
    best_move,
    gas_state,
    load_policies,
    memory_features,
    opposite_move,
    rank_frac,
    void_state,
)


def test_the_share_counts_what_is_above_half_the_mean_and_the_noise():
    # The mean is 2.5, half of it 1.25: 2, 3 and 5 are above it.
    share, mean = memory_features(np.array([0.0, 2.0, 3.0, 5.0, 99.0]), 4, 0.1)
    assert share == 0.75
    assert mean == pytest.approx(10.0 / 3.0)
    assert memory_features(np.array([0.0, 2.0, 3.0, 5.0]), 4, 4.0) == (0.25, 5.0)


def test_a_memory_of_noise_or_of_nothing_is_void():
    assert memory_features(np.array([0.05, 0.1]), 2, 0.1) == (0.0, 0.0)
    assert memory_features(np.array([]), 0, 0.1) == (0.0, 0.0)


def test_the_rank_is_the_share_of_lesser_amounts():
    assert rank_frac(3.0, np.array([1.0, 2.0, 3.0, 4.0, 0.0]), 4) == 0.5
    assert rank_frac(3.0, np.array([]), 0) == 0.0


def test_every_state_is_reached_by_one_class_of_share_and_one_of_rank():
    shares, ranks = (0.2, 0.5, 0.9), (0.1, 0.3, 0.6, 0.9, 0.995)
    assert [gas_state(share, rank) for share in shares for rank in ranks] == list(range(15))


def test_decisions_in_the_void_count_up_to_the_last_state():
    assert [void_state(n) for n in (1, 2, 50, 51, 1000)] == [15, 16, 64, 64, 64]


def test_a_memory_looks_back_as_long_as_the_last_blank():
    memory = TemporalMemory(noise=0.1, first_s=5.0)
    for tick in range(1, 200):
        memory.add(tick / 10, 1.0 if tick % 30 == 0 else 0.0)
    assert memory.memory_s == pytest.approx(3.0)
    # One reading of thirty is gas: a share of 1/30, and no lesser amount was met.
    assert memory.decide(19.9) == 0


def test_more_gas_than_ever_in_all_of_the_memory_is_the_highest_state():
    memory = TemporalMemory(noise=0.1, first_s=1.0, adapts=False)
    for tick in range(1, 2000):
        memory.add(tick / 10, 1.0)
    for tick in range(2000, 2011):
        memory.add(tick / 10, 5.0)
    assert memory.decide(201.0) == 14


def test_the_void_is_counted_and_ends_with_gas():
    memory = TemporalMemory(noise=0.1, first_s=1.0, adapts=False)
    states = []
    for tick in range(1, 61):
        memory.add(tick / 10, 1.0 if tick == 40 else 0.0)
        if tick % 10 == 0:
            states.append(memory.decide(tick / 10))
    assert states == [15, 16, 17, 0, 15, 16]


def test_broken_and_repeated_readings_are_left_out():
    memory = TemporalMemory(noise=0.1, first_s=5.0)
    memory.add(1.0, math.inf)
    memory.add(1.0, math.nan)
    memory.add(1.1, 0.0)
    memory.add(1.1, 9.0)
    assert memory.decide(1.2) == 15


def test_policies_are_read_by_name(tmp_path):
    file = tmp_path / "policies.json"
    file.write_text(json.dumps({"tables": {"circling": [[0, 1, 0.5, 0]]}}))
    tables = load_policies(file)
    assert tables == {"circling": [[0.0, 1.0, 0.5, 0.0]]}
    assert best_move(tables["circling"][0]) == 1


def test_of_equal_moves_the_first_is_best():
    assert best_move([0.5, 0.7, 0.7, 0.1]) == 1


def moves(recovery, n):
    return [recovery.next_move() for _ in range(n)]


def place_after(made):
    return sum(STEPS[move][0] for move in made), sum(STEPS[move][1] for move in made)


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


@pytest.mark.parametrize("seed", range(8))
def test_cast_surge_runs_1_2_4_steps_across_with_one_upwind_between(seed):
    first, *rest = moves(CastSurge(RandomStream(seed)), 10)
    other = opposite_move(first)
    assert first in (LEFT, RIGHT)
    assert rest == [UPWIND, other, other, UPWIND, first, first, first, first, UPWIND]
