import pytest
from briefings import open_map, task_of
from team_flight import TeamFlight, plume

from gslcosim.scenario.models.success import SourceSuccess
from gslcosim_agents.collaborative_infotaxis.agent import CollaborativeInfotaxis
from gslcosim_agents.sniffy_squad.agent import SniffySquad

SOURCE = (4.0, 5.0)
STARTS = {"ada": (11.0, 3.0), "bob": (12.0, 4.0), "cyd": (11.0, 6.0)}
COME = task_of(SourceSuccess())


def team(*, gas=None, **changes):
    settings = {"hold_s": 1.0, "task": COME, **changes}
    return TeamFlight(CollaborativeInfotaxis, STARTS, gas=gas or plume(SOURCE), **settings)


def agents_of(flight):
    return [vehicle.agent for vehicle in flight.vehicles.values()]


def findings_of(agent):
    return {(finding.finder, finding.number): finding for finding in agent.belief.findings}


def test_findings_that_were_lost_are_sent_again():
    flight = team(loss_frac=0.3)
    flight.fly(60.0)
    all_told = set().union(*(set(findings_of(agent)) for agent in agents_of(flight)))
    old = {key for key in all_told if key[1] <= max(n for f, n in all_told if f == key[0]) - 10}
    for agent in agents_of(flight):
        assert len(set(findings_of(agent)) & old) >= 0.9 * len(old)


@pytest.mark.slow
@pytest.mark.parametrize("fault", [{"loss_frac": 0.2}, {"lost_at_s": {"bob": 10.0}}], ids=["texts", "robot"])
def test_a_team_finds_the_source_of_a_plume_though_texts_or_a_robot_are_lost(fault):
    flight = team(**fault)
    assert flight.fly(250.0, lambda f: f.nearest_m(SOURCE) < 1.0) < 250.0


def squad(*, gas=None, starts=None, **changes):
    settings = {"known_map": open_map(), "hold_s": 1.0, **changes}
    return TeamFlight(SniffySquad, starts or STARTS, gas=gas or plume(SOURCE), **settings)


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
def test_a_squad_finds_the_source_of_a_plume_though_texts_are_lost():
    flight = squad(loss_frac=0.1)
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
