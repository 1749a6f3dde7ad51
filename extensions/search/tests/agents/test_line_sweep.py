import numpy as np
import pytest
from team_flight import TeamFlight, plume

from gslcosim_agents.line_sweep.agent import LineSweep

SOURCE = (3.0, 5.0)
STARTS = {f"robot_{i}": (12.0, 2.0 + i) for i in range(4)}


def no_gas(_x, _y):
    return 0.0


@pytest.mark.slow
def test_the_sweep_comes_near_to_every_place_across_the_wind():
    """Along the wind no place is farther than half a spacing from some robot's lane, all the way across it."""
    flight = TeamFlight(LineSweep, STARTS, gas=no_gas, parameters={"spacing_m": 1.5, "hold_s": 0.2})
    flight.fly(240.0)
    track = np.array([place[:2] for vehicle in flight.vehicles.values() for place in vehicle.track_m])
    xs, ys = np.meshgrid(np.arange(1.0, 14.1, 0.5), np.arange(1.0, 9.1, 0.5))
    for place in np.column_stack((xs.ravel(), ys.ravel())):
        assert np.hypot(*(track - place).T).min() < 0.75 + 0.6


def test_the_line_is_diagonal_and_equally_spaced():
    flight = TeamFlight(LineSweep, STARTS, gas=no_gas, parameters={"spacing_m": 1.0})
    flight.fly(40.0)
    places = flight.places_m()
    steps = np.diff(places, axis=0)
    assert np.abs(steps) == pytest.approx(1.0, abs=0.3)


@pytest.mark.slow
@pytest.mark.parametrize("loss_frac", [0.0, 0.1])
def test_a_team_finds_the_source_and_converges_on_it(loss_frac):
    flight = TeamFlight(LineSweep, STARTS, gas=plume(SOURCE), loss_frac=loss_frac)
    assert flight.fly(250.0, lambda f: f.nearest_m(SOURCE) < 0.8) < 250.0
    flight.fly(flight.tick * 0.2 + 60.0)
    assert np.hypot(*(flight.places_m().mean(axis=0) - SOURCE)) < 2.0


@pytest.mark.slow
def test_it_declares_near_the_source_and_not_without_gas():
    with_gas = TeamFlight(LineSweep, STARTS, gas=plume(SOURCE))
    with_gas.fly(200.0, lambda f: len(f.declared) >= 4)
    assert with_gas.declared
    for _, command in with_gas.declared:
        place_m = command.declaration.position_world_m[:2]
        assert np.hypot(*np.subtract(place_m, SOURCE)) < 1.5
    without = TeamFlight(LineSweep, STARTS, gas=no_gas)
    without.fly(120.0)
    assert not without.declared


@pytest.mark.slow
def test_gas_that_is_gone_is_given_up_and_the_sweep_goes_on():
    state = {"on": True}
    flight = TeamFlight(LineSweep, STARTS, gas=lambda x, y: 5.0 if state["on"] and x > 9.0 else 0.0)
    flight.fly(30.0)
    assert all(vehicle.agent.best is not None for vehicle in flight.vehicles.values())
    state["on"] = False
    flight.fly(120.0)
    assert all(vehicle.agent.best is None for vehicle in flight.vehicles.values())
    assert flight.vehicles["robot_0"].agent.n_swept > 3
