import math

import numpy as np
import pytest

from gslcosim_search.beliefs import CellGrid
from gslcosim_search.maps.gr_gsl import GrGsl, GrGslSettings, information_gain_nats

EAST, NORTH, WEST = 0.0, 0.5 * math.pi, math.pi


def method(free: np.ndarray, **settings) -> GrGsl:
    return GrGsl(free, CellGrid((0.0, 0.0), 0.25, free.shape), GrGslSettings(**settings))


def open_room() -> np.ndarray:
    return np.ones((31, 31), bool)


def room_with_wall() -> np.ndarray:
    """A wall at x = 10 up to y = 24; what lies behind it is reached round its upper end only."""
    free = open_room()
    free[10, :24] = False
    return free


def centre(cell) -> tuple[float, ...]:
    return tuple(0.25 * (i + 0.5) for i in cell)


def test_a_hit_favours_cells_upwind_by_their_direction():
    gsl = method(open_room())
    gsl.update(centre((15, 15)), is_hit=True, downwind_rad=EAST)
    p = gsl.p
    west, east, north = p[2, 15], p[28, 15], p[15, 28]
    assert east / west == pytest.approx(math.exp(-0.5 * math.pi**2), rel=1e-6)
    assert north / west == pytest.approx(math.exp(-0.5 * (0.5 * math.pi) ** 2), rel=1e-6)
    assert p[15, 15] == p[16, 15] == p.max()  # the core


def test_a_miss_moves_belief_back_towards_the_last_hit():
    gsl = method(open_room(), sigma_miss_rad=1.0)
    gsl.update(centre((15, 15)), is_hit=True, downwind_rad=NORTH)
    before = gsl.p
    gsl.update(centre((15, 10)), is_hit=False, downwind_rad=NORTH)
    change = gsl.p / before
    assert change[15, 25] == change.max()
    assert change[15, 2] / change[15, 25] == pytest.approx(math.exp(-0.5 * math.pi**2), rel=1e-6)
    assert change[15, 10] == change.min()  # nor is it where there was none


def test_a_miss_before_any_hit_says_only_that_the_source_is_not_here():
    gsl = method(open_room())
    gsl.update(centre((15, 15)), is_hit=False, downwind_rad=EAST)
    lowered = gsl.p < gsl.p.max()
    assert lowered[14:17, 14:17].all()
    assert lowered.sum() == 9


def test_a_hit_in_front_of_a_wall_changes_what_is_behind_by_the_way_round_its_end_only():
    """The wind seems to come through the wall: cells behind it get what the path to them gets."""
    free = room_with_wall()
    gsl = method(free)
    gsl.update(centre((15, 5)), is_hit=True, downwind_rad=EAST)
    weight = gsl.p / gsl.p.max()
    behind = np.zeros_like(free)
    behind[:10, :20] = True
    round_the_end = math.exp(-0.5 * (0.5 * math.pi) ** 2)  # the way leads north
    assert weight[behind].max() == pytest.approx(weight[behind].min())
    assert round_the_end <= weight[behind].max() < 0.75
    assert weight[11, 5] == pytest.approx(1.0)  # in front of the wall
    without_wall = method(open_room())
    without_wall.update(centre((15, 5)), is_hit=True, downwind_rad=EAST)
    assert (without_wall.p / without_wall.p.max())[5, 5] == pytest.approx(1.0)


def test_only_cells_near_places_visited_are_candidates_and_the_most_likely_lies_upwind():
    gsl = method(open_room(), reach_cells=3.0, candidates=1000)
    gsl.update(centre((15, 15)), is_hit=True, downwind_rad=EAST)
    assert all(0 < math.dist(cell, (15, 15)) <= 3.0 for cell in gsl.candidates())
    assert gsl.most_likely(centre((15, 15))) == (12, 15)
    gsl.give_up(centre((12, 15)))
    assert gsl.most_likely(centre((15, 15))) != (12, 15)


def test_cells_that_cannot_be_flown_to_are_no_goals_but_may_hold_the_source():
    flyable = np.zeros((31, 31), bool)
    flyable[14:17] = True
    gsl = GrGsl(open_room(), CellGrid((0.0, 0.0), 0.25, (31, 31)), flyable=flyable)
    gsl.update(centre((15, 15)), is_hit=True, downwind_rad=EAST)
    assert {i for i, _ in gsl.candidates()} == {14, 15, 16}
    assert gsl.p[2, 15] > 0.0


def test_without_a_cell_in_reach_there_is_no_goal():
    gsl = method(open_room())
    assert gsl.most_likely(centre((15, 15))) is None
    assert gsl.most_informative(np.zeros((31, 31, 2))) is None


def test_the_most_telling_place_is_downwind_of_where_the_source_may_be():
    """The belief is even over two halves of a corridor; only a place between them, in the wind, tells them apart."""
    free = np.zeros((31, 9), bool)
    free[:, 3:6] = True
    gsl = method(free, reach_cells=30.0)
    gsl.update(centre((15, 4)), is_hit=False, downwind_rad=None)
    wind_m_s = np.zeros((31, 9, 2))
    wind_m_s[..., 0] = 0.5
    i, _ = gsl.most_informative(wind_m_s)
    assert 8 <= i <= 22


def test_the_gain_is_that_of_its_definition():
    p = np.array([0.2, 0.5, 0.3, 0.0])
    hit, miss = np.array([0.9, 0.1, 0.4, 0.2]), np.array([0.3, 0.8, 1.0, 0.5])
    chance = float((p * hit).sum())
    gain = 0.0
    for share, weight in ((chance, hit), (1.0 - chance, miss)):
        after = p * weight / (p * weight).sum()
        for q, b in zip(after[:3], p[:3]):
            gain += share * (q * math.log(q / b) + (1.0 - q) * math.log((1.0 - q) / (1.0 - b)))
    assert information_gain_nats(p, hit, miss) == pytest.approx(gain, rel=1e-12)
    assert information_gain_nats(p, np.ones(4), np.ones(4)) == 0.0


def test_a_hit_in_calm_air_is_where_the_last_hit_was():
    gsl = method(open_room())
    gsl.update(centre((15, 15)), is_hit=True, downwind_rad=None)
    assert gsl.last_hit_m == pytest.approx(centre((15, 15)))
    assert gsl.p.max() == pytest.approx(gsl.p.min())
