"""Lips are found on every side of a gap, and what is swept past them is neither lost nor doubled."""

import numpy as np
import pytest

from gslcosim.flow import Inlet, Outlet, solve_wind_report
from gslcosim.flow.domain import build_domain, carry_past_edges
from gslcosim.flow.pressure import LOW

PATCHES = (
    Inlet(min_m=(0, 0, 0), max_m=(0, 9, 4), velocity_m_s=(1, 0, 0)),
    Outlet(min_m=(8, 0, 0), max_m=(8, 9, 4)),
)


# A wall across x at cell 4 with a gap from y = 3 to 6 over the whole height.
@pytest.fixture
def domain():
    free = np.ones((8, 9, 4), bool)
    free[4, :3] = False
    free[4, 6:] = False
    return build_domain(free, 1.0, PATCHES)


def cells_of(domain, flat):
    return {tuple(int(i) - LOW for i in index) for index in zip(*np.unravel_index(flat, domain.air.shape))}


def test_a_gap_has_lips_on_both_jambs_and_both_faces_of_the_wall(domain):
    (lip,) = [lip for lip in domain.lips if (lip.component, lip.carrier) == (1, 0)]
    heights = range(4)
    # Beside the jambs at y = 3 and y = 6 the faces 4 and 5 are the first open ones.
    assert cells_of(domain, lip.target) == {(4, j, k) for j in (4, 5) for k in heights}
    assert cells_of(domain, lip.near) == {(i, j, k) for i in (3, 5) for j in (3, 6) for k in heights}
    assert cells_of(domain, lip.behind) == {(i, j, k) for i in (2, 6) for j in (3, 6) for k in heights}
    assert cells_of(domain, lip.through) == {(i, j, k) for i in (4, 5) for j in (3, 5) for k in heights}
    assert len(lip.near) == 2 * 2 * 4


def test_a_box_without_obstacles_has_none():
    assert build_domain(np.ones((8, 9, 4), bool), 1.0, PATCHES).lips == ()


@pytest.mark.parametrize(
    ("along_m_s", "carrier_m_s", "given_m_s"),
    [
        (2.0, 3.0, 0.5 * 0.1 / 0.5 * 1.5 * (2.0 - 0.25 * 1.0)),  # g dt / h * c / 2 * (u_n - u_b / 4)
        (-2.0, 3.0, 0.0),  # towards the wall: the wall takes it up
        (2.0, -3.0, 0.0),  # out of the gap: nothing arrives
    ],
)
def test_what_points_away_from_the_wall_and_into_the_gap_arrives(along_m_s, carrier_m_s, given_m_s):
    velocity = np.array([along_m_s, 1.0, 0.0], np.float32)
    carrier = np.array([carrier_m_s], np.float32)
    out = np.zeros(3, np.float32)
    first, second, third = (np.array([i]) for i in range(3))
    one = np.ones(1, np.float32)
    carry_past_edges(velocity, carrier, first, second, first, third, one, one, 0.1, 0.5, 0.5, out)
    assert out == pytest.approx([0, 0, given_m_s])


def test_the_wind_through_a_gap_in_the_middle_is_its_own_mirror_image():
    free = np.ones((16, 18, 6), bool)
    free[8, :6] = False
    free[8, 12:] = False
    inlet = Inlet(min_m=(0, 0, 0), max_m=(0, 3.6, 1.2), velocity_m_s=(1, 0, 0))
    outlet = Outlet(min_m=(3.2, 0, 0), max_m=(3.2, 3.6, 1.2))
    u, v, _ = np.moveaxis(solve_wind_report(free, 0.2, [inlet, outlet], end_time_s=1.0).velocity_m_s, -1, 0)
    assert np.abs(v).max() > 0.1
    assert u == pytest.approx(u[:, ::-1], abs=1e-3)
    assert v == pytest.approx(-v[:, ::-1], abs=1e-3)
