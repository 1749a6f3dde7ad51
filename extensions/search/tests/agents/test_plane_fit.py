import math

import pytest
from team_flight import TeamFlight, plume

from gslcosim_agents.plane_fit.agent import PlaneFit

SOURCE = (3.0, 5.0)
STARTS = {"ada": (11.0, 3.0), "bob": (12.0, 3.0), "cyd": (11.5, 4.0)}


def slope(towards_rad):
    """Gas that grows by 1 ppm a metre in one direction, everywhere."""
    return lambda x, y: 20.0 + x * math.cos(towards_rad) + y * math.sin(towards_rad)


def displacement(gas, **settings):
    """Where the centre of a team goes once it has formed up in the middle of the room."""
    starts = {"ada": (7.9, 5.0), "bob": (6.6, 5.8), "cyd": (6.6, 4.2)}
    flight = TeamFlight(PlaneFit, starts, gas=gas, parameters=settings, hold_s=1.0)
    flight.fly(5.0)
    before = flight.places_m().mean(axis=0)
    flight.fly(13.0)
    return flight.places_m().mean(axis=0) - before


@pytest.mark.parametrize("towards_rad", [0.0, 1.0, 2.5, -2.0])
def test_without_a_share_of_the_wind_the_team_goes_up_the_slope(towards_rad):
    moved = displacement(slope(towards_rad), wind_share=0.0)
    assert math.hypot(*moved) > 1.0
    assert math.atan2(moved[1], moved[0]) == pytest.approx(towards_rad, abs=0.1)


def test_with_half_of_it_the_wind_the_team_goes_between_slope_and_upwind():
    # The wind comes from -x, the slope leads to +y.
    moved = displacement(slope(math.pi / 2.0), wind_share=0.5)
    assert moved[0] == pytest.approx(-moved[1], rel=0.2)


@pytest.mark.slow
@pytest.mark.parametrize("loss_frac", [0.0, 0.2])
def test_a_team_finds_the_source_of_a_plume_though_texts_get_lost(loss_frac):
    flight = TeamFlight(PlaneFit, STARTS, gas=plume(SOURCE), loss_frac=loss_frac)
    assert flight.fly(150.0, lambda f: f.nearest_m(SOURCE) < 1.0) < 150.0


@pytest.mark.slow
def test_the_others_go_on_when_one_is_lost():
    starts = {**STARTS, "dan": (12.5, 4.0)}
    flight = TeamFlight(PlaneFit, starts, gas=plume(SOURCE), lost_at_s={"ada": 12.0})
    assert flight.fly(200.0, lambda f: f.nearest_m(SOURCE) < 1.0) < 200.0
