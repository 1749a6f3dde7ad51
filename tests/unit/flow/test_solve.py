"""Laws of a solved wind field: divergence, mass, symmetry, axes, repeatability."""

import numpy as np
import pytest

from gslcosim.base.errors import FlowError
from gslcosim.flow import Inlet, Outlet, solve_wind, solve_wind_report
from gslcosim.flow.domain import build_domain
from gslcosim.flow.solver import FlowSolver
from gslcosim.flow.turbulence import Laminar

CELL_M = 0.25
SHAPE = (14, 10, 7)  # 3.5 x 2.5 x 1.75 m: three different side lengths
SIZE_M = tuple(n * CELL_M for n in SHAPE)
INLET = Inlet(min_m=(0, 0, 0), max_m=(0, 1, 0.75), velocity_m_s=(1, 0, 0))
OUTLET = Outlet(min_m=(3.5, 1.5, 0), max_m=(3.5, 2.5, 0.75))
MODELS = ("k_epsilon", "rng_k_epsilon", "smagorinsky", "laminar")


def room():
    free = np.ones(SHAPE, bool)
    free[5:7, 2:6, :4] = False
    return free


def advance(solver, end_time_s):
    while solver.time_s < end_time_s:
        solver.step(until_s=end_time_s)


def reordered(values, axes):
    return tuple(values[a] for a in axes)


@pytest.mark.parametrize("turbulence", MODELS)
def test_the_wind_is_divergence_free_and_conserves_mass(turbulence):
    report = solve_wind_report(room(), CELL_M, [INLET, OUTLET], end_time_s=2.0, turbulence=turbulence)
    u, v, w = report.face_velocity_m_s
    divergence_m_s = np.diff(u, axis=0) + np.diff(v, axis=1) + np.diff(w, axis=2)
    assert np.abs(divergence_m_s).max() <= 1e-4
    assert report.divergence_relative <= 1e-4
    assert report.inflow_m3_s == pytest.approx(0.75, rel=1e-5)
    assert report.mass_balance_relative <= 0.005


def test_nothing_moves_in_solids_and_through_their_faces():
    report = solve_wind_report(room(), CELL_M, [INLET, OUTLET], end_time_s=1.0)
    solid = ~room()
    assert np.all(report.velocity_m_s[solid] == 0)
    u = report.face_velocity_m_s[0]
    assert np.all(u[:-1][solid] == 0)
    assert np.all(u[1:][solid] == 0)
    assert np.abs(report.velocity_m_s[~solid]).max() > 0.5


@pytest.mark.parametrize("axes", [(1, 0, 2), (2, 1, 0), (1, 2, 0)])
@pytest.mark.parametrize("turbulence", MODELS)
def test_exchanged_axes_give_the_same_wind_with_exchanged_axes(axes, turbulence):
    options = {"end_time_s": 1.5, "turbulence": turbulence}
    straight = solve_wind(room(), CELL_M, [INLET, OUTLET], **options)
    inlet = Inlet(
        min_m=reordered(INLET.min_m, axes),
        max_m=reordered(INLET.max_m, axes),
        velocity_m_s=reordered(INLET.velocity_m_s, axes),
    )
    outlet = Outlet(min_m=reordered(OUTLET.min_m, axes), max_m=reordered(OUTLET.max_m, axes))
    turned = solve_wind(np.ascontiguousarray(room().transpose(axes)), CELL_M, [inlet, outlet], **options)
    expected = straight.transpose(*axes, 3)[..., list(axes)]
    assert np.abs(turned - expected).max() < 2e-3


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_mirrored_room_has_the_mirrored_wind(axis):
    straight = solve_wind(room(), CELL_M, [INLET, OUTLET], end_time_s=1.5)

    def mirror(low, high):
        low, high = list(low), list(high)
        low[axis], high[axis] = SIZE_M[axis] - high[axis], SIZE_M[axis] - low[axis]
        return {"min_m": tuple(low), "max_m": tuple(high)}

    velocity = tuple(-v if a == axis else v for a, v in enumerate(INLET.velocity_m_s))
    patches = [
        Inlet(**mirror(INLET.min_m, INLET.max_m), velocity_m_s=velocity),
        Outlet(**mirror(OUTLET.min_m, OUTLET.max_m)),
    ]
    mirrored = np.flip(solve_wind(np.flip(room(), axis).copy(), CELL_M, patches, end_time_s=1.5), axis).copy()
    mirrored[..., axis] *= -1
    assert np.abs(mirrored - straight).max() < 2e-3


def test_the_same_case_gives_the_same_bits():
    first, second = (solve_wind(room(), CELL_M, [INLET, OUTLET], end_time_s=1.0) for _ in range(2))
    assert first.tobytes() == second.tobytes()


def test_twice_the_inlet_speed_in_half_the_time_gives_twice_the_wind_at_the_same_reynolds_number():
    patches = [INLET, OUTLET]
    fast = [Inlet(min_m=INLET.min_m, max_m=INLET.max_m, velocity_m_s=(2, 0, 0)), OUTLET]
    slow_wind = solve_wind(room(), CELL_M, patches, end_time_s=2.0, nu_m2_s=1e-5)
    fast_wind = solve_wind(room(), CELL_M, fast, end_time_s=1.0, nu_m2_s=2e-5)
    assert np.abs(fast_wind - 2 * slow_wind).max() < 4e-3


def test_the_mean_lies_between_the_fields_it_averages():
    last = solve_wind(room(), CELL_M, [INLET, OUTLET], end_time_s=4.0)
    mean = solve_wind(room(), CELL_M, [INLET, OUTLET], end_time_s=4.0, average_from_s=0.0)
    start = solve_wind(room(), CELL_M, [INLET, OUTLET], end_time_s=0.01)
    distance = np.linalg.norm(last - start)
    assert 0 < np.linalg.norm(mean - last) < distance
    assert 0 < np.linalg.norm(mean - start) < distance


def test_a_diverged_flow_says_when_where_and_what_to_change():
    domain = build_domain(room(), CELL_M, [INLET, OUTLET])
    solver = FlowSolver(domain, Laminar(domain, 1.5e-5), courant=0.8)
    solver.velocity[0][2 + 8, 2 + 4, 2 + 3] = 1e6
    with pytest.raises(
        FlowError, match=r"diverged at 0\.000 s \(step 0\).*near \((1|2)\..., 1\.12, 0\.88\) m.*courant"
    ):
        solver.step(until_s=1.0)


def test_a_divergence_in_the_last_step_is_no_result(monkeypatch):
    step = FlowSolver.step

    def broken_step(self, *, until_s):
        record = step(self, until_s=until_s)
        if record.time_s == 1.0:
            self.velocity[0][8, 6, 5] = np.nan
        return record

    monkeypatch.setattr(FlowSolver, "step", broken_step)
    with pytest.raises(FlowError, match=r"diverged at 1\.000 s"):
        solve_wind(room(), CELL_M, [INLET, OUTLET], end_time_s=1.0)


def test_a_flow_that_grows_without_end_is_stopped():
    domain = build_domain(room(), CELL_M, [INLET, OUTLET])
    solver = FlowSolver(domain, Laminar(domain, 1.5e-5))
    solver.model.nu[solver.model.nu > 0] = -50.0  # a viscosity that feeds the flow
    with pytest.raises(FlowError, match="expected at most 50 m/s"):
        advance(solver, 10.0)
