import numpy as np
import pytest
from team_flight import TeamFlight, plume

from gslcosim_agents.fluxotaxis.agent import Fluxotaxis

SOURCE = (3.0, 5.0)
STARTS = {f"robot_{i}": (11.0 + 0.8 * (i % 3), 3.2 + 0.8 * (i // 3)) for i in range(6)}


def even(_x, _y):
    return 3.0


def test_in_even_gas_the_lattice_moves_up_the_wind_in_its_shape():
    flight = TeamFlight(Fluxotaxis, STARTS, gas=even, parameters={"spacing_m": 0.9})
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
    flight = TeamFlight(Fluxotaxis, STARTS, gas=plume(source))
    flight.fly(120.0, lambda f: len(f.declared) >= 6)
    assert flight.nearest_m(source) < 1.5
    places = {command.declaration.position_world_m[:2] for _, command in flight.declared}
    assert places
    for place_m in places:
        assert np.hypot(*np.subtract(place_m, source)) < 1.5


@pytest.mark.slow
@pytest.mark.parametrize("gas", [even, lambda _x, _y: 0.0], ids=["even", "none"])
def test_where_gas_only_passes_through_or_is_none_nothing_is_declared(gas):
    flight = TeamFlight(Fluxotaxis, STARTS, gas=gas)
    flight.fly(60.0)
    assert not flight.declared


@pytest.mark.slow
def test_lost_texts_and_a_lost_robot_do_not_stop_the_lattice():
    flight = TeamFlight(Fluxotaxis, STARTS, gas=plume(SOURCE), loss_frac=0.1, lost_at_s={"robot_5": 15.0})
    assert flight.fly(150.0, lambda f: f.nearest_m(SOURCE) < 1.0) < 150.0
