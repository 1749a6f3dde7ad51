"""Openings to the outdoors: wind passes along them, jets draw air in through them."""

import numpy as np
import pytest

from gslcosim.flow import Inlet, MovingWall, Open, Outlet, SlipWall, solve_wind_report
from gslcosim.flow.domain import build_domain
from gslcosim.flow.solver import FlowSolver
from gslcosim.flow.turbulence import Laminar

CELL_M = 0.25
SHAPE = (16, 10, 8)  # 4 x 2.5 x 2 m
FAR, LEFT, RIGHT, TOP = (
    {"min_m": (4, 0, 0), "max_m": (4, 2.5, 2)},
    {"min_m": (0, 0, 0), "max_m": (4, 0, 2)},
    {"min_m": (0, 2.5, 0), "max_m": (4, 2.5, 2)},
    {"min_m": (0, 0, 2), "max_m": (4, 2.5, 2)},
)
GROUND = {"min_m": (0, 0, 0), "max_m": (4, 2.5, 0)}


def test_uniform_wind_between_open_sides_stays_uniform():
    windward = Inlet(min_m=(0, 0, 0), max_m=(0, 2.5, 2), velocity_m_s=(1, 0, 0))
    patches = [windward, *(Open(**side) for side in (FAR, LEFT, RIGHT, TOP)), SlipWall(**GROUND)]
    report = solve_wind_report(np.ones(SHAPE, bool), CELL_M, patches, end_time_s=20.0, turbulence="laminar")
    assert report.velocity_m_s[..., 0] == pytest.approx(1.0, abs=2e-3)
    assert np.abs(report.velocity_m_s[..., 1:]).max() < 2e-3


# A jet in the middle of the low-x side of a box that is otherwise open, or a tube with walls around it.
def jet(kind, **options):
    nozzle = Inlet(min_m=(0, 1, 0.75), max_m=(0, 1.5, 1.25), velocity_m_s=(1, 0, 0))
    patches = [nozzle, *(kind(**side) for side in (FAR, LEFT, RIGHT, TOP, GROUND))]
    return solve_wind_report(np.ones(SHAPE, bool), CELL_M, patches, **{"end_time_s": 30.0, **options})


@pytest.mark.slow
@pytest.mark.parametrize("turbulence", ["k_epsilon", "smagorinsky"])
def test_a_jet_draws_air_in_through_open_sides_and_stays_bounded(turbulence):
    report = jet(Open, turbulence=turbulence)
    assert report.inflow_m3_s > 1.3 * 0.25
    assert report.mass_balance_relative <= 0.005
    assert report.divergence_relative <= 1e-4
    assert 0.9 < np.abs(report.velocity_m_s).max() < 1.2
    left, right = report.velocity_m_s[4:12, 0, :, 1], report.velocity_m_s[4:12, -1, :, 1]
    assert left.mean() > 0 > right.mean()


def test_air_that_is_pulled_in_pays_for_its_speed_with_pressure():
    """A fan at the end of a frictionless duct: p + u^2 / 2 = 0 inside, by Bernoulli, behind an open mouth."""
    free = np.ones((12, 4, 4), bool)
    sides = [SlipWall(min_m=(0, y, 0), max_m=(3, y, 1)) for y in (0.0, 1.0)]
    sides += [SlipWall(min_m=(0, 0, z), max_m=(3, 1, z)) for z in (0.0, 1.0)]
    fan = Inlet(min_m=(3, 0, 0), max_m=(3, 1, 1), velocity_m_s=(2, 0, 0))
    domain = build_domain(free, CELL_M, [fan, Open(min_m=(0, 0, 0), max_m=(0, 1, 1)), *sides])
    # At a Courant number of 0.9 waves of the impulsive start take long to die away in a duct without friction.
    solver = FlowSolver(domain, Laminar(domain, 1e-5), courant=0.7)
    while solver.time_s < 3.0:
        solver.step(until_s=3.0)
    assert solver.pressure[2:-3, 2:-3, 2:-3] == pytest.approx(-2.0, abs=0.02)


def test_an_open_side_is_an_outlet_to_the_checks_of_a_room():
    lid = MovingWall(min_m=(0, 0, 2), max_m=(4, 2.5, 2), velocity_m_s=(1, 0, 0))
    domain = build_domain(np.ones(SHAPE, bool), CELL_M, [Open(**FAR), lid], needs_openings=False)
    assert not domain.is_closed
    assert isinstance(domain.outlets[0].patch, Outlet)
