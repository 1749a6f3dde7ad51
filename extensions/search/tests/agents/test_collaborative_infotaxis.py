import pytest
from briefings import task_of
from team_flight import TeamFlight, plume

from gslcosim.scenario.models.success import SourceSuccess
from gslcosim_agents.collaborative_infotaxis.agent import CollaborativeInfotaxis

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
@pytest.mark.parametrize("loss_frac", [0.0, 0.2])
def test_a_team_finds_the_source_of_a_plume(loss_frac):
    flight = team(loss_frac=loss_frac)
    assert flight.fly(250.0, lambda f: f.nearest_m(SOURCE) < 1.0) < 250.0


@pytest.mark.slow
def test_the_others_go_on_when_one_is_lost():
    flight = team(lost_at_s={"bob": 10.0})
    assert flight.fly(250.0, lambda f: f.nearest_m(SOURCE) < 1.0) < 250.0
