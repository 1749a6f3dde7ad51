import math

import numpy as np
import pytest
from pomdp_planning import (
    Pomdp,
    backup_at_belief,
    find_successors,
    improve_by_perseus,
    predict_belief,
    solve_by_value_iteration,
    update_belief,
)

from gslcosim_search.information.pomdp import (
    MOVES,
    OffsetGrid,
    PlumeTable,
    RunningWind,
    headings_rad,
    offsets_m,
    update_offset_belief,
)

LISTEN, OPEN_LEFT, OPEN_RIGHT = range(3)
G = 0.9
NORTH_RAD = math.pi / 2


def corridor(n: int = 5, discount: float = G) -> Pomdp:
    """Cells in a row; actions go down and up; stepping on the last one is worth 1 and ends the search."""
    cells = np.arange(n)
    successor = np.array([np.maximum(cells - 1, 0), np.minimum(cells + 1, n - 1)])
    return Pomdp(
        successor=successor,
        observed=np.array([np.full(n, 0.5), np.full(n, 0.5)]),
        reward=(successor == n - 1) * 1.0,
        is_terminal=cells == n - 1,
        discount=discount,
    )


def tiger(discount: float = 1.0) -> Pomdp:
    """The tiger is behind the left (0) or the right door (1); opening one ends it in state 2; listening costs 1."""
    return Pomdp(
        successor=np.array([[0, 1, 2], [2, 2, 2], [2, 2, 2]]),
        observed=np.array([[0.85, 0.15, 0.5], [0.15, 0.85, 0.5]]),
        reward=np.array([[-1.0, -1.0, 0.0], [-100.0, 10.0, 0.0], [10.0, -100.0, 0.0]]),
        is_terminal=np.array([False, False, True]),
        discount=discount,
    )


def test_a_corridor_is_worth_the_discount_to_the_power_of_the_steps_still_to_go():
    q = solve_by_value_iteration(corridor())
    assert q[1, :4] == pytest.approx([G**3, G**2, G, 1.0])
    assert q[0, :4] == pytest.approx([G**4, G**4, G**3, G**2])
    assert q[:, 4] == pytest.approx([0.0, 0.0])


def test_a_growl_moves_the_belief_as_bayes_says_and_opening_ends_it():
    even = np.array([0.5, 0.5, 0.0])
    after, probability = update_belief(even, tiger(), LISTEN, 0)
    assert after == pytest.approx([0.85, 0.15, 0.0])
    assert probability == pytest.approx(0.5)
    assert predict_belief(even, tiger(), OPEN_LEFT) == pytest.approx([0.0, 0.0, 1.0])
    nothing, never = update_belief(even, tiger(), OPEN_LEFT, 0)
    assert never == 0.0
    assert not nothing.any()


def test_three_backups_of_the_tiger_are_those_done_by_hand():
    """Two equal growls come with 0.85^2 + 0.15^2 = 0.745: worth opening, unlike two unequal ones."""
    problem = tiger()
    beliefs = np.array([[0.5, 0.5, 0.0], [0.85, 0.15, 0.0], [0.15, 0.85, 0.0],
                        [0.7225 / 0.745, 0.0225 / 0.745, 0.0], [0.0225 / 0.745, 0.7225 / 0.745, 0.0]])  # fmt: skip
    vectors, values, actions = np.zeros((1, 3)), [], []
    for _ in range(3):
        each = [backup_at_belief(belief, problem, vectors) for belief in beliefs]
        vectors = np.array([vector for vector, _ in each])
        values.append(vectors[0] @ beliefs[0])
        actions.append([action for _, action in each])
    assert values == pytest.approx([-1.0, -2.0, -2.0 + 0.7225 * 10 + 0.0225 * -100 - 0.255])
    assert actions[0] == [LISTEN, LISTEN, LISTEN, OPEN_RIGHT, OPEN_LEFT]
    assert actions[2][0] == LISTEN


def test_stages_of_perseus_never_lower_a_value_and_stay_below_what_a_seeing_searcher_gets():
    problem, rng = tiger(discount=0.95), np.random.default_rng(1)
    share = np.linspace(0.0, 1.0, 41)
    beliefs = np.stack([share, 1.0 - share, 0.0 * share], axis=1)
    vectors, actions = np.array([[-100.0, -100.0, 0.0]]), np.array([LISTEN])
    seeing = solve_by_value_iteration(problem).max(axis=0)
    last = (beliefs @ vectors.T).max(axis=1)
    for _ in range(30):
        vectors, actions = improve_by_perseus(problem, beliefs, vectors, actions, rng)
        now = (beliefs @ vectors.T).max(axis=1)
        assert (now >= last - 1e-9).all()
        last = now
    assert (last <= beliefs @ seeing + 1e-9).all()
    sure, even = vectors @ beliefs[0], vectors @ beliefs[20]
    assert actions[int(np.argmax(sure))] == OPEN_LEFT
    assert actions[int(np.argmax(even))] == LISTEN
    assert sure.max() == pytest.approx(10.0)


GRID = OffsetGrid(first_m=(-2.0, -3.0), cell_m=1.0, shape=(6, 7))


def test_successors_of_inner_cells_lie_one_cell_on_and_edges_hold():
    centres_m = GRID.centres_m().reshape(*GRID.shape, 2)
    successors = find_successors(GRID).reshape(4, *GRID.shape)
    for move, cells in zip(MOVES, successors, strict=True):
        there_m = GRID.centres_m()[cells]
        assert there_m[1:-1, 1:-1] - centres_m[1:-1, 1:-1] == pytest.approx(np.broadcast_to(move, (4, 5, 2)))
    assert successors[0, 0, 3] == 3


def test_a_certain_source_is_flown_to_by_the_values_of_the_search_problem():
    grid = OffsetGrid(first_m=(-4.0, -4.0), cell_m=1.0, shape=(9, 9))
    near = np.hypot(*grid.centres_m().T) < 0.5
    successor = find_successors(grid)
    problem = Pomdp(
        successor=successor,
        observed=np.ones((1, grid.n_cells)),
        reward=near[successor] * 1.0,
        is_terminal=near,
        discount=0.9,
    )
    q = solve_by_value_iteration(problem)
    steps = np.abs(grid.centres_m()).sum(axis=1)
    assert q.max(axis=0)[~near] == pytest.approx(0.9 ** (steps[~near] - 1))


def table() -> PlumeTable:
    along_m, across_m = GRID.centres_m().T
    gas = np.where((along_m > 0) & (np.abs(across_m) < 1), 0.8, 0.05)
    vectors = np.stack([along_m, -along_m, -across_m, across_m])
    return PlumeTable(
        thresholds_ppm=np.array([0.5]),
        grid=GRID,
        level_frac=np.stack([1.0 - gas, gas]),
        policy_grid=GRID,
        vectors={"home": vectors},
        actions={"home": np.arange(4)},
    )


def test_a_vehicle_downwind_and_to_the_left_has_positive_offsets():
    """The air goes north: downwind is +y, its left is -x."""
    seen = offsets_m(np.array([[5.0, 1.0], [4.0, 3.0]]), (3.0, 4.0), NORTH_RAD)
    assert seen == pytest.approx(np.array([[3.0, 2.0], [1.0, 1.0]]))


def test_moves_go_where_their_headings_point():
    for (along, across), heading_rad in zip(MOVES, headings_rad(NORTH_RAD), strict=True):
        step = offsets_m(np.zeros((1, 2)), (math.cos(heading_rad), math.sin(heading_rad)), NORTH_RAD)[0]
        assert step == pytest.approx([along, across], abs=1e-12)


def test_weights_that_are_gathered_keep_their_sum_and_their_mean():
    rng = np.random.default_rng(2)
    places = rng.uniform((-2.0, -3.0), (3.0, 3.0), size=(40, 2))
    weights = rng.random(40)
    cells = GRID.gathered(places, weights)
    assert cells.sum() == pytest.approx(weights.sum())
    assert cells @ GRID.centres_m() == pytest.approx(weights @ places)


def test_a_linear_table_is_looked_up_without_error_and_held_beyond_its_edge():
    linear = (GRID.centres_m() @ [2.0, -1.0] + 3.0)[None]
    assert GRID.looked_up(linear, np.array([[0.25, 1.4]]))[0] == pytest.approx([2.0 * 0.25 - 1.4 + 3.0])
    assert GRID.looked_up(linear, np.array([[99.0, 1.4]]))[0] == pytest.approx([2.0 * 3.0 - 1.4 + 3.0])


def test_a_power_below_one_takes_an_observation_for_less_and_an_impossible_one_for_nothing():
    belief = np.array([0.5, 0.5])
    assert update_offset_belief(belief, np.array([0.9, 0.1]), 0.5) == pytest.approx([0.75, 0.25])
    assert update_offset_belief(belief, np.zeros(2)) == pytest.approx(belief)


def test_a_table_comes_back_from_its_file(tmp_path):
    saved = table()
    saved.save(tmp_path / "table.npz")
    loaded = PlumeTable.load(tmp_path / "table.npz")
    assert loaded.grid == saved.grid
    assert loaded.policy_grid == saved.policy_grid
    assert loaded.level_frac == pytest.approx(saved.level_frac, abs=1e-3)
    assert loaded.level_frac.sum(axis=0) == pytest.approx(np.ones(GRID.n_cells))
    assert loaded.vectors["home"] == pytest.approx(saved.vectors["home"])
    places, belief = np.array([[2.0, 0.0], [1.0, 2.0]]), np.array([0.75, 0.25])
    assert loaded.action_values("home", belief, places) == pytest.approx([1.75, -1.75, -0.5, 0.5])


def test_a_running_wind_follows_a_turn_with_its_memory():
    wind = RunningWind(memory_s=10.0)
    wind.add(0.0, 0.5, math.pi)
    assert wind.downwind_rad == pytest.approx(0.0)
    wind.add(10.0 * math.log(2.0), 0.5, -NORTH_RAD)
    assert wind.downwind_rad == pytest.approx(math.pi / 4)


def test_gusts_that_cancel_leave_the_last_direction_and_none_leaves_none():
    calm, gusty = RunningWind(memory_s=1e-3), RunningWind(memory_s=1e-3)
    calm.add(0.0, 0.09, 1.0)
    assert calm.downwind_rad is None
    gusty.add(0.0, 0.5, math.pi)
    gusty.add(9.0, 0.05, 1.0)
    assert gusty.downwind_rad == pytest.approx(0.0)
