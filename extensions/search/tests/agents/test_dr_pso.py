import math

import pytest
from briefings import briefing, observation
from toy_swarm import ToySwarm, hill

from gslcosim.base.bundled import bundled_agents
from gslcosim.runtime.agents.loader import load_python_agent
from gslcosim_agents.dr_pso.agent import DrPso
from gslcosim_search.swarms.rounds import parse

SPso = load_python_agent(bundled_agents()["s_pso"])

STARTS = [(2.0, 13.0), (13.0, 13.0), (13.0, 2.0)]
MEMBERS = ("first", "searcher", "third")


def made(**parameters) -> DrPso:
    return DrPso(briefing(sensors=(("pid", "nose"),), members=MEMBERS, parameters=parameters))


def answer(agent, i, *, ppm, heard=()):
    question = observation(tick=40 + 30 * i, readings={"nose": ppm}, heard=heard)
    agent.observe(question.model_copy(update={"tick": 39 + 30 * i, "status": "flying", "incoming": ()}))
    agent.observe(question)
    return agent.decide(question)


def restarts_told(command) -> float:
    numbers = parse(command.outgoing[0].text).numbers
    return numbers[0] if numbers else 0.0


def test_it_begins_again_after_so_many_legs_with_the_same_best():
    agent = made(patience=5, declares=False)
    restarts = [restarts_told(answer(agent, i, ppm=9.0 if i == 0 else 1.0)) for i in range(8)]
    # The best of the first leg is the same for five legs more; at the sixth all begins again.
    assert restarts == [0.0] * 5 + [1.0] * 3


def test_it_spreads_for_so_many_legs():
    agent = made(patience=3, spread_legs=2, declares=False)
    for i in range(4):
        answer(agent, i, ppm=9.0 if i == 0 else 1.0)
    assert agent.n_spreading == 1  # the leg of the restart was the first
    answer(agent, 4, ppm=1.0)
    assert agent.n_spreading == 0


def test_half_of_them_spread_if_asked():
    spreading = []
    for name in MEMBERS:
        agent = DrPso(briefing(sensors=(("pid", "nose"),), members=MEMBERS, name=name, parameters={"spreads": "half"}))
        agent.respond(1)
        spreading.append(agent.n_spreading > 0)
    assert spreading == [True, False, True]


def test_who_receives_that_another_restarted_does_so_too_and_old_bests_no_longer_count():
    agent = made(declares=False, fades_s=0)
    answer(agent, 0, ppm=9.0)
    answer(agent, 1, ppm=0.0, heard=[("first", "g 70 900 900 200 2 b900 900 200 2 n1")])
    assert agent.n_restarts == 1
    assert agent.own_best is None
    assert agent.swarm_best().amount == 2.0
    # The third has not heard of it yet, and tells the best of before: it does not count.
    answer(agent, 2, ppm=0.0, heard=[("third", "g 95 300 300 200 0 b700 500 200 9 n0")])
    assert agent.swarm_best().amount == 2.0


@pytest.mark.slow
def test_it_follows_gas_that_has_moved_where_s_pso_stays():
    """A hill that is replaced after 60 s by a lower one elsewhere: only the swarm that forgets leaves the old best."""
    found = {}
    for agent_type in (DrPso, SPso):
        clock = {}

        def gas(x, y, clock=clock):
            return hill(4.0, 4.0)(x, y) if clock["swarm"].time_s < 60.0 else hill(11.0, 11.0, ppm=50.0)(x, y)

        parameters = {"declares": False, "fades_s": 0}
        swarm = clock["swarm"] = ToySwarm(agent_type, STARTS, gas, seed=3, parameters=parameters)
        swarm.fly(260.0)
        found[agent_type] = swarm.robots[0].agent.swarm_best().place_m
    assert math.dist(found[DrPso], (11.0, 11.0)) < 1.5
    assert math.dist(found[SPso], (4.0, 4.0)) < 1.5
