import math

import pytest
from team_flight import TeamFlight, plume

from gslcosim_agents.laplacian.agent import Laplacian

SOURCE = (3.0, 5.0)
STARTS = {f"robot_{i}": (11.0 + 0.8 * (i % 3), 4.2 + 0.8 * (i // 3)) for i in range(5)}


def even(_x, _y):
    return 3.0


def flown(gas, time_s, starts=None, **settings):
    flight = TeamFlight(Laplacian, starts or STARTS, gas=gas, parameters=settings)
    flight.fly(time_s)
    return flight


def test_in_even_gas_the_formation_moves_straight_up_the_wind():
    flight = flown(even, 9.0, widen_frac=0.0)
    before = flight.places_m().mean(axis=0)
    flight.fly(25.0)
    moved = flight.places_m().mean(axis=0) - before
    assert moved[0] < -1.5
    assert abs(moved[1]) < 0.2 * abs(moved[0])


def test_the_formation_widens_in_wide_gas_and_draws_together_on_a_thread():
    wide = flown(even, 25.0, widen_frac=0.1).vehicles["robot_0"].agent.width
    thread = flown(lambda _x, y: 5.0 * math.exp(-(((y - 5.0) / 0.25) ** 2)), 30.0, widen_frac=0.1)
    assert wide > 1.2
    assert thread.vehicles["robot_0"].agent.width < 1.0


@pytest.mark.slow
@pytest.mark.parametrize("shape", ["square", "inverted_v", "hexagon"])
def test_a_team_finds_the_source_of_a_plume_in_any_shape(shape):
    flight = TeamFlight(Laplacian, STARTS, gas=plume(SOURCE), loss_frac=0.1, parameters={"shape": shape})
    assert flight.fly(150.0, lambda f: f.nearest_m(SOURCE) < 1.0) < 150.0


@pytest.mark.slow
def test_the_others_go_on_when_one_is_lost():
    flight = TeamFlight(Laplacian, STARTS, gas=plume(SOURCE), lost_at_s={"robot_2": 10.0})
    assert flight.fly(200.0, lambda f: f.nearest_m(SOURCE) < 1.0) < 200.0
