"""Gas and walls: no filament in a solid cell, none through a wall, at any step, wind and spread."""

import numpy as np
from built_gas import build_plume, build_source
from built_rooms import build_air
from hypothesis import given, settings
from hypothesis import strategies as st

from gslcosim.environment.model import Cell
from gslcosim_services.fields.filament.plume import Buoyancy

SHAPE = (9, 7, 5)
CELL_M = 0.2
ORIGIN_M = (-0.4, 1.0, 0.3)

step_s = st.floats(0.001, 100.0)
diffusivity_m2_s = st.floats(0.0, 0.5)
wind_m_s = st.tuples(*[st.floats(-20.0, 20.0) for _ in range(3)])
buoyancy_m2_s = st.floats(-1.0, 1.0)
# Where in its cell a source is: anywhere, but also on faces, edges and corners.
place_frac = st.tuples(*[st.sampled_from([0.0, 1e-12, 0.5, 1.0 - 1e-12]) for _ in range(3)])


def room(cells, wind):
    velocity_m_s = np.zeros((1, *cells.shape, 3), np.float32)
    velocity_m_s[0, cells != Cell.SOLID] = wind
    return build_air(cells, velocity_m_s, cell_m=CELL_M, origin_m=ORIGIN_M)


def plume_in(environment, source_cell, step_s, diffusivity_m2_s, seed, *, place=(0.5, 0.5, 0.5), buoyancy=0.0):
    place_m = np.array(ORIGIN_M) + np.add(source_cell, place) * CELL_M
    # What rounding puts on the other side of a face goes back into its cell.
    while (environment.grid.cell_of(place_m) != source_cell).any():
        is_above = environment.grid.cell_of(place_m) > source_cell
        is_below = environment.grid.cell_of(place_m) < source_cell
        place_m = np.where(is_above, np.nextafter(place_m, -np.inf), place_m)
        place_m = np.where(is_below, np.nextafter(place_m, np.inf), place_m)
    rising = Buoyancy(coefficient=buoyancy, power=1)
    source = build_source(tuple(place_m.tolist()), rate=40.0 / step_s, amount_mol=1e-6, buoyancy=rising)
    return build_plume(environment, (source,), step_s=step_s, diffusivity_m2_s=diffusivity_m2_s, seed=seed)


def cells_of(plume, environment):
    return environment.grid.cell_of(plume.filaments.position_world_m)


@settings(deadline=None)
@given(
    seed=st.integers(0, 10**6),
    solid_frac=st.floats(0.0, 0.6),
    wind=wind_m_s,
    step=step_s,
    diffusivity=diffusivity_m2_s,
    place=place_frac,
    buoyancy=buoyancy_m2_s,
)
def test_no_filament_is_ever_in_a_solid_cell_or_outside(seed, solid_frac, wind, step, diffusivity, place, buoyancy):
    cells = (np.random.default_rng(seed).random(SHAPE) < solid_frac).astype(np.uint8)
    cells[4, 3, 2] = Cell.FREE
    environment = room(cells, wind)
    plume = plume_in(environment, (4, 3, 2), step, diffusivity, seed, place=place, buoyancy=buoyancy)
    for _ in range(4):
        plume.advance()
        where = cells_of(plume, environment)
        assert environment.grid.contains_cell(where).all()
        assert (cells[tuple(where.T)] != Cell.SOLID).all()
    assert plume.n == plume.n_born == 160


@settings(deadline=None)
@given(
    seed=st.integers(0, 10**6),
    axis=st.sampled_from([0, 1, 2]),
    wind=wind_m_s,
    step=step_s,
    diffusivity=diffusivity_m2_s,
    place=place_frac,
    buoyancy=buoyancy_m2_s,
)
def test_a_wall_of_one_cell_keeps_all_gas_on_its_side(seed, axis, wind, step, diffusivity, place, buoyancy):
    cells = np.zeros(SHAPE, np.uint8)
    i_wall = SHAPE[axis] // 2
    cells[(slice(None),) * axis + (i_wall,)] = Cell.SOLID
    environment = room(cells, wind)
    source_cell = [4, 3, 2]
    source_cell[axis] = i_wall - 1
    plume = plume_in(environment, source_cell, step, diffusivity, seed, place=place, buoyancy=buoyancy)
    plume.advance(4)
    assert (cells_of(plume, environment)[:, axis] < i_wall).all()


@settings(deadline=None)
@given(seed=st.integers(0, 10**6), wind=wind_m_s, step=step_s, diffusivity=diffusivity_m2_s)
def test_what_is_born_is_in_the_room_or_has_left_for_good(seed, wind, step, diffusivity):
    cells = np.full(SHAPE, Cell.OUTLET, np.uint8)
    cells[1:-1, 1:-1, 1:-1] = Cell.FREE
    environment = room(cells, wind)
    plume = plume_in(environment, (4, 3, 2), step, diffusivity, seed)
    for _ in range(4):
        before = plume.n
        plume.advance()
        assert plume.n <= before + 40
        assert (cells[tuple(cells_of(plume, environment).T)] == Cell.FREE).all()


@settings(deadline=None)
@given(seed=st.integers(0, 10**6), wind=wind_m_s, step=step_s, diffusivity=diffusivity_m2_s, place=place_frac)
def test_cells_that_meet_at_an_edge_or_a_corner_are_no_door(seed, wind, step, diffusivity, place):
    i, j, k = np.indices(SHAPE)
    cells = ((i + j + k) % 2).astype(np.uint8)
    environment = room(cells, wind)
    plume = plume_in(environment, (4, 2, 2), step, diffusivity, seed, place=place)
    plume.advance(4)
    assert (cells_of(plume, environment) == (4, 2, 2)).all()


def test_well_mixed_gas_stays_well_mixed():
    cells = np.zeros(SHAPE, np.uint8)
    cells[4, :, :3] = Cell.SOLID
    environment = room(cells, (0.0, 0.0, 0.0))
    plume = plume_in(environment, (1, 3, 2), 1.0, 0.02, 1)
    plume.advance(200)
    free = (cells != Cell.SOLID).sum()
    place = (plume.filaments.position_world_m[:4000] - ORIGIN_M) / CELL_M
    beside_floor = (place[:, 2] < 0.5).sum() / len(place)
    expected = 0.5 * (cells[:, :, 0] != Cell.SOLID).sum() / free
    assert len(place) == 4000
    assert abs(beside_floor - expected) < 4 * np.sqrt(expected / len(place))
    beside_wall = ((place[:, 0] >= 5) & (place[:, 0] < 5.5) & (place[:, 2] < 3)).sum() / len(place)
    expected = 0.5 * SHAPE[1] * 3 / free
    assert abs(beside_wall - expected) < 4 * np.sqrt(expected / len(place))
