"""What inlets blow: profiles over their cells, schedules over time, fans, several at once."""

import numpy as np
import pytest

from gslcosim.base.errors import FlowError
from gslcosim.flow import Inlet, Outlet, Schedule, log_profile, solve_wind_report
from gslcosim.flow.domain import build_domain
from gslcosim.flow.solver import FlowSolver, mass_balance
from gslcosim.flow.turbulence import Laminar

CELL_M = 0.25
SHAPE = (12, 8, 6)  # 3 x 2 x 1.5 m
SIZE_M = tuple(n * CELL_M for n in SHAPE)
OUTLET = Outlet(min_m=(3, 1, 0), max_m=(3, 2, 1))
AIR = np.ones(SHAPE, bool)


def inlet(velocity_m_s, **options):
    return Inlet(min_m=(0, 0, 0), max_m=(0, 1, 0.75), velocity_m_s=velocity_m_s, **options)


def solved(*patches, end_time_s=1.0):
    return solve_wind_report(AIR, CELL_M, patches, end_time_s=end_time_s)


def test_an_array_gives_each_cell_its_velocity():
    speeds = 0.1 * np.arange(1, 13).reshape(4, 3)
    profile = np.zeros((4, 3, 3))
    profile[..., 0] = speeds
    report = solved(inlet(profile), OUTLET)
    assert report.face_velocity_m_s[0][0, :4, :3] == pytest.approx(speeds)
    assert report.inflow_m3_s == pytest.approx(speeds.sum() * CELL_M**2, rel=1e-5)
    assert report.mass_balance_relative <= 0.005


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("is_high", [False, True])
def test_a_function_sees_the_centres_of_the_boundary_faces(axis, is_high):
    low, high = [0.0, 0.0, 0.0], [1.0, 1.0, 1.0]
    low[axis] = high[axis] = SIZE_M[axis] if is_high else 0.0
    seen = []

    def blow(points_m):
        seen.append(points_m)
        return np.zeros_like(points_m)

    elsewhere = Outlet(min_m=(2, 0, 0), max_m=(3, 0, 1)) if axis != 1 else OUTLET
    build_domain(AIR, CELL_M, [Inlet(min_m=tuple(low), max_m=tuple(high), velocity_m_s=blow), elsewhere])
    expected = [0.125, 0.375, 0.625, 0.875]
    for other in range(3):
        assert sorted(set(seen[0][:, other])) == ([low[axis]] if other == axis else expected)


def test_a_logarithmic_profile_has_its_reference_and_equal_gains_per_doubling_of_height():
    profile = log_profile((3, 4, 0), height_m=10.0, roughness_m=0.01)
    at = profile(np.array([[0, 0, 10.0], [0, 0, -1.0], [0, 0, 2.0], [0, 0, 4.0], [0, 0, 8.0]]))
    assert at[0] == pytest.approx((3, 4, 0))
    assert np.all(at[1] == 0)
    assert at[4] - at[3] == pytest.approx(at[3] - at[2], rel=0.01)


def test_a_schedule_is_linear_between_its_times_and_holds_or_repeats_outside():
    held = Schedule(times_s=(1, 3), values=(0, 4))
    assert [float(held.at(t)) for t in (0, 1, 2, 3, 9)] == [0, 0, 2, 4, 4]
    repeating = Schedule(times_s=(0, 1, 2), values=(0, 4, 0), is_repeating=True)
    assert [float(repeating.at(t)) for t in (0.5, 1.5, 2.5, 7.0)] == [2, 2, 2, 4]
    turning = Schedule(times_s=(0, 2), values=((1, 0, 0), (0, 1, 0)))
    assert turning.at(1.0) == pytest.approx((0.5, 0.5, 0))


@pytest.mark.parametrize("velocity_m_s", [(1.0, 0, 0), np.full((4, 3, 3), (1.0, 0, 0))])
def test_a_factor_scales_the_inflow_at_each_step(velocity_m_s):
    factor = Schedule(times_s=(0, 1), values=(0, 2))
    domain = build_domain(AIR, CELL_M, [inlet(velocity_m_s, factor=factor), OUTLET])
    solver = FlowSolver(domain, Laminar(domain, 1e-3))
    while solver.time_s < 1.5:
        solver.step(until_s=1.5)
        flow_in, flow_out = mass_balance(domain, solver.velocity)
        assert flow_in == pytest.approx(0.75 * min(2 * solver.time_s, 2.0), rel=1e-5)
        assert flow_out == pytest.approx(flow_in, rel=0.005)


def test_a_schedule_of_velocities_turns_the_inflow():
    turning = Schedule(times_s=(0, 1), values=((1, 0, 0), (0.5, 0.5, 0)))
    domain = build_domain(AIR, CELL_M, [inlet(turning), OUTLET])
    solver = FlowSolver(domain, Laminar(domain, 1e-3))
    while solver.time_s < 1.0:
        solver.step(until_s=1.0)
    assert mass_balance(domain, solver.velocity)[0] == pytest.approx(0.375, rel=1e-5)
    assert solver.centre_velocity()[0, 1, 1, 1] > 0.1


def test_a_varying_inlet_is_resolved_to_second_order_in_time():
    """A plug of air without walls has the inlet's speed everywhere at once; its pressure gradient is the trap."""
    pulse = Schedule(times_s=np.linspace(0, 1, 101), values=np.sin(np.linspace(0, np.pi, 101)))
    everywhere = Inlet(min_m=(0, 0, 0), max_m=(0, 2, 1.5), velocity_m_s=(1, 0, 0), factor=pulse)
    report = solved(everywhere, Outlet(min_m=(3, 0, 0), max_m=(3, 2, 1.5)), end_time_s=0.5)
    core = report.velocity_m_s[:, 3:5, 2:4, 0]
    assert core == pytest.approx(1.0, abs=0.05)


def test_a_fan_pulls_air_in_through_the_outlet():
    report = solved(inlet((-0.8, 0, 0)), OUTLET, end_time_s=4.0)
    assert report.outflow_m3_s == pytest.approx(0.6, rel=1e-5)
    assert report.mass_balance_relative <= 0.005
    assert report.divergence_relative <= 1e-4
    assert report.velocity_m_s[-1, 5:7, 1:3, 0].max() < 0


def test_inlets_and_outlets_on_all_six_sides_balance():
    patches = [
        Inlet(min_m=(0, 0.5, 0.25), max_m=(0, 1, 1), velocity_m_s=(1, 0, 0)),
        Outlet(min_m=(3, 0.5, 0.25), max_m=(3, 1, 1)),
        Inlet(min_m=(0.5, 0, 0.25), max_m=(1, 0, 1), velocity_m_s=(0.2, 0.7, 0)),
        Outlet(min_m=(1.5, 2, 0), max_m=(2.5, 2, 1)),
        Inlet(min_m=(1, 0.5, 0), max_m=(1.5, 1, 0), velocity_m_s=(0, 0, 0.5)),
        Inlet(min_m=(1, 0.5, 1.5), max_m=(2, 1.5, 1.5), velocity_m_s=(0, 0, 0.3)),
    ]
    report = solved(*patches, end_time_s=2.0)
    assert report.inflow_m3_s >= 1 * 0.375 + 0.7 * 0.375 + 0.5 * 0.25 - 1e-5
    assert report.outflow_m3_s >= 0.3
    assert report.mass_balance_relative <= 0.005
    assert report.divergence_relative <= 1e-4


def refusal(make):
    with pytest.raises(FlowError) as caught:
        make()
    return str(caught.value)


def test_profiles_and_schedules_that_do_not_fit_are_refused():
    def build(velocity_m_s, **options):
        return lambda: build_domain(AIR, CELL_M, [inlet(velocity_m_s, **options), OUTLET])

    velocities, numbers = Schedule(times_s=(0,), values=((1, 0, 0),)), Schedule(times_s=(0,), values=(1,))
    assert "array of shape (4, 3, 3)" in refusal(build(np.zeros((3, 3, 3))))
    assert "(12, 3) for as many points, was (12,)" in refusal(build(lambda points: points[:, 0]))
    assert "finite" in refusal(build(np.full((4, 3, 3), np.nan)))
    assert "without a factor" in refusal(build(velocities, factor=numbers))
    assert "Schedule of velocities" in refusal(build(numbers))
    assert "Schedule of numbers" in refusal(build((1, 0, 0), factor=velocities))


def test_schedules_and_profiles_that_make_no_sense_are_refused():
    assert "rising times" in refusal(lambda: Schedule(times_s=(0, 0), values=(1, 2)))
    assert "rising times" in refusal(lambda: Schedule(times_s=(), values=()))
    assert "one for each time" in refusal(lambda: Schedule(times_s=(0, 1), values=(1, 2, 3)))
    assert "finite" in refusal(lambda: Schedule(times_s=(0, 1), values=(1, np.inf)))
    assert "two times" in refusal(lambda: Schedule(times_s=(0,), values=(1,), is_repeating=True))
    assert "expected x, y or z" in refusal(lambda: log_profile((1, 0, 0), height_m=1, roughness_m=0.1, up="h"))
    assert "above 0 m" in refusal(lambda: log_profile((1, 0, 0), height_m=1, roughness_m=0))
