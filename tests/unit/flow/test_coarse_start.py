"""A start on cells of twice the size: what becomes of the room, and of the flow on the way back."""

import numpy as np
import pytest

from gslcosim.flow import Inlet, Open, Outlet, Schedule, SlipWall, solve, solve_wind_report
from gslcosim.flow.convergence import settling_window_s
from gslcosim.flow.domain import build_domain
from gslcosim.flow.pressure import HIGH, LOW
from gslcosim.flow.solve import SolverNumerics, coarsen_domain, develop_on_coarse_cells, spread_velocity, transfer_state
from gslcosim.flow.solver import FlowSolver, mass_balance
from gslcosim.flow.turbulence import make_model

CELL_M = 0.25
SHAPE = (14, 11, 7)  # 3.5 x 2.75 x 1.75 m; two of the numbers are odd
AIR = np.ones(SHAPE, bool)
INLET = Inlet(min_m=(0, 0, 0), max_m=(0, 1, 0.5), velocity_m_s=(1, 0, 0))
OUTLET = Outlet(min_m=(3.5, 1.5, 0), max_m=(3.5, 2.75, 0.5))
INNER = (slice(LOW, -HIGH),) * 3


def solver_on(domain, until_s=0.0):
    solver = FlowSolver(domain, make_model("k_epsilon", domain, 1.5e-5))
    while solver.time_s < until_s:
        solver.step(until_s=until_s)
    return solver


def test_a_room_on_coarse_cells_has_half_as_many_and_its_openings():
    coarse = coarsen_domain(build_domain(AIR, CELL_M, [INLET, OUTLET]))
    assert coarse.shape == (7, 6, 4)
    assert coarse.cell_m == 0.5
    (inlet,), (outlet,) = coarse.inlets, coarse.outlets
    assert inlet.n_cells == 2
    assert (inlet.inflow.at(0.0) == (1, 0, 0)).all()
    assert (outlet.is_high, outlet.n_cells) == (True, 3)


def test_an_inlet_that_loses_its_rim_on_coarse_cells_brings_the_same_momentum():
    inlet = Inlet(min_m=(0, 0.25, 0), max_m=(0, 1.5, 0.5), velocity_m_s=(1, 0, 0))
    room = AIR.copy()
    room[0, :1] = room[0, 6:] = False  # the wall beside it, a cell thick
    fine = build_domain(room, CELL_M, [inlet, OUTLET])
    coarse = coarsen_domain(fine)
    assert coarse.inlets[0].n_cells * 4 < fine.inlets[0].n_cells
    before_m4_s2, after_m4_s2 = (
        sum(p.n_cells * domain.cell_m**2 * p.inflow.typical_speed_m_s**2 for p in domain.inlets)
        for domain in (fine, coarse)
    )
    assert after_m4_s2 == pytest.approx(before_m4_s2)


def test_a_flow_that_was_too_fast_on_coarse_cells_does_not_shorten_the_steps_after_it():
    domain = build_domain(AIR, CELL_M, [INLET, OUTLET])
    calm, hasty = ([a.copy() for a in solver_on(domain, 1.0).velocity] for _ in range(2))
    hasty[0][LOW + 7, LOW + 5, LOW + 3] = 40.0
    steps_s = []
    for velocity in (calm, hasty):
        solver = FlowSolver(domain, make_model("k_epsilon", domain, 1.5e-5), initial_velocity=tuple(velocity))
        while solver.time_s < 3.0:
            record = solver.step(until_s=10.0)
        steps_s.append(record.dt_s)
    assert steps_s[1] == pytest.approx(steps_s[0], rel=0.2)


def test_walls_one_cell_thick_stay_closed_and_doors_open():
    room = AIR.copy()
    room[7] = False
    assert (
        coarsen_domain(build_domain(room, CELL_M, [INLET, Outlet(min_m=(0, 2, 0), max_m=(0, 2.75, 1))])).n_air == 3 * 24
    )
    room[7, 4:8, :4] = True
    coarse = coarsen_domain(build_domain(room, CELL_M, [INLET, OUTLET]))
    assert coarse.air[INNER][3].sum() == 2 * 2


def test_nothing_comes_of_ways_and_openings_that_vanish():
    room = AIR.copy()
    room[6:8] = False
    room[6:8, 5] = True
    assert coarsen_domain(build_domain(room, CELL_M, [INLET, OUTLET])) is None
    slit = Inlet(min_m=(0, 0.25, 0), max_m=(0, 0.5, 0.5), velocity_m_s=(1, 0, 0))
    assert coarsen_domain(build_domain(AIR, CELL_M, [slit, OUTLET])) is None


def test_openings_side_by_side_do_not_overlap():
    left = Open(min_m=(0, 0, 1.75), max_m=(1.75, 2.75, 1.75))
    right = SlipWall(min_m=(1.75, 0, 1.75), max_m=(3.5, 2.75, 1.75))
    coarse = coarsen_domain(build_domain(AIR, CELL_M, [INLET, OUTLET, left, right]))
    assert [placed.n_cells for placed in coarse.placed] == [2, 3, 4 * 6, 3 * 6]


def test_a_profile_becomes_that_of_the_larger_cells():
    profile = np.zeros((4, 2, 3))
    profile[..., 0] = [[0, 1], [2, 3], [4, 5], [6, 7]]
    inlet = Inlet(min_m=INLET.min_m, max_m=INLET.max_m, velocity_m_s=profile)
    (placed,) = coarsen_domain(build_domain(AIR, CELL_M, [inlet, OUTLET])).inlets
    assert placed.inflow.at(0.0)[..., 0].tolist() == [[1.5], [5.5]]
    shifted = Inlet(min_m=(0, 0.25, 0), max_m=(0, 1.25, 0.5), velocity_m_s=profile)
    (placed,) = coarsen_domain(build_domain(AIR, CELL_M, [shifted, OUTLET])).inlets
    # Cells 1 to 4 in pairs from 2 on; of cell 5 there is none.
    assert placed.inflow.at(0.0)[..., 0].tolist() == [[3.5], [6.5]]


@pytest.fixture(scope="module")
def developing():
    """A domain with a block in it, and 1 s of its flow on coarse cells."""
    room = AIR.copy()
    room[6:8, 2:6, :4] = False
    fine = build_domain(room, CELL_M, [INLET, OUTLET])
    return fine, solver_on(coarsen_domain(fine), until_s=1.0)


def test_the_flow_spread_on_small_cells_neither_gains_nor_loses_air(developing):
    fine, coarse = developing
    velocity = spread_velocity(coarse, fine)
    u, v, w = (component.astype(float) for component in velocity)
    divergence = np.diff(u, axis=0)[:, :-1, :-1] + np.diff(v, axis=1)[:-1, :, :-1] + np.diff(w, axis=2)[:-1, :-1, :]
    inside = np.zeros_like(divergence, bool)
    inside[LOW + 1 : LOW + 14, LOW : LOW + 10, LOW : LOW + 6] = True
    assert np.abs(divergence[inside]).max() < 1e-4
    through_coarse = coarse.velocity[0][LOW + 2, LOW : LOW + 5, LOW : LOW + 3].sum(dtype=float)
    assert u[LOW + 4, LOW : LOW + 10, LOW : LOW + 6].sum() == pytest.approx(4 * through_coarse, abs=1e-3)


def test_an_even_flow_stays_one():
    whole = [
        Inlet(min_m=(0, 0, 0), max_m=(0, 2.75, 1.75), velocity_m_s=(1, 0, 0)),
        Outlet(min_m=(3.5, 0, 0), max_m=(3.5, 2.75, 1.75)),
    ]
    fine = build_domain(AIR, CELL_M, whole)
    coarse = solver_on(coarsen_domain(fine))
    velocity = spread_velocity(coarse, fine)
    for axis, component in enumerate(velocity):
        faces = tuple(slice(LOW, LOW + n + (other == axis)) for other, n in enumerate(SHAPE))
        assert component[faces][1:] == pytest.approx(1.0 if axis == 0 else 0.0, abs=1e-4)


def test_a_solver_goes_on_from_there_with_its_pressure_and_turbulence(developing):
    domain, coarse = developing
    model = make_model("k_epsilon", domain, 1.5e-5)
    fine = FlowSolver(domain, model, initial_velocity=spread_velocity(coarse, domain))
    transfer_state(coarse, fine)
    assert fine.divergence_m_s() <= 1e-4
    inflow, outflow = mass_balance(domain, fine.velocity)
    assert inflow == pytest.approx(outflow, rel=5e-3)
    i, j, k = 1, 0, 1  # beside the inlet, no wall cell: there k is transported
    assert fine.model.k[LOW + 2 * i, LOW + 3, LOW + 2] == coarse.model.k[LOW + i, LOW + 1, LOW + k]
    assert fine.pressure[LOW + 2 * i, LOW + 2 * j, LOW + 2 * k] == coarse.pressure[LOW + i, LOW + j, LOW + k]
    speed_m_s, coarse_speed_m_s = (np.linalg.norm(s.centre_velocity(), axis=-1) for s in (fine, coarse))
    pairs = coarse_speed_m_s[:, :5, :3], speed_m_s[:, :10, :6].reshape(7, 2, 5, 2, 3, 2).mean(axis=(1, 3, 5))
    assert np.corrcoef(*(speeds.ravel() for speeds in pairs))[0, 1] > 0.98


@pytest.fixture
def for_all_rooms(monkeypatch):
    """Rooms of a few cells begin on larger ones too, however long they have."""
    monkeypatch.setattr(solve, "LEAST_CELLS", 0)
    monkeypatch.setattr(solve, "N_WINDOWS_FROM_STILL", np.inf)


@pytest.mark.slow
def test_a_wind_until_it_settles_begins_where_the_coarse_one_has_come_to(for_all_rooms):
    report = solve_wind_report(AIR, CELL_M, [INLET, OUTLET], max_time_s=30.0)
    settling = report.settling
    assert settling.coarse_start_s > 2 * settling.window_s
    energies = report.history_columns()["kinetic_energy_m2_s2"]
    assert energies[0] > 0.5 * energies[-1]
    assert f"after {settling.coarse_start_s:.1f} s on cells of twice the size" in str(settling)
    longer = solve_wind_report(AIR, CELL_M, [INLET, OUTLET], end_time_s=150.0, average_from_s=50.0).velocity_m_s
    difference = np.sqrt(np.mean((report.velocity_m_s - longer) ** 2) / np.mean(longer**2))
    assert difference < 0.2
    assert report.divergence_relative <= 1e-4
    again = solve_wind_report(AIR, CELL_M, [INLET, OUTLET], max_time_s=30.0)
    np.testing.assert_array_equal(again.velocity_m_s, report.velocity_m_s)


def test_a_start_lasts_five_times_what_follows_at_most(for_all_rooms):
    settling = solve_wind_report(AIR, CELL_M, [INLET, OUTLET], max_time_s=1.0).settling
    assert settling.coarse_start_s == 5.0


@pytest.mark.parametrize("options", [{"end_time_s": 1.0}, {"max_time_s": 1.0, "save_every_s": 0.5}])
def test_with_an_end_or_frames_the_air_is_still_at_first(options, request):
    still = solve_wind_report(AIR, CELL_M, [INLET, OUTLET], **options)
    request.getfixturevalue("for_all_rooms")
    report = solve_wind_report(AIR, CELL_M, [INLET, OUTLET], **options)
    np.testing.assert_array_equal(report.velocity_m_s, still.velocity_m_s)


def test_only_where_the_time_holds_no_start_and_two_windows_is_there_another(monkeypatch):
    monkeypatch.setattr(solve, "LEAST_CELLS", 0)
    domain = build_domain(AIR, CELL_M, [INLET, OUTLET])
    numerics, window_s = SolverNumerics(turbulence="k_epsilon", nu_m2_s=1.5e-5, courant=0.9), settling_window_s(domain)
    assert develop_on_coarse_cells(domain, numerics, max_time_s=3.1 * window_s) is None
    assert develop_on_coarse_cells(domain, numerics, max_time_s=0.1 * window_s).time_s == pytest.approx(window_s / 2)


def test_small_rooms_inlets_that_change_and_flows_that_diverge_have_no_coarse_start(monkeypatch):
    numerics = SolverNumerics(turbulence="k_epsilon", nu_m2_s=1.5e-5, courant=0.9)
    assert develop_on_coarse_cells(build_domain(AIR, CELL_M, [INLET, OUTLET]), numerics, max_time_s=2.0) is None
    monkeypatch.setattr(solve, "LEAST_CELLS", 0)
    gusts = Schedule(times_s=(0, 1), values=(0, 1))
    gusty = Inlet(min_m=INLET.min_m, max_m=INLET.max_m, velocity_m_s=(1, 0, 0), factor=gusts)
    assert develop_on_coarse_cells(build_domain(AIR, CELL_M, [gusty, OUTLET]), numerics, max_time_s=2.0) is None
    # Far beyond what the scheme bears.
    wild = SolverNumerics(turbulence="laminar", nu_m2_s=1.5e-5, courant=20.0)
    assert develop_on_coarse_cells(build_domain(AIR, CELL_M, [INLET, OUTLET]), wild, max_time_s=2.0) is None
