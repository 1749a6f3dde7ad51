import math

import numpy as np
import pytest

from gslcosim_search.swarms.formations import (
    SHAPES,
    centre_m,
    diagonal_line,
    fit_plane,
    formation,
    hexagon,
    in_world,
    inverted_v,
    laplacian_leg_m,
    laplacian_velocity_m_s,
    mixed_direction,
    next_width,
    odour_offset_m,
)

GAINS = {"formation_per_s": 0.4, "upwind_m_s": 0.3, "odour_per_s": 0.2}


def distances(places):
    return np.hypot(*(places[None, :, :] - places[:, None, :]).transpose(2, 0, 1))


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("n", range(1, 9))
def test_slots_are_centred_and_no_two_robots_share_one(shape, n):
    slots = formation(shape, n, 1.5)
    assert slots.shape == (n, 2)
    assert slots.mean(axis=0) == pytest.approx(0.0, abs=1e-12)
    apart = distances(slots) + 99.0 * np.eye(n)
    assert apart.min() > 0.5


def test_an_unknown_shape_is_named_with_the_known_ones():
    with pytest.raises(ValueError, match=r"expected one of ring, square, .*, was star"):
        formation("star", 3, 1.0)


def test_a_diagonal_line_has_equal_spacing_along_and_across_the_wind():
    assert np.diff(diagonal_line(4, 2.0), axis=0) == pytest.approx(2.0)


def test_the_first_of_an_inverted_v_is_upwind_of_all_and_the_arms_are_mirrored():
    slots = inverted_v(5, 1.0)
    assert np.all(slots[0, 0] > slots[1:, 0])
    assert slots[1::2, 1] == pytest.approx(-slots[2::2, 1])
    assert slots[1::2, 0] == pytest.approx(slots[2::2, 0])


def test_neighbours_in_a_hexagon_are_a_radius_apart():
    apart = distances(hexagon(0.8)) + 99.0 * np.eye(7)
    assert apart.min(axis=1) == pytest.approx(0.8)


def test_slots_turn_with_the_wind():
    upwind_and_left = np.array([[1.0, 0.0], [0.0, 1.0]])
    assert in_world(upwind_and_left, math.pi / 2.0) == pytest.approx(np.array([[0.0, 1.0], [-1.0, 0.0]]), abs=1e-12)


def test_the_centre_is_found_though_some_robots_are_missing():
    offsets = formation("hexagon", 7, 1.0)
    some = [0, 2, 3]
    assert centre_m(offsets[some] + np.array((4.0, 5.0)), offsets[some]) == pytest.approx([4.0, 5.0])


@pytest.mark.parametrize("n", [3, 4, 7])
def test_a_plane_comes_back_exactly(n):
    positions = np.random.default_rng(n).uniform(0.0, 10.0, (n, 2))
    fit = fit_plane(positions, 3.0 + positions @ (0.7, -0.2))
    assert fit.gradient_per_m == pytest.approx((0.7, -0.2))
    assert fit.mean == pytest.approx(3.0 + positions.mean(axis=0) @ (0.7, -0.2))
    assert fit.residual == pytest.approx(0.0, abs=1e-9)
    assert fit.problem == ""


def test_what_no_plane_fits_is_in_the_residual():
    square = np.array([[1.0, 1.0], [1.0, -1.0], [-1.0, -1.0], [-1.0, 1.0]])
    fit = fit_plane(square, np.array([1.0, -1.0, 1.0, -1.0]))
    assert fit.gradient_per_m == pytest.approx((0.0, 0.0), abs=1e-12)
    assert fit.residual == pytest.approx(1.0)


@pytest.mark.parametrize("across", [0.0, 1e-9, 0.02])
def test_robots_in_a_line_are_refused_with_a_reason(across):
    positions = np.array([[0.0, 0.0], [1.0, across], [2.0, 0.0]])
    fit = fit_plane(positions, np.array([1.0, 2.0, 3.0]))
    assert fit.gradient_per_m is None
    assert "the 3 were in a line" in fit.problem


def test_robots_in_one_place_two_robots_and_none_are_refused_with_a_reason():
    assert "in a line" in fit_plane(np.ones((3, 2)), np.arange(3.0)).problem
    assert "there were 2" in fit_plane(np.eye(2), np.arange(2.0)).problem
    assert "there were none" in fit_plane(np.empty((0, 2)), np.empty(0)).problem


def test_directions_mix_by_their_share_and_one_alone_is_enough():
    assert mixed_direction((0.0, 9.0), 0.0, 0.5) == pytest.approx(np.array([1.0, 1.0]) / math.sqrt(2.0))
    assert mixed_direction((0.0, 9.0), 0.0, 0.0) == pytest.approx([0.0, 1.0])
    assert mixed_direction(None, 0.0, 0.0) == pytest.approx([1.0, 0.0])
    assert mixed_direction((0.0, 2.0), None, 1.0) == pytest.approx([0.0, 1.0])
    assert mixed_direction((-3.0, 0.0), 0.0, 0.5) is None
    assert mixed_direction((0.0, 0.0), None, 0.5) is None


def velocities(positions, offsets, upwind_rad, odour_m):
    return np.array([
        laplacian_velocity_m_s(i, positions, offsets, upwind_rad, odour_m, **GAINS) for i in range(len(positions))
    ])  # fmt: skip


@pytest.mark.parametrize("shape", SHAPES)
def test_a_formation_in_its_places_moves_as_one(shape):
    """The shape is the equilibrium of the law: no robot moves against another."""
    offsets = in_world(formation(shape, 5, 1.0), 0.7)
    speeds = velocities(offsets + np.array((3.0, 4.0)), offsets, 0.7, 0.0)
    assert speeds == pytest.approx(np.tile(0.3 * np.array([math.cos(0.7), math.sin(0.7)]), (5, 1)))


def test_the_centre_moves_upwind_with_its_gain_however_disordered_the_robots_are():
    rng = np.random.default_rng(1)
    offsets = formation("ring", 4, 1.0)
    speeds = velocities(rng.uniform(0.0, 9.0, (4, 2)), offsets, math.pi, 0.0)
    assert speeds.mean(axis=0) == pytest.approx([-0.3, 0.0])


def test_odour_on_the_left_moves_the_centre_to_the_left():
    offsets = formation("ring", 4, 1.0)
    speeds = velocities(offsets, offsets, math.pi, 1.5)
    # Looking upwind, to -x, left is -y.
    assert speeds.mean(axis=0) == pytest.approx([-0.3, -0.2 * 1.5])


def test_disordered_robots_take_their_places():
    rng = np.random.default_rng(2)
    offsets = formation("hexagon", 7, 1.0)
    positions = rng.uniform(0.0, 5.0, (7, 2))
    for _ in range(100):
        positions = positions + 0.2 * velocities(positions, offsets, 0.0, 0.0)
    assert positions - positions.mean(axis=0) == pytest.approx(offsets, abs=1e-3)


def test_the_odour_lies_where_the_gas_is_and_nowhere_without_gas():
    positions = np.array([[5.0, 1.0], [5.0, 2.0], [5.0, 3.0]])
    assert odour_offset_m(positions, np.array([0.0, 0.0, 4.0]), 0.0) == pytest.approx(1.0)
    assert odour_offset_m(positions, np.array([0.0, 0.0, 4.0]), math.pi) == pytest.approx(-1.0)
    assert odour_offset_m(positions, np.array([2.0, 2.0, 2.0]), 0.0) == pytest.approx(0.0)
    assert odour_offset_m(positions, np.zeros(3), 0.0) == 0.0


@pytest.mark.parametrize(
    ("smells", "width"),
    [([0, 1, 0, 0, 0], 1.1), ([1, 0, 0, 0, 0], 1.0 / 1.1), ([0, 0, 0, 0, 0], 1.0), ([1, 1, 1, 1, 1], 1.1)],
)
def test_a_formation_widens_when_its_edge_smells_and_narrows_when_only_its_middle_does(smells, width):
    slots = formation("square", 5, 1.0)
    changed = next_width(1.0, slots, np.array(smells, bool), change_frac=0.1, least=0.5, most=2.0)
    assert changed == pytest.approx(width)


def test_the_width_keeps_within_its_limits():
    slots = formation("square", 5, 1.0)
    assert next_width(1.95, slots, np.ones(5, bool), change_frac=0.1, least=0.5, most=2.0) == 2.0
    middle = np.array([True, False, False, False, False])
    assert next_width(0.51, slots, middle, change_frac=0.1, least=0.5, most=2.0) == 0.5


def legs(positions, offsets, dt_s):
    return np.array([
        laplacian_leg_m(i, positions, offsets, 0.0, 0.5, dt_s=dt_s, **GAINS) for i in range(len(positions))
    ])  # fmt: skip


def test_a_short_leg_is_the_law_times_its_duration():
    positions, offsets = np.random.default_rng(5).uniform(0.0, 5.0, (5, 2)), formation("square", 5, 1.0)
    assert legs(positions, offsets, 1e-6) / 1e-6 == pytest.approx(velocities(positions, offsets, 0.0, 0.5), rel=1e-4)


def test_a_long_leg_ends_in_the_formation_and_never_beyond():
    positions, offsets = np.random.default_rng(6).uniform(0.0, 5.0, (5, 2)), formation("square", 5, 1.0)
    ends = positions + legs(positions, offsets, 30.0)
    assert ends - ends.mean(axis=0) == pytest.approx(offsets - offsets.mean(axis=0), abs=1e-6)
    assert ends.mean(axis=0) - positions.mean(axis=0) == pytest.approx([30.0 * 0.3, 30.0 * 0.2 * 0.5])
