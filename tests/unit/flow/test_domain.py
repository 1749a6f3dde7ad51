"""Boundary conditions on the grid: where a patch lies, which air is connected, what cannot be solved."""

import numpy as np
import pytest

from gslcosim.base.errors import FlowError
from gslcosim.flow import Inlet, MovingWall, Outlet, SlipWall, solve_wind
from gslcosim.flow.domain import build_domain
from gslcosim.flow.pressure import LOW

CELL_M = 0.5
SHAPE = (8, 6, 4)  # 4 x 3 x 2 m
INLET = Inlet(min_m=(0, 0, 0), max_m=(0, 1, 1), velocity_m_s=(1, 0, 0))
OUTLET = Outlet(min_m=(4, 2, 0), max_m=(4, 3, 1))


def air(*solids, shape=SHAPE):
    free = np.ones(shape, bool)
    for solid in solids:
        free[solid] = False
    return free


def refusal(free, patches, *, cell_m=CELL_M, **options):
    with pytest.raises(FlowError) as caught:
        solve_wind(free, cell_m, patches, **{"end_time_s": 1.0, **options})
    return str(caught.value)


@pytest.mark.parametrize(
    ("low", "high", "axis", "is_high", "n_cells"),
    [
        ((0, 0, 0), (0, 1, 1), 0, False, 4),
        ((4, 0.5, 0), (4, 3, 2), 0, True, 20),
        ((1, 0, 0), (2, 0, 1), 1, False, 4),
        ((1, 3, 0), (2, 3, 1.4), 1, True, 6),
        ((0, 0, 2), (4, 3, 2), 2, True, 48),
    ],
)
def test_a_patch_covers_the_boundary_cells_whose_centre_it_holds(low, high, axis, is_high, n_cells):
    elsewhere = Outlet(min_m=(3, 0, 0), max_m=(3.5, 0, 1)) if (axis, is_high) != (2, False) else OUTLET
    domain = build_domain(air(), CELL_M, [Inlet(min_m=low, max_m=high, velocity_m_s=(0, 0, 0)), elsewhere])
    placed = domain.inlets[0]
    assert (placed.axis, placed.is_high, placed.n_cells) == (axis, is_high, n_cells)


def test_air_that_no_outlet_can_be_reached_from_is_cut_off():
    chamber = air()
    chamber[5:8, 0:3, 1:4] = False
    chamber[6, 1, 2] = True
    domain = build_domain(chamber, CELL_M, [INLET, OUTLET])
    assert domain.n_cut_off == 1
    assert not domain.air[6 + LOW, 1 + LOW, 2 + LOW]


def test_walls_rub_on_every_air_cell_beside_them_and_patches_do_not():
    domain = build_domain(air(), CELL_M, [INLET, OUTLET])
    inner = np.zeros(SHAPE, bool)
    inner[1:-1, 1:-1, 1:-1] = True
    inner[0, 1, 1] = inner[-1, 4, 1] = True  # behind inlet and outlet, away from the other walls
    assert domain.friction.cells.size == np.count_nonzero(~inner)
    slip = SlipWall(min_m=(0, 0, 2), max_m=(4, 3, 2))
    with_slip = build_domain(air(), CELL_M, [INLET, OUTLET, slip])
    inner[1:-1, 1:-1, -1] = True
    assert with_slip.friction.cells.size == np.count_nonzero(~inner)


def test_without_inlet_or_outlet_the_case_is_refused():
    assert "no Outlet" in refusal(air(), [INLET])
    assert "no Inlet" in refusal(air(), [OUTLET])
    assert "no Inlet and no Outlet" in refusal(air(), [])


def test_a_patch_off_the_boundary_is_refused():
    assert "not on any side" in refusal(air(), [INLET, Outlet(min_m=(2, 0, 0), max_m=(2, 1, 1))])


def test_a_patch_that_is_not_flat_is_refused():
    assert "flat box" in refusal(air(), [INLET, Outlet(min_m=(3, 2, 0), max_m=(4, 3, 1))])


def test_a_patch_inside_a_solid_is_refused():
    assert "inside a solid" in refusal(air((slice(0, 2), slice(0, 3), slice(0, 3))), [INLET, OUTLET])


def test_a_patch_smaller_than_a_cell_is_refused():
    tiny = Outlet(min_m=(4, 2.3, 0.3), max_m=(4, 2.7, 0.4))
    assert "covers no cell" in refusal(air(), [INLET, tiny])


def test_an_inlet_inside_a_wall_or_between_cell_centres_is_refused():
    assert "Inlet(" in refusal(air((slice(0, 1), slice(0, 2), slice(0, 2))), [INLET, OUTLET])
    tiny = Inlet(min_m=(0, 0.3, 0.3), max_m=(0, 0.7, 0.7), velocity_m_s=(1, 0, 0))
    assert "Inlet(min_m=(0, 0.3, 0.3), max_m=(0, 0.7, 0.7)): covers no cell" in refusal(air(), [tiny, OUTLET])


def test_overlapping_patches_are_refused():
    other = Inlet(min_m=(0, 0.5, 0), max_m=(0, 2, 1), velocity_m_s=(2, 0, 0))
    assert "same boundary cells" in refusal(air(), [INLET, other, OUTLET])


def test_an_inlet_walled_off_from_all_outlets_is_refused():
    assert "no outlet can be reached" in refusal(air((slice(4, 5),)), [INLET, OUTLET])


def test_a_wall_that_moves_through_itself_is_refused():
    lid = MovingWall(min_m=(0, 0, 2), max_m=(4, 3, 2), velocity_m_s=(0, 0, 1))
    assert "own plane" in refusal(air(), [INLET, OUTLET, lid])


@pytest.mark.parametrize("cell_m", [0.0, -0.1, float("nan"), float("inf")])
def test_a_cell_without_size_is_refused(cell_m):
    assert "cell_m" in refusal(air(), [INLET, OUTLET], cell_m=cell_m)


def test_absurdly_many_cells_are_refused_with_the_memory_they_would_take():
    text = refusal(np.broadcast_to(np.True_, (10_000, 1_000, 1_000)), [INLET, OUTLET])
    assert "10,000,000,000" in text
    assert "GB of memory" in text


def test_other_wrong_input_is_refused():
    assert "shape (nx, ny, nz)" in refusal(np.ones((3, 4), bool), [INLET, OUTLET])
    assert "booleans" in refusal(np.ones(SHAPE), [INLET, OUTLET])
    assert "solid everywhere" in refusal(np.zeros(SHAPE, bool), [INLET, OUTLET])
    assert "end_time_s" in refusal(air(), [INLET, OUTLET], end_time_s=0.0)
    assert "average_from_s" in refusal(air(), [INLET, OUTLET], average_from_s=2.0)
    assert "courant" in refusal(air(), [INLET, OUTLET], courant=0.0)
    assert "nu_m2_s" in refusal(air(), [INLET, OUTLET], nu_m2_s=0.0)
    gusty = Inlet(min_m=(0, 0, 0), max_m=(0, 1, 1), velocity_m_s=(1, 0, 0), turbulence_intensity=-0.1)
    assert "turbulence_intensity" in refusal(air(), [gusty, OUTLET])
    assert "finite" in refusal(air(), [Inlet(min_m=(0, 0, 0), max_m=(0, 1, 1), velocity_m_s=(np.nan, 0, 0)), OUTLET])
    assert "min_m <= max_m" in refusal(air(), [INLET, Outlet(min_m=(4, 3, 1), max_m=(4, 2, 0))])
