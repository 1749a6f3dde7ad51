"""Large eddies: variance, no divergence, still at walls, the same for all who ask."""

import dataclasses

import numpy as np
import pytest
from built_rooms import build_air
from scipy.interpolate import BSpline

from gslcosim.environment.grid_kernels import trilinear_wind
from gslcosim.environment.model import Cell
from gslcosim_services.fields.turbulence.air import (
    KEpsilonFields,
    build_turbulent_air,
    eddy_velocity_at,
    k_epsilon_from_intensity,
)
from gslcosim_services.fields.turbulence.eddies import (
    AMPLITUDE,
    SHEAR_SQUARE,
    EddyScales,
    LargeEddies,
    draw_vectors,
)
from gslcosim_services.fields.turbulence.point_turbulence import turbulent_wind_at_points
from gslcosim_services.fields.turbulence.vector_kernels import N_LATTICE, N_SUMS, PADDED

CELL_M = 0.25


def make_room(shape=(24, 20, 16), *, is_solid=None):
    occupancy = np.zeros(shape, np.uint8)
    if is_solid is not None:
        occupancy[is_solid] = Cell.SOLID
    x, y, _ = ((np.arange(n) + 0.5) / n for n in shape)
    wind_m_s = np.zeros((1, *shape, 3), np.float32)
    wind_m_s[0, ..., 0] = (1.0 + y[:, None]) * np.ones((shape[0], 1, 1))
    wind_m_s[0, ..., 2] = 0.3 * x[:, None, None]
    return build_air(occupancy, wind_m_s, cell_m=CELL_M, origin_m=(1.0, -2.0, 0.5))


def make_air(room, *, std_m_s=0.3, length_m=0.8, is_open=False):
    k, epsilon = k_epsilon_from_intensity(std_m_s, length_m)
    shape = room.grid.shape
    return build_turbulent_air(
        room, KEpsilonFields(k_m2_s2=np.full(shape, k), epsilon_m2_s3=np.full(shape, epsilon)), is_open=is_open
    )


def velocity_at(air, room, layers, points_m):
    """Velocity of the eddies alone, (m, 3)."""
    sums, origin_m = np.zeros(N_SUMS, np.float32), np.array(room.grid.origin_m)
    return np.array([eddy_velocity_at(air.nodes, layers, origin_m, CELL_M, *point_m, sums) for point_m in points_m])


@pytest.mark.slow
def test_variance_is_that_of_the_turbulence():
    room = make_room()
    air = make_air(room, is_open=True)
    air.nodes.nodes[...] = air.nodes.nodes[0, 0, -1]
    air = dataclasses.replace(air, drifts_with_wind=False)
    points_m = np.random.default_rng(1).random((4000, 3)) * (6, 5, 4) + room.grid.origin_m
    still = np.zeros((*room.grid.shape, 3), np.float32)
    found = [
        turbulent_wind_at_points(
            still, air.nodes, LargeEddies(air.scales, seed=seed).at(7.3), room.grid.origin_m, CELL_M, points_m
        )
        for seed in range(20)
    ]
    assert np.mean(np.square(found)) == pytest.approx(0.3**2, rel=0.15)


@pytest.mark.slow
@pytest.mark.parametrize("shear_per_s", [0.3, 1.0, 2.0])
def test_shear_leaves_the_variance_as_it_is(shear_per_s):
    """It grew by up to 3.4 times the standard deviation, as patterns were drawn out for all of their life."""
    length_m, time_s, room = 0.8, 4.0, make_room()
    y_m = (np.arange(room.grid.shape[1]) + 0.5) * CELL_M
    sheared_m_s = np.zeros((*room.grid.shape, 4), np.float32)
    sheared_m_s[..., 0] = shear_per_s * y_m[:, None]
    air = make_air(room, length_m=length_m)
    nodes = air.nodes.nodes
    nodes[...] = nodes[12, 10, 8]
    nodes[..., SHEAR_SQUARE] = 0.0
    sheared_nodes = nodes.copy()
    sheared_nodes[..., SHEAR_SQUARE] = shear_per_s**2
    rng, origin_m = np.random.default_rng(1), np.array(room.grid.origin_m)
    points_m = origin_m + 0.5 + rng.random((1500, 3)) * (5, 4, 3)
    still = np.zeros((*room.grid.shape, 3), np.float32)
    scales = EddyScales(length_m=length_m, time_s=time_s)

    def mean_square(found_in):
        at_times = [
            turbulent_wind_at_points(
                still, found_in, LargeEddies(scales, seed=seed).at(40.0 + 1.7 * seed), origin_m, CELL_M, points_m
            )
            for seed in range(20)
        ]
        return np.mean(np.square(at_times))

    sheared, even = (
        air.nodes._replace(nodes=sheared_nodes, drift_m_s=sheared_m_s),
        air.nodes._replace(drift_m_s=0.0 * sheared_m_s),
    )
    assert mean_square(sheared) == pytest.approx(mean_square(even), rel=0.15)


def test_velocity_is_the_curl_of_splines_over_the_lattice():
    """Of scipy's quadratic B-splines, in a wind that slopes in all directions, by differences."""
    room, rng = make_room(), np.random.default_rng(5)
    air = make_air(room)
    nodes = air.nodes.nodes
    nodes[...] = nodes[12, 10, 8]
    nodes[..., SHEAR_SQUARE] = 0.0
    layers, amplitude = LargeEddies(air.scales, seed=3).at(4.2), float(nodes[0, 0, 0, AMPLITUDE])
    lattice = layers.lattice[:-1].reshape(PADDED, PADDED, PADDED, 3)[:N_LATTICE, :N_LATTICE, :N_LATTICE]
    origin_m, basis = np.array(room.grid.origin_m), BSpline.basis_element([-1.0, 0.0, 1.0, 2.0], extrapolate=False)

    def potential_at(place_m):
        wind_m_s = np.array(trilinear_wind(air.nodes.drift_m_s, origin_m, CELL_M, *place_m))
        total = np.zeros(3)
        for n, drift_s in enumerate(layers.drift_s.tolist()):
            q = (place_m - drift_s * wind_m_s) * layers.per_spacing_m[n] + layers.offset[n]
            first = np.floor(q).astype(int)
            reached = [np.nan_to_num(basis(q[axis] - first[axis] - np.arange(3) + 1.0)) for axis in range(3)]
            around = lattice[np.ix_(*((first[axis] + np.arange(3)) % N_LATTICE for axis in range(3)))]
            total += layers.weight[n] * np.einsum("i,j,k,ijkc->c", *reached, around)
        return amplitude * total

    for point_m in origin_m + 1.0 + rng.random((20, 3)) * (4, 3, 2):
        h = 1e-5
        slopes = [(potential_at(point_m + h * e) - potential_at(point_m - h * e)) / (2 * h) for e in np.eye(3)]
        (_, xy, xz), (yx, _, yz), (zx, zy, _) = slopes
        expected = (yz - zy, zx - xz, xy - yx)
        assert velocity_at(air, room, layers, [point_m])[0] == pytest.approx(expected, abs=2e-3)


def test_there_is_no_divergence_in_sheared_wind_beside_walls():
    room = make_room(is_solid=np.s_[10:14, 8:12, :6])
    air = make_air(room)
    layers = LargeEddies(air.scales, seed=3).at(4.2)
    rng, h = np.random.default_rng(2), 1e-4
    origin_m, points_m = np.array(room.grid.origin_m), []
    # Not across the faces of the tables' cells, where slopes jump.
    while len(points_m) < 100:
        point_m = origin_m + rng.random(3) * (6, 5, 4)
        halves = (point_m - origin_m) / (0.5 * CELL_M)
        if (np.abs(halves - np.rint(halves)) > 0.01).all():
            points_m.append(point_m)
    points_m = np.array(points_m)
    slopes = []
    for axis in range(3):
        step_m = h * np.eye(3)[axis]
        ahead, behind = (velocity_at(air, room, layers, points_m + sign * step_m)[:, axis] for sign in (1, -1))
        slopes.append((ahead - behind) / (2 * h))
    divergence = np.sum(slopes, axis=0)
    assert np.abs(slopes).max() > 0.2
    # A few differences cross a node of the splines.
    assert np.quantile(np.abs(divergence), 0.9) < 0.01 * np.mean(np.abs(slopes))


def test_no_eddy_blows_through_a_wall():
    room = make_room(is_solid=np.s_[10:14, 8:12, :6])
    air = make_air(room)
    layers = LargeEddies(air.scales, seed=3).at(4.2)
    origin_m, rng = np.array(room.grid.origin_m), np.random.default_rng(4)
    ceiling_m = origin_m + np.column_stack([rng.random((50, 2)) * (6, 5), np.full(50, 4.0)])
    side_m = origin_m + np.column_stack([np.full(50, 10 * CELL_M - 1e-7), 2.0 + rng.random(50), 1.5 * rng.random(50)])
    assert np.abs(velocity_at(air, room, layers, ceiling_m)[:, 2]).max() < 1e-6
    assert np.abs(velocity_at(air, room, layers, side_m)[:, 0]).max() < 1e-5
    assert np.abs(velocity_at(air, room, layers, side_m)[:, 1]).max() > 0.01


def test_eddies_follow_from_seed_and_time_alone():
    scales = EddyScales(length_m=1.0, time_s=2.0)
    first, second = LargeEddies(scales, seed=5), LargeEddies(scales, seed=6)
    before = first.at(3.0)
    first.at(90.0)
    draw_vectors.cache_clear()
    second.reset(5)
    for ours, theirs in zip(second.at(3.0), before, strict=True):
        np.testing.assert_array_equal(ours, theirs)
    assert np.sum(before.weight**2) == pytest.approx(np.sum(first.at(11.7).weight ** 2))


def test_the_first_octaves_are_the_same_however_many_there_are():
    scales = EddyScales(length_m=1.0, time_s=2.0)
    few, many = (LargeEddies(scales, seed=5, fine_share=0.1, n_octaves=n).at(3.0) for n in (3, 6))
    np.testing.assert_array_equal(few.weight, many.weight[:6])
    np.testing.assert_array_equal(few.offset, many.offset[:6])
    assert np.sum((many.weight[6:] * many.per_spacing_m[6:]) ** 2) == pytest.approx(
        0.1 * np.sum((few.weight * few.per_spacing_m) ** 2)
    )
