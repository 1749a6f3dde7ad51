import math

import numpy as np
import pytest

from gslcosim_search.swarms.particle_swarm import (
    Charge,
    Sighting,
    Stagnation,
    SwarmWeights,
    better,
    charge_velocity,
    fade_amount,
    limit_length,
    pso_velocity,
    repelled_velocity,
    rotate_out_of_downwind,
    shorten_downwind,
)

WEIGHTS = SwarmWeights(inertia=0.5, own=1.0, swarm=2.0)
ROOM_CHARGE = Charge(squared_m3=1.0, core_m=1.0, reach_m=5.0)
EAST = np.array([1.0, 0.0])


def at(*metres: float) -> np.ndarray:
    return np.array(metres, dtype=np.float64)


def degrees(vector) -> float:
    return math.degrees(math.atan2(vector[1], vector[0]))


def step_at(angle_deg: float, length_m: float = 2.0) -> np.ndarray:
    return length_m * at(math.cos(math.radians(angle_deg)), math.sin(math.radians(angle_deg)))


def test_iterates_with_given_random_numbers_are_those_worked_out_by_hand():
    """Two iterations from x = (0, 0), v = (1, 2), p = (2, 0), g = (4, 4), with r fixed.

    v1 = 0.5 (1, 2) + (0.5, 0.25) o (2, 0) + 2 (0.25, 0.5) o (4, 4) = (0.5, 1) + (1, 0) + (2, 4) = (3.5, 5)
    x1 = (3.5, 5); the particle keeps p and g:
    v2 = 0.5 (3.5, 5) + (1, 1) o (-1.5, -5) + 2 (0.5, 0) o (0.5, -1) = (1.75, 2.5) + (-1.5, -5) + (0.5, 0)
       = (0.75, -2.5), x2 = (4.25, 2.5)
    """
    place, velocity, own, swarm = at(0, 0), at(1, 2), at(2, 0), at(4, 4)
    first = pso_velocity(velocity, place, own, swarm, weights=WEIGHTS, draws=np.array([[0.5, 0.25], [0.25, 0.5]]))
    assert first.tolist() == [3.5, 5.0]
    place = place + first
    second = pso_velocity(first, place, own, swarm, weights=WEIGHTS, draws=np.array([[1.0, 1.0], [0.5, 0.0]]))
    assert second.tolist() == [0.75, -2.5]
    assert (place + second).tolist() == [4.25, 2.5]


def test_a_long_step_is_cut_to_a_leg_and_a_short_one_kept():
    assert limit_length(at(3, 4), 1.0) == pytest.approx([0.6, 0.8])
    assert limit_length(at(0.3, 0.4), 1.0).tolist() == [0.3, 0.4]


def test_neighbours_push_in_place_of_the_swarm():
    """v = (1, 0) and one robot at (-1, -0.75) from it: u = (1, 0) + (1, 0.75), of length sqrt(4.5625), to 0.5 m."""
    step = repelled_velocity(at(1, 0), at(5, 5), np.array([[4.0, 4.25], [0.0, 0.0]]), within_m=1.5, leg_m=0.5)
    assert step == pytest.approx(at(2.0, 0.75) * 0.5 / math.sqrt(4.5625))


@pytest.mark.parametrize(
    ("distance_m", "size"), [(0.25, 1.0), (0.999, 1.0), (1.0, 1.0), (2.0, 0.25), (5.0, 0.04), (5.001, 0.0)]
)
def test_the_charge_is_level_in_the_core_falls_with_the_square_and_ends(distance_m, size):
    push = charge_velocity(at(0, 0), at(distance_m, 0)[None], ROOM_CHARGE)
    assert push == pytest.approx([-size, 0.0])


def test_charges_add_up_and_balance():
    both = charge_velocity(at(0, 0), np.array([[2.0, 0.0], [-2.0, 0.0], [0.0, 2.0]]), ROOM_CHARGE)
    assert both == pytest.approx([0.0, -0.25])
    assert charge_velocity(at(0, 0), at(0, 0)[None], ROOM_CHARGE).tolist() == [0.0, 0.0]


@pytest.mark.parametrize(
    ("angle_deg", "expected_deg"), [(0, 60), (20, 60), (-20, -60), (61, 61), (-100, -100), (180, 180)]
)
def test_a_step_into_the_forbidden_cone_turns_to_its_edge(angle_deg, expected_deg):
    turned = rotate_out_of_downwind(step_at(angle_deg), EAST, math.radians(60))
    assert degrees(turned) == pytest.approx(expected_deg)
    assert np.linalg.norm(turned) == pytest.approx(2.0)


@pytest.mark.parametrize(("angle_deg", "share"), [(0, 0.0), (90, 0.5), (-90, 0.5), (180, 1.0), (60, 0.25)])
def test_a_step_down_the_wind_is_slowed(angle_deg, share):
    assert shorten_downwind(step_at(angle_deg), EAST) == pytest.approx(share * step_at(angle_deg), abs=1e-12)


def test_calm_air_and_no_step_change_nothing():
    for rule in (shorten_downwind, lambda v, w: rotate_out_of_downwind(v, w, math.radians(60))):
        assert rule(at(1, 2), at(0, 0)).tolist() == [1.0, 2.0]
        assert rule(at(0, 0), EAST).tolist() == [0.0, 0.0]


def test_bests_fade_by_e_in_their_time_and_not_at_all_without_one():
    assert fade_amount(5.0, 60.0, 60.0) == pytest.approx(5.0 / math.e)
    assert fade_amount(5.0, 1e6, 0.0) == 5.0
    assert fade_amount(5.0, -10.0, 60.0) == 5.0


def test_a_best_stays_where_it_was_after_a_worse_reading():
    """A best that shares memory with the particle's place would move on with it."""
    place = at(1, 2)
    best = better(None, Sighting(tuple(place), 5.0, 0.0))
    place += 3.0
    best = better(best, Sighting(tuple(place), 4.0, 1.0))
    assert best is not None
    assert best.place_m == (1.0, 2.0)
    assert best.amount == 5.0


def test_a_faded_best_gives_way_to_less_gas_that_is_there_now():
    old, new = Sighting((0.0, 0.0), 5.0, 0.0), Sighting((1.0, 0.0), 4.0, 60.0)
    assert better(old, new, fades_s=60.0) == new
    assert better(old, new) == old
    assert better(old, Sighting((1.0, 0.0), 5.0, 60.0)) == old
    assert better(None, None) is None


def test_a_best_that_stays_for_k_iterations_is_noticed_once():
    watch = Stagnation(3)
    best = Sighting((1.0, 2.0), 5.0, 0.0)
    noticed = [t for t in range(9) if watch.note(best.faded(t, 60.0))]
    assert noticed == [3, 7]
