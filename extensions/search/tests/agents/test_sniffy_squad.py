import numpy as np
import pytest
from briefings import open_map
from team_flight import TeamFlight, plume

from gslcosim_agents.sniffy_squad.agent import SniffySquad

SOURCE = (4.0, 5.0)
STARTS = {"ada": (11.0, 3.0), "bob": (12.0, 4.0), "cyd": (11.0, 6.0)}


def squad(*, gas=None, starts=None, **changes):
    settings = {"known_map": open_map(), "hold_s": 1.0, **changes}
    return TeamFlight(SniffySquad, starts or STARTS, gas=gas or plume(SOURCE), **settings)


def test_all_hold_the_same_belief_and_roles_of_their_own():
    flight = squad()
    flight.fly(25.0)
    agents = [vehicle.agent for vehicle in flight.vehicles.values()]
    numbers = {agent.rounds.number for agent in agents}
    if len(numbers) == 1:
        assert np.array_equal(agents[0].method.p, agents[1].method.p)
        assert np.array_equal(agents[0].method.p, agents[2].method.p)
    assert sorted(agent.role for agent in agents) == [0, 1, 2]


def test_roles_are_swapped_when_the_colder_robot_stands_worse():
    """Without swaps each keeps the role of its name; with them the roles move about."""
    fixed, free = squad(parameters={"attempt": 0.0}), squad()
    for flight in (fixed, free):
        flight.fly(45.0)
    assert [vehicle.agent.role for vehicle in fixed.vehicles.values()] == [0, 1, 2]
    roles = {tuple(vehicle.agent.role for vehicle in free.vehicles.values())}
    while len(roles) == 1 and free.tick < 600:
        free.step()
        roles.add(tuple(vehicle.agent.role for vehicle in free.vehicles.values()))
    assert len(roles) > 1


@pytest.mark.slow
@pytest.mark.parametrize("loss_frac", [0.0, 0.1])
def test_a_squad_finds_the_source_of_a_plume(loss_frac):
    flight = squad(loss_frac=loss_frac)
    assert flight.fly(250.0, lambda f: f.nearest_m(SOURCE) < 1.0) < 250.0


@pytest.mark.slow
def test_no_step_ends_in_a_wall():
    wall = (6.0, 0.0, 7.0, 6.0)
    flight = squad(
        known_map=open_map(walls=[wall]), refuses=lambda x, y: 6.0 <= x <= 7.0 and y <= 6.0,
    )  # fmt: skip
    flight.fly(60.0)
    ends = [c.position_world_m for v in flight.vehicles.values() for c in v.commands if c.kind == "waypoint"]
    assert ends
    assert not any(6.0 <= x <= 7.0 and y <= 6.0 for x, y, _ in ends)


@pytest.mark.slow
def test_the_others_go_on_when_one_is_lost():
    flight = squad(lost_at_s={"bob": 10.0})
    flight.fly(60.0)
    assert {vehicle.agent.rounds.number > 5 for name, vehicle in flight.vehicles.items() if name != "bob"} == {True}
