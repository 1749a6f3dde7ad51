"""Until the statistics settle: when that is, what is returned, and what is said when it never comes."""

import numpy as np
import pytest

from gslcosim.flow import (
    ConvergenceResult,
    Inlet,
    Outlet,
    Schedule,
    SlipWall,
    WindowCheck,
    solve_wind,
    solve_wind_report,
)
from gslcosim.flow.convergence import settling_window_s
from gslcosim.flow.domain import build_domain

CELL_M = 0.25
SHAPE = (14, 10, 7)  # 3.5 x 2.5 x 1.75 m
AIR = np.ones(SHAPE, bool)
INLET = Inlet(min_m=(0, 0, 0), max_m=(0, 1, 0.75), velocity_m_s=(1, 0, 0))
OUTLET = Outlet(min_m=(3.5, 1.5, 0), max_m=(3.5, 2.5, 0.75))


def difference(a, b):
    return np.sqrt(np.mean((a - b) ** 2) / np.mean(b**2))


@pytest.mark.slow
def test_an_empty_room_settles_and_its_mean_is_that_of_a_much_longer_run():
    report = solve_wind_report(AIR, CELL_M, [INLET, OUTLET])
    settling = report.settling
    assert settling.has_settled
    assert settling.average_until_s == pytest.approx(report.history[-1].time_s)
    assert settling.average_until_s < 100
    longer = solve_wind(AIR, CELL_M, [INLET, OUTLET], end_time_s=150.0, average_from_s=50.0)
    assert difference(report.velocity_m_s, longer) < 0.2
    assert np.corrcoef(report.velocity_m_s.ravel(), longer.ravel())[0, 1] > 0.97
    assert report.divergence_relative <= 1e-4


def test_the_numbers_of_the_last_two_windows_decide():
    settling = solve_wind_report(AIR, CELL_M, [INLET, OUTLET]).settling
    last = settling.checks[-1]
    assert last.change_frac <= 0.25
    assert last.energy_change_frac <= 0.05
    assert last.start_s == settling.average_from_s
    assert last.end_s == pytest.approx(settling.average_until_s)
    assert all(c.change_frac > 0.25 or c.energy_change_frac > 0.05 for c in settling.checks[:-1])
    assert str(settling).startswith("settled: from ")
    assert settling.uncertainty_frac == pytest.approx(last.change_frac / 2, rel=0.05)
    assert settling.summary()["uncertainty_frac"] == settling.uncertainty_frac


@pytest.mark.slow
def test_an_unsteady_jet_settles_in_the_mean():
    options = {"turbulence": "smagorinsky"}
    inlet = Inlet(min_m=(0, 1, 0.5), max_m=(0, 1.5, 1), velocity_m_s=(2, 0, 0))
    report = solve_wind_report(AIR, CELL_M, [inlet, OUTLET], **options, settle_tolerance_frac=0.35)
    assert report.settling.has_settled, str(report.settling)
    until_s = report.settling.average_until_s
    longer = solve_wind(AIR, CELL_M, [inlet, OUTLET], **options, end_time_s=2 * until_s, average_from_s=until_s)
    assert difference(report.velocity_m_s, longer) < 0.35


def test_a_wind_that_cannot_settle_in_time_says_so():
    turning = Schedule(times_s=np.arange(0, 200, 11.0), values=[(1, 0.8 * (-1) ** n, 0) for n in range(19)])
    inlet = Inlet(min_m=(0, 0.75, 0), max_m=(0, 1.5, 0.75), velocity_m_s=turning)
    report = solve_wind_report(AIR, CELL_M, [inlet, OUTLET], max_time_s=20.0)
    assert not report.settling.has_settled
    assert str(report.settling).startswith("not settled")
    assert report.history[-1].time_s == 20.0
    assert report.divergence_relative <= 1e-4


def test_without_time_for_two_windows_nothing_is_compared_and_the_mean_is_of_all():
    report = solve_wind_report(AIR, CELL_M, [INLET, OUTLET], max_time_s=2.0)
    assert not report.settling.has_settled
    assert report.settling.checks == ()
    assert "no two windows" in str(report.settling)
    assert report.settling.uncertainty_frac is None
    same = solve_wind(AIR, CELL_M, [INLET, OUTLET], end_time_s=2.0, average_from_s=0.0)
    assert report.velocity_m_s == pytest.approx(same, abs=1e-4)


@pytest.mark.parametrize("lengths_s", [(8.0, 8.0), (4.0, 20.0)])
def test_the_uncertainty_is_the_standard_error_where_windows_are_independent(lengths_s):
    """Of noise whose mean over a window spreads with one over the root of its length, seen in many rooms."""
    rng, (first_s, second_s), n = np.random.default_rng(7), lengths_s, 20000
    first, second = (rng.normal(1.0, 0.4 / np.sqrt(length_s), n) for length_s in lengths_s)
    check = WindowCheck(
        start_s=2.0,
        middle_s=2.0 + first_s,
        end_s=2.0 + first_s + second_s,
        change_frac=np.sqrt(np.mean((second - first) ** 2)),
        energy_change_frac=0.0,
    )
    settling = ConvergenceResult(
        has_settled=True,
        average_from_s=check.start_s,
        average_until_s=check.end_s,
        window_s=first_s,
        tolerance_frac=0.25,
        checks=(check,),
    )
    error = np.sqrt(np.mean(((first_s * first + second_s * second) / sum(lengths_s) - 1.0) ** 2))
    assert settling.uncertainty_frac == pytest.approx(error, rel=0.05)


def test_progress_ends_at_one_whenever_it_settles():
    seen = []
    solve_wind(AIR, CELL_M, [INLET, OUTLET], progress=seen.append)
    assert seen == sorted(seen)
    assert 0 < seen[0] < seen[-1] == 1.0


def test_the_window_is_the_time_through_a_full_duct_and_longer_in_a_room_but_at_most_one_change_of_air():
    sides = [SlipWall(min_m=(0, y, 0), max_m=(3.5, y, 1.75)) for y in (0.0, 2.5)]
    whole = Inlet(min_m=(0, 0, 0), max_m=(0, 2.5, 1.75), velocity_m_s=(2, 0, 0))
    end = Outlet(min_m=(3.5, 0, 0), max_m=(3.5, 2.5, 1.75))
    assert settling_window_s(build_domain(AIR, CELL_M, [whole, end, *sides])) == pytest.approx(1.75)
    room_s = settling_window_s(build_domain(AIR, CELL_M, [INLET, OUTLET]))
    assert 3.5 < room_s < 3.5 * 2.5 * 1.75 / 0.75


def test_windows_hold_whole_periods_of_inlets_that_repeat():
    pulse = Schedule(times_s=(0, 2, 4), values=(0, 2, 0), is_repeating=True)
    inlet = Inlet(min_m=(0, 0, 0), max_m=(0, 1, 0.75), velocity_m_s=(1, 0, 0), factor=pulse)
    assert settling_window_s(build_domain(AIR, CELL_M, [inlet, OUTLET])) % 4 == 0


def test_windows_begin_when_the_inlet_has_stopped_changing():
    gust = Schedule(times_s=(0, 3), values=(0, 1))
    inlet = Inlet(min_m=(0, 0, 0), max_m=(0, 1, 0.75), velocity_m_s=(1, 0, 0), factor=gust)
    settling = solve_wind_report(AIR, CELL_M, [inlet, OUTLET], max_time_s=200.0).settling
    assert settling.checks[0].start_s == 3.0


def test_the_start_up_does_not_count_where_a_second_window_has_begun():
    probe = solve_wind_report(AIR, CELL_M, [INLET, OUTLET], max_time_s=1.0).settling
    until_s = 1.5 * probe.window_s
    report = solve_wind_report(AIR, CELL_M, [INLET, OUTLET], max_time_s=until_s)
    assert report.settling.checks == ()
    assert report.settling.average_from_s == pytest.approx(probe.window_s)
    same = solve_wind(AIR, CELL_M, [INLET, OUTLET], end_time_s=until_s, average_from_s=probe.window_s)
    assert report.velocity_m_s == pytest.approx(same, abs=1e-4)
