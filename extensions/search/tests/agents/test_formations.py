import math

import numpy as np
import pytest
from team_flight import TeamFlight, plume

from gslcosim_agents.fluxotaxis.agent import Fluxotaxis
from gslcosim_agents.laplacian.agent import Laplacian
from gslcosim_agents.line_sweep.agent import LineSweep
from gslcosim_agents.plane_fit.agent import PlaneFit

SOURCE = (3.0, 5.0)
STARTS = {"ada": (11.0, 3.0), "bob": (12.0, 3.0), "cyd": (11.5, 4.0)}
FIVE = {f"robot_{i}": (11.0 + 0.8 * (i % 3), 4.2 + 0.8 * (i // 3)) for i in range(5)}
LINE = {f"robot_{i}": (12.0, 2.0 + i) for i in range(4)}
SIX = {f"robot_{i}": (11.0 + 0.8 * (i % 3), 3.2 + 0.8 * (i // 3)) for i in range(6)}


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


@pytest.mark.parametrize("towards_rad", [1.0, -2.0])
def test_without_a_share_of_the_wind_the_team_goes_up_the_slope(towards_rad):
    moved = displacement(slope(towards_rad), wind_share=0.0)
    assert math.hypot(*moved) > 1.0
    assert math.atan2(moved[1], moved[0]) == pytest.approx(towards_rad, abs=0.1)


def test_with_half_of_it_the_wind_the_team_goes_between_slope_and_upwind():
    # The wind comes from -x, the slope leads to +y.
    moved = displacement(slope(math.pi / 2.0), wind_share=0.5)
    assert moved[0] == pytest.approx(-moved[1], rel=0.2)


def even(_x, _y):
    return 3.0


def flown(gas, time_s, starts=None, **settings):
    flight = TeamFlight(Laplacian, starts or FIVE, gas=gas, parameters=settings)
    flight.fly(time_s)
    return flight


def test_in_even_gas_the_formation_moves_straight_up_the_wind():
    flight = flown(even, 9.0, widen_frac=0.0)
    before = flight.places_m().mean(axis=0)
    flight.fly(25.0)
    moved = flight.places_m().mean(axis=0) - before
    assert moved[0] < -1.5
    assert abs(moved[1]) < 0.2 * abs(moved[0])


def no_gas(_x, _y):
    return 0.0


@pytest.mark.slow
def test_the_sweep_comes_near_to_every_place_across_the_wind():
    """Along the wind no place is farther than half a spacing from some robot's lane, all the way across it."""
    flight = TeamFlight(LineSweep, LINE, gas=no_gas, parameters={"spacing_m": 1.5, "hold_s": 0.2})
    flight.fly(240.0)
    track = np.array([place[:2] for vehicle in flight.vehicles.values() for place in vehicle.track_m])
    xs, ys = np.meshgrid(np.arange(1.0, 14.1, 0.5), np.arange(1.0, 9.1, 0.5))
    for place in np.column_stack((xs.ravel(), ys.ravel())):
        assert np.hypot(*(track - place).T).min() < 0.75 + 0.6


def test_the_line_is_diagonal_and_equally_spaced():
    flight = TeamFlight(LineSweep, LINE, gas=no_gas, parameters={"spacing_m": 1.0})
    flight.fly(40.0)
    places = flight.places_m()
    steps = np.diff(places, axis=0)
    assert np.abs(steps) == pytest.approx(1.0, abs=0.3)


@pytest.mark.slow
def test_a_team_finds_the_source_and_converges_on_it():
    flight = TeamFlight(LineSweep, LINE, gas=plume(SOURCE), loss_frac=0.1)
    assert flight.fly(250.0, lambda f: f.nearest_m(SOURCE) < 0.8) < 250.0
    flight.fly(flight.tick * 0.2 + 60.0)
    assert np.hypot(*(flight.places_m().mean(axis=0) - SOURCE)) < 2.0


@pytest.mark.slow
def test_it_declares_near_the_source_and_not_without_gas():
    with_gas = TeamFlight(LineSweep, LINE, gas=plume(SOURCE))
    with_gas.fly(200.0, lambda f: len(f.declared) >= 4)
    assert with_gas.declared
    for _, command in with_gas.declared:
        place_m = command.declaration.position_world_m[:2]
        assert np.hypot(*np.subtract(place_m, SOURCE)) < 1.5
    without = TeamFlight(LineSweep, LINE, gas=no_gas)
    without.fly(120.0)
    assert not without.declared


@pytest.mark.slow
def test_gas_that_is_gone_is_given_up_and_the_sweep_goes_on():
    state = {"on": True}
    flight = TeamFlight(LineSweep, LINE, gas=lambda x, y: 5.0 if state["on"] and x > 9.0 else 0.0)
    flight.fly(30.0)
    assert all(vehicle.agent.best is not None for vehicle in flight.vehicles.values())
    state["on"] = False
    flight.fly(120.0)
    assert all(vehicle.agent.best is None for vehicle in flight.vehicles.values())
    assert flight.vehicles["robot_0"].agent.n_swept > 3


def test_in_even_gas_the_lattice_moves_up_the_wind_in_its_shape():
    flight = TeamFlight(Fluxotaxis, SIX, gas=even, parameters={"spacing_m": 0.9})
    flight.fly(15.0)
    before = flight.places_m().mean(axis=0)
    flight.fly(30.0)
    places = flight.places_m()
    moved = places.mean(axis=0) - before
    assert moved[0] < -1.0
    assert abs(moved[1]) < 0.3
    assert np.hypot(*(places - places.mean(axis=0)).T) == pytest.approx(0.9, abs=0.5)


@pytest.mark.slow
@pytest.mark.parametrize("source", [(3.0, 5.0), (5.0, 6.0)])
def test_it_finds_the_source_and_declares_it_by_what_flows_out(source):
    flight = TeamFlight(Fluxotaxis, SIX, gas=plume(source))
    flight.fly(120.0, lambda f: len(f.declared) >= 6)
    assert flight.nearest_m(source) < 1.5
    places = {command.declaration.position_world_m[:2] for _, command in flight.declared}
    assert places
    for place_m in places:
        assert np.hypot(*np.subtract(place_m, source)) < 1.5


@pytest.mark.slow
@pytest.mark.parametrize("gas", [even, lambda _x, _y: 0.0], ids=["even", "none"])
def test_where_gas_only_passes_through_or_is_none_nothing_is_declared(gas):
    flight = TeamFlight(Fluxotaxis, SIX, gas=gas)
    flight.fly(60.0)
    assert not flight.declared


@pytest.mark.slow
@pytest.mark.parametrize(
    ("agent_type", "starts", "lost"),
    [
        (PlaneFit, {**STARTS, "dan": (12.5, 4.0)}, "ada"),
        (Laplacian, FIVE, "robot_2"),
        (Fluxotaxis, SIX, "robot_5"),
    ],
)
def test_a_team_finds_the_source_of_a_plume_though_texts_and_a_robot_are_lost(agent_type, starts, lost):
    flight = TeamFlight(agent_type, starts, gas=plume(SOURCE), loss_frac=0.1, lost_at_s={lost: 12.0})
    assert flight.fly(200.0, lambda f: f.nearest_m(SOURCE) < 1.0) < 200.0
