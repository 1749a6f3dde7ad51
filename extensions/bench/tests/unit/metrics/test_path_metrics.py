"""Ways against closed forms and brute force, and the laws that their figures keep."""

import math

import numpy as np
import pytest

from gslcosim_bench.metrics.path_metrics import (
    directness,
    find_leading_agent,
    path_length_m,
    spl,
    time_within_s,
    times_within_s,
    tracking_phase,
    travel_overhead,
)
from gslcosim_services.referee import metrics


def random_track(rng, n=30):
    return rng.normal(size=(n, 3)).cumsum(axis=0)


def test_the_length_of_a_track_is_the_sum_of_its_legs():
    assert path_length_m([(0, 0, 0), (3, 4, 0), (3, 4, 12)]) == 17.0
    assert path_length_m([(1, 2, 3)]) == 0.0


def test_the_first_time_within_a_radius_is_a_tick_as_with_the_referee_and_the_radius_itself_is_within():
    t_s, distance_m = [0.0, 0.1, 0.2, 0.3], [6.0, 3.0, 1.0, 2.0]
    assert times_within_s(t_s, distance_m) == (0.1, 0.2, 0.2, None)
    assert time_within_s(t_s, distance_m, 1.0) == 0.2
    assert time_within_s(t_s, distance_m, math.nextafter(1.0, 0.0)) is None


def test_a_wider_radius_is_entered_no_later():
    rng = np.random.default_rng(3)
    for _ in range(20):
        distance_m = np.abs(rng.normal(size=40).cumsum())
        times_s = times_within_s(np.arange(40.0), distance_m, (4.0, 2.0, 1.0, 0.5))
        seen_s = [math.inf if time_s is None else time_s for time_s in times_s]
        assert seen_s == sorted(seen_s)


def test_the_first_to_succeed_stands_for_a_swarm_or_else_the_nearest():
    assert find_leading_agent([None, 30.0, 20.0], [0.1, 1.0, 1.0]) == 2
    assert find_leading_agent([None, None, None], [4.0, 2.0, 2.0]) == 1


def test_spl_of_three_runs_by_hand():
    """Twice the shortest path is worth a half, the shortest path 1, a failure nothing."""
    assert spl(20.0, 10.0, success=True) == 0.5
    assert spl(10.0, 10.0, success=True) == 1.0
    assert spl(1.0, 10.0, success=False) == 0.0


def test_spl_at_its_edges():
    # Ways on cells are a little too long: a run may be shorter, which is not worth more than 1.
    assert spl(9.9, 10.0, success=True) == 1.0
    assert spl(0.0, 0.0, success=True) == 1.0
    assert spl(5.0, None, success=True) is None
    assert spl(5.0, None, success=False) == 0.0


def test_overhead_is_the_referees_and_absent_without_success():
    assert travel_overhead(24.0, 12.0, success=True) == metrics.movement_overhead(24.0, 12.0) == 1.0
    assert travel_overhead(24.0, 12.0, success=False) is None
    assert travel_overhead(24.0, None, success=True) is None


def test_directness_is_the_sum_over_steps_of_equation_7_1():
    rng = np.random.default_rng(5)
    for _ in range(20):
        track = random_track(rng) * (1.0, 1.0, 0.0)
        source = np.array([*rng.normal(size=2) * 9, 0.0])
        steps, line = np.diff(track, axis=0), source - track[0]
        r = np.linalg.norm(steps, axis=1)
        theta = np.arctan2(steps[:, 1], steps[:, 0]) - np.arctan2(line[1], line[0])
        vector = np.array([(r * np.cos(theta)).sum(), -(r * np.sin(theta)).sum()]) / r.sum()
        figures = directness(track, source)
        assert figures.towards == pytest.approx(vector[0])
        assert figures.magnitude == pytest.approx(np.hypot(*vector))
        assert figures.angle_rad == pytest.approx(abs(np.arctan2(vector[1], vector[0])))


def test_directness_of_straight_runs():
    away = directness([(0, 0, 0), (-2, 0, 0)], [(5, 0, 0)])
    assert (away.towards, away.magnitude, away.angle_rad) == (-1.0, 1.0, pytest.approx(math.pi))
    across = directness([(0, 0, 0), (0, 0, 3)], [(5, 0, 0)])
    assert (across.towards, across.magnitude, across.angle_rad) == (0.0, 1.0, pytest.approx(math.pi / 2))
    back = directness([(0, 0, 0), (4, 0, 0), (0, 0, 0)], [(5, 0, 0)])
    assert (back.towards, back.magnitude, back.angle_rad) == (0.0, 0.0, 0.0)


def test_directness_in_the_plane_leaves_the_height_of_the_source_out():
    track = [(0, 0, 4), (2, 0, 4)]
    assert directness(track, [(3, 0, 0)], is_horizontal=True).towards == pytest.approx(1.0)
    assert directness(track, [(3, 0, 0)]).towards == pytest.approx(0.6)


def test_directness_takes_the_length_that_the_world_counted():
    assert directness([(0, 0, 0), (2, 0, 0)], [(5, 0, 0)], length_m=4.0).towards == 0.5


def test_directness_is_absent_without_a_way_or_a_direction():
    assert directness([(0, 0, 0), (0, 0, 0)], [(5, 0, 0)]) is None
    assert directness([(0, 0, 0), (1, 0, 0)], [(0, 0, 0)]) is None


def test_the_tracking_phase_begins_with_the_first_contact():
    track = np.arange(12.0).reshape(4, 3)
    np.testing.assert_array_equal(tracking_phase([0, 1, 2, 3], track, 2.0), track[2:])
    assert tracking_phase([0, 1, 2, 3], track, None) is None
    assert tracking_phase([0, 1, 2, 3], track, 3.5) is None
