"""Turbulence of a room: slopes of interpolation, scales of k and epsilon, and what walls do."""

import numpy as np
import pytest
from built_rooms import build_air

from gslcosim.environment.geometry_source import build_geometry
from gslcosim.environment.grid_kernels import trilinear_wind
from gslcosim.environment.model import Cell, WindFrames, with_wind
from gslcosim.scenario.loader import load_scenario
from gslcosim_services.fields.turbulence.air import (
    LAGRANGIAN_C0,
    OWN_TIME_RATIO,
    KEpsilonFields,
    build_turbulent_air,
    drift_with_slopes,
    find_eddy_warnings,
    find_walls,
    integral_length_m,
    k_epsilon_from_intensity,
    lagrangian_time_s,
    longest_eddies_m,
    mean_speed_m_s,
    nodes_with_slopes,
)
from gslcosim_services.fields.turbulence.eddies import AMPLITUDE, EPSILON_ROOT, N_COLUMNS, OWN_RATE, OWN_STD


def check_slopes(found, value_at, point_m, *, h=1e-6):
    """Value and slopes of the first three columns beside differences."""
    n = len(found) // 4
    assert found[:3] == pytest.approx(value_at(point_m)[:3], abs=1e-6)
    for axis in range(3):
        ahead, behind = (np.array(value_at(point_m + sign * h * np.eye(3)[axis])[:3]) for sign in (1, -1))
        first = n * (1 + axis)
        assert np.array(found[first : first + 3]) == pytest.approx((ahead - behind) / (2 * h), abs=1e-4)


def test_wind_and_its_slopes_are_those_of_the_interpolation():
    rng = np.random.default_rng(1)
    wind_m_s = rng.normal(size=(5, 4, 3, 4)).astype(np.float32)
    origin_m, cell_m = np.array([1.0, 2.0, 3.0]), 0.5
    for point_m in origin_m + rng.random((40, 3)) * (2.5, 2.0, 1.5):
        found = drift_with_slopes(wind_m_s, origin_m, cell_m, *point_m)
        check_slopes(found, lambda at_m: trilinear_wind(wind_m_s, origin_m, cell_m, *at_m), point_m)


def test_wind_of_one_layer_has_no_slope_across_it():
    wind_m_s = np.ones((3, 3, 1, 4), np.float32)
    assert drift_with_slopes(wind_m_s, np.zeros(3), 1.0, 1.2, 1.4, 0.9) == pytest.approx((1.0,) * 4 + (0.0,) * 12)


def test_columns_at_corners_and_their_slopes_are_those_of_the_interpolation():
    """Corners are the centres of a grid that begins half a cell before."""
    rng = np.random.default_rng(2)
    nodes = rng.normal(size=(6, 5, 4, N_COLUMNS)).astype(np.float32)
    origin_m, cell_m = np.array([1.0, 2.0, 3.0]), 0.5
    for point_m in origin_m + 0.01 + rng.random((40, 3)) * (2.4, 1.9, 1.4):
        found = nodes_with_slopes(nodes, origin_m, cell_m, *point_m)
        check_slopes(found, lambda at_m: trilinear_wind(nodes, origin_m - 0.25, cell_m, *at_m), point_m)


def test_k_and_epsilon_of_an_intensity_have_its_scales():
    k, epsilon = k_epsilon_from_intensity(0.4, 2.5)
    assert k == pytest.approx(0.24)
    assert integral_length_m(k, epsilon) == pytest.approx(2.5)
    assert lagrangian_time_s(k, epsilon) == pytest.approx(2 * 0.4**2 / (LAGRANGIAN_C0 * epsilon))


@pytest.fixture
def room():
    occupancy = np.zeros((12, 10, 8), np.uint8)
    occupancy[4:6, 4:6, :3] = Cell.SOLID
    occupancy[-1, 2:8, 2:6] = Cell.OUTLET
    wind_m_s = np.full((1, 12, 10, 8, 3), (0.3, 0.4, 0.0), np.float32)
    wind_m_s[0, occupancy == Cell.SOLID] = 9.0
    return build_air(occupancy, wind_m_s, cell_m=0.5)


def test_strength_is_that_of_each_place_and_what_is_in_solids_is_not_looked_at(room):
    k, epsilon = np.full(room.grid.shape, 0.06), np.full(room.grid.shape, 0.01)
    k[room.occupancy == Cell.SOLID] = 1e9
    epsilon[room.occupancy == Cell.SOLID] = np.nan
    air = build_turbulent_air(room, KEpsilonFields(k_m2_s2=k, epsilon_m2_s3=epsilon))
    nodes = air.nodes.nodes
    assert air.velocity_std_m_s == pytest.approx(0.2)
    assert air.scales.length_m == pytest.approx(0.43 * 0.06**1.5 / 0.01)
    assert nodes[..., OWN_STD] == pytest.approx(np.full(nodes.shape[:3], nodes[0, 0, 0, OWN_STD]), rel=1e-5)
    assert nodes[..., OWN_RATE] == pytest.approx(
        np.full(nodes.shape[:3], 1 / (OWN_TIME_RATIO * air.scales.time_s)), rel=1e-5
    )
    assert nodes[..., EPSILON_ROOT] == pytest.approx(np.full(nodes.shape[:3], 0.01 ** (1 / 3)), rel=1e-5)
    assert air.nodes.drift_m_s.reshape(-1, 4) == pytest.approx(np.full((960, 4), (0.3, 0.4, 0.0, 0.0)), abs=1e-6)
    assert mean_speed_m_s(room) == pytest.approx(0.5)


def test_eddies_fade_at_walls_and_not_at_outlets(room):
    k, epsilon = np.full(room.grid.shape, 0.06), np.full(room.grid.shape, 0.01)
    amplitude = build_turbulent_air(room, KEpsilonFields(k_m2_s2=k, epsilon_m2_s3=epsilon)).nodes.nodes[..., AMPLITUDE]
    assert (amplitude[0] == 0).all()
    assert (amplitude[:, :, 0] == 0).all()
    assert (amplitude[4:7, 4:7, :4] == 0).all()
    assert amplitude[-1, 5, 4] > 0
    assert amplitude[-1, 0, 4] == 0
    assert amplitude[2, 2, 4] > 0


def test_eddies_of_a_small_room_are_half_of_its_least_side_at_most(room):
    k, epsilon = np.full(room.grid.shape, 6.0), np.full(room.grid.shape, 0.01)
    assert build_turbulent_air(room, KEpsilonFields(k_m2_s2=k, epsilon_m2_s3=epsilon)).scales.length_m == 2.0


PLANT = ["environment.layout={kind: plant, size_m: [20, 14, 2], n_tanks: 0, n_buildings: 0}"]
HALL = ["environment.layout={kind: warehouse_empty, size_m: [10, 8, 3]}"]
INLET = "environment.layout.inlet={min_m: [0, 0, 0], max_m: [0, 8, 3]}"
OUTLET = "environment.layout.outlet={min_m: [10, 0, 0], max_m: [10, 8, 3]}"
ROOF = "environment.layout.openings=[{name: roof, kind: open, min_m: [0, 0, 3], max_m: [10, 8, 3]}]"
HALF_A_ROOF = ROOF.replace("[10, 8, 3]", "[5, 8, 3]")
TUNNEL = ["environment.layout={kind: wind_tunnel, size_m: [8, 2, 3]}"]
CELL = "wind.cell_m=0.25"


def load_changed(*changes):
    # Places that are in the air of all of these rooms.
    places = ("gas.sources[0].position_m=[2, 1, 1]", "agents[0].vehicle.start_m=[4, 1, 0.2]")
    return load_scenario("warehouse_empty", overrides=[*changes, *places, CELL])


@pytest.mark.parametrize(
    ("changes", "longest_m"),
    [
        (PLANT, 2.0),
        ([PLANT[0].replace("14, 2]", "14, 5]")], 5.0),
        (HALL, 1.5),
        ([*HALL, INLET, OUTLET], 1.5),
        ([*HALL, ROOF], 3.0),
        ([*HALL, HALF_A_ROOF], 1.5),
        (TUNNEL, 1.0),
    ],
)
def test_eddies_are_bounded_by_the_walls_that_are_there(changes, longest_m):
    """Half of what is between two walls, all that is between a wall and the open; a part of a side leaves it a wall."""
    loaded = load_changed(*changes)
    room = build_geometry(loaded.scenario.environment, loaded.scenario.wind)
    assert longest_eddies_m(room.grid, find_walls(room)) == longest_m
    turbulence = "gas.turbulence={kind: given, intensity_frac: 0.1, length_m: %s}"
    for length_m, is_bounded in ((longest_m, False), (1.01 * longest_m, True)):
        longer = load_changed(*changes, turbulence % length_m)
        warnings = [str(warning) for warning in find_eddy_warnings(longer.scenario, longer.directory)]
        assert len(warnings) == is_bounded
        assert all(f"at most {longest_m:g} m" in text for text in warnings)


def test_without_walls_eddies_are_as_long_as_their_k_and_epsilon_say(room):
    assert longest_eddies_m(room.grid, np.zeros((3, 2), np.bool_)) == np.inf


def test_open_ground_has_the_eddies_that_are_asked_for_up_to_its_open_sides():
    """Ground 2 m high had eddies of 1 m for 1.5 m, and none at its inlet."""
    loaded = load_changed(*PLANT)
    geometry = build_geometry(loaded.scenario.environment, loaded.scenario.wind)
    ground = with_wind(geometry, WindFrames(velocity_m_s=np.full((1, *geometry.grid.shape, 3), 0.5, np.float32)))
    k, epsilon = k_epsilon_from_intensity(0.05, 1.5)
    shape = ground.grid.shape
    strength = KEpsilonFields(k_m2_s2=np.full(shape, k), epsilon_m2_s3=np.full(shape, epsilon))
    air = build_turbulent_air(ground, strength)
    assert air.scales.length_m == pytest.approx(1.5)
    amplitude = air.nodes.nodes[..., AMPLITUDE]
    assert (amplitude[:, :, 0] == 0).all()
    assert (amplitude[:, :, -1] == amplitude.max()).all()
