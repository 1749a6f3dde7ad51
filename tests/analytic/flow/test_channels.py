"""Laminar flow between plates: the parabola of Poiseuille, with order."""

import numpy as np

from gslcosim.flow import Inlet, Outlet, SlipWall, solve_wind_report

NU_M2_S = 0.1


# Largest error of the velocity profile two heights behind the inlet of a channel 1 m high, n cells across.
def profile_error(n):
    cell_m, length_m = 1 / n, 3.0
    depth_m = cell_m
    patches = [
        Inlet(min_m=(0, 0, 0), max_m=(0, depth_m, 1), velocity_m_s=(1, 0, 0)),
        Outlet(min_m=(length_m, 0, 0), max_m=(length_m, depth_m, 1)),
        SlipWall(min_m=(0, 0, 0), max_m=(length_m, 0, 1)),
        SlipWall(min_m=(0, depth_m, 0), max_m=(length_m, depth_m, 1)),
    ]
    free = np.ones((round(length_m * n), 1, n), bool)
    report = solve_wind_report(free, cell_m, patches, end_time_s=3.0, turbulence="laminar", nu_m2_s=NU_M2_S)
    z_m = (np.arange(n) + 0.5) * cell_m
    return np.abs(report.face_velocity_m_s[0][2 * n, 0] - 6 * z_m * (1 - z_m)).max()


def test_poiseuille_flow_is_second_order():
    coarse, fine = profile_error(6), profile_error(12)
    assert fine < 0.015
    assert np.log2(coarse / fine) > 1.8
