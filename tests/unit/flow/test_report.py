"""What a solve tells beside the wind: frames over time, the history of steps, a summary."""

import json

import numpy as np
import pytest

from gslcosim.flow import Inlet, Outlet, solve_wind_report

CELL_M = 0.25
SHAPE = (14, 10, 7)
AIR = np.ones(SHAPE, bool)
AIR[5:7, 2:6, :4] = False
INLET = Inlet(min_m=(0, 0, 0), max_m=(0, 1, 0.75), velocity_m_s=(1, 0, 0))
OUTLET = Outlet(min_m=(3.5, 1.5, 0), max_m=(3.5, 2.5, 0.75))


def solved(**options):
    return solve_wind_report(AIR, CELL_M, [INLET, OUTLET], **{"end_time_s": 2.0, **options})


def test_frames_come_at_their_times_and_the_last_is_the_end():
    report = solved(save_every_s=0.5)
    assert report.frame_times_s.tolist() == [0, 0.5, 1, 1.5, 2]
    assert report.frames_m_s.shape == (5, *SHAPE, 3)
    assert report.frames_m_s.dtype == np.float32
    assert report.frames_m_s[-1] == pytest.approx(report.velocity_m_s, abs=1e-5)
    assert solved(end_time_s=1.0, save_every_s=0.25).frames_m_s[-1] == pytest.approx(report.frames_m_s[2], abs=0.02)


def test_frames_begin_where_asked_and_stop_with_a_run_that_settles():
    assert solved(save_every_s=0.7, save_from_s=0.3).frame_times_s == pytest.approx([0.3, 1.0, 1.7])
    report = solved(end_time_s=None, save_every_s=1.0)
    assert report.settling.has_settled
    assert len(report.frames_m_s) == int(report.settling.average_until_s) + 1


def test_keeping_frames_does_not_change_the_flow():
    times = {"save_every_s": 1.0}
    fluid, kept = solved(save_every_s=5.0), solved(**times, end_time_s=1.0)
    assert kept.history[0] == fluid.history[0]
    assert kept.velocity_m_s == pytest.approx(solved(end_time_s=1.0).velocity_m_s, abs=1e-6)


def test_the_history_has_every_step_and_adds_up():
    report = solved()
    history = report.history_columns()
    assert {len(column) for column in history.values()} == {report.n_steps}
    assert np.sum(history["dt_s"]) == pytest.approx(2.0)
    assert np.cumsum(history["dt_s"]) == pytest.approx(history["time_s"])
    assert max(history["courant"]) <= 0.9 + 1e-6
    assert history["inflow_m3_s"] == pytest.approx([0.75] * report.n_steps, rel=1e-5)
    assert history["outflow_m3_s"] == pytest.approx([0.75] * report.n_steps, rel=0.01)


def test_the_kinetic_energy_is_that_of_the_air():
    report = solved(end_time_s=1.0)
    u, v, w = report.face_velocity_m_s
    squares = (u[1:] ** 2 + u[:-1] ** 2 + v[:, 1:] ** 2 + v[:, :-1] ** 2 + w[:, :, 1:] ** 2 + w[:, :, :-1] ** 2) / 2
    later = solved(end_time_s=1.5).history_columns()
    after = np.searchsorted(later["time_s"], 1.0, side="right")
    energy = np.interp(1.0, np.subtract(later["time_s"], later["dt_s"]), later["kinetic_energy_m2_s2"])
    assert after > 0
    assert energy == pytest.approx(0.5 * squares[AIR].mean(), rel=0.02)


def test_the_summary_is_json():
    report = solved(end_time_s=None, save_every_s=5.0)
    summary = json.loads(json.dumps(report.summary()))
    assert summary["shape"] == list(SHAPE)
    assert summary["settling"]["has_settled"] is True
    assert summary["n_air_cells"] == np.count_nonzero(AIR)
    assert summary["mass_balance_relative"] <= 0.005
    assert 0 < summary["mean_speed_m_s"] < summary["max_speed_m_s"] < 2
    assert summary["n_frames"] > 1
    assert solved().summary()["settling"] is None
