"""Boundary conditions on the grid: where a patch lies, which air is connected, what cannot be solved."""

import re

import numpy as np
import pytest

from gslcosim.base.errors import FlowError
from gslcosim.flow import Inlet, MovingWall, Outlet, SlipWall, solve_wind, solve_wind_report
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


def inlet(max_m=(0, 1, 1), velocity_m_s=(1, 0, 0), **options):
    return Inlet(**{"min_m": (0, 0, 0), "max_m": max_m, "velocity_m_s": velocity_m_s, **options})


def outlet(min_m, max_m):
    return Outlet(min_m=min_m, max_m=max_m)


BETWEEN_CENTRES = {"min_m": (0, 0.3, 0.3), "max_m": (0, 0.7, 0.7)}
LID = MovingWall(min_m=(0, 0, 2), max_m=(4, 3, 2), velocity_m_s=(0, 0, 1))


@pytest.mark.parametrize(
    ("patches", "reason"),
    [
        ([INLET], "no Outlet"),
        ([OUTLET], "no Inlet"),
        ([], "no Inlet and no Outlet"),
        ([INLET, outlet((2, 0, 0), (2, 1, 1))], "not on any side"),
        ([INLET, outlet((3, 2, 0), (4, 3, 1))], "flat box"),
        ([INLET, outlet((4, 2.3, 0.3), (4, 2.7, 0.4))], "covers no cell"),
        ([inlet(**BETWEEN_CENTRES), OUTLET], "Inlet(min_m=(0, 0.3, 0.3), max_m=(0, 0.7, 0.7)): covers no cell"),
        ([INLET, inlet(min_m=(0, 0.5, 0), max_m=(0, 2, 1)), OUTLET], "same boundary cells"),
        ([INLET, OUTLET, LID], "own plane"),
        ([inlet(turbulence_intensity=-0.1), OUTLET], "turbulence_intensity"),
        ([inlet(velocity_m_s=(np.nan, 0, 0)), OUTLET], "finite"),
        ([INLET, outlet((4, 3, 1), (4, 2, 0))], "min_m <= max_m"),
    ],
)
def test_patches_that_cannot_be_are_refused(patches, reason):
    with pytest.raises(FlowError, match=re.escape(reason)):
        solve_wind(air(), CELL_M, patches, end_time_s=1.0)


@pytest.mark.parametrize(
    ("free", "reason"),
    [
        (air((slice(0, 2), slice(0, 3), slice(0, 3))), "inside a solid"),
        (air((slice(0, 1), slice(0, 2), slice(0, 2))), "Inlet("),
        (air((slice(4, 5),)), "no outlet can be reached"),
        (np.broadcast_to(np.True_, (10_000, 1_000, 1_000)), "10,000,000,000"),
        (np.broadcast_to(np.True_, (10_000, 1_000, 1_000)), "GB of memory"),
        (np.ones((3, 4), bool), "shape (nx, ny, nz)"),
        (np.ones(SHAPE), "booleans"),
        (np.zeros(SHAPE, bool), "solid everywhere"),
    ],
)
def test_rooms_that_cannot_be_solved_are_refused(free, reason):
    with pytest.raises(FlowError, match=re.escape(reason)):
        solve_wind(free, CELL_M, [INLET, OUTLET], end_time_s=1.0)


@pytest.mark.parametrize("cell_m", [0.0, -0.1, float("nan"), float("inf")])
def test_a_cell_without_size_is_refused(cell_m):
    with pytest.raises(FlowError, match="cell_m"):
        solve_wind(air(), cell_m, [INLET, OUTLET], end_time_s=1.0)


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        ({"end_time_s": 0.0}, "end_time_s"),
        ({"average_from_s": 2.0}, "average_from_s"),
        ({"courant": 0.0}, "courant"),
        ({"nu_m2_s": 0.0}, "nu_m2_s"),
        ({"end_time_s": None, "average_from_s": 1.0}, "average_from_s"),
        ({"end_time_s": None, "max_time_s": 0.0}, "max_time_s"),
        ({"end_time_s": None, "settle_tolerance_frac": 0.0}, "settle_tolerance_frac"),
        ({"end_time_s": 1e9, "save_every_s": 0.01}, "GB of memory"),
        ({"save_every_s": 0.0}, "save_every_s"),
        ({"save_every_s": 1.0, "save_from_s": 3.0}, "save_from_s"),
    ],
)
def test_options_out_of_range_are_refused(options, reason):
    with pytest.raises(FlowError, match=reason):
        solve_wind_report(air(), CELL_M, [INLET, OUTLET], **{"end_time_s": 1.0, **options})


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
