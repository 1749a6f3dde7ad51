"""Offsets in the frame of the wind, and what is looked up and believed there."""

import math

import numpy as np
import pytest

from gslcosim_search.information.pomdp import (
    MOVES,
    OffsetGrid,
    PlumeTable,
    RunningWind,
    headings_rad,
    offsets_m,
    update_offset_belief,
)

GRID = OffsetGrid(first_m=(-2.0, -3.0), cell_m=1.0, shape=(6, 7))
NORTH_RAD = math.pi / 2


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


def test_levels_of_an_offset_are_a_distribution():
    places = np.random.default_rng(3).uniform(-9.0, 9.0, size=(30, 2))
    assert sum(table().likelihood(level, places) for level in (0, 1)) == pytest.approx(np.ones(30))
    assert [table().level_of(ppm) for ppm in (0.0, 0.5, 0.6)] == [0, 0, 1]


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
