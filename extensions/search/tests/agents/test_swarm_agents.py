"""Laws that every agent of the swarm family keeps, whatever its rule of motion."""

import math

import pytest
from briefings import briefing, observation

from gslcosim.base.bundled import bundled_agents
from gslcosim.runtime.agents.loader import load_python_agent
from gslcosim_agents.c_pso.agent import CPso
from gslcosim_agents.dr_pso.agent import DrPso
from gslcosim_agents.gso.agent import Gso
from gslcosim_agents.modified_gso.agent import ModifiedGso
from gslcosim_agents.pso_wu.agent import PsoWu
from gslcosim_agents.sniffy_bug.agent import SniffyBug
from gslcosim_search.swarms.rounds import parse

SPso = load_python_agent(bundled_agents()["s_pso"])

BY_LEGS = [SPso, DrPso, CPso, PsoWu, Gso, ModifiedGso]
ALL = [*BY_LEGS, SniffyBug]
SENSORS = (("pid", "nose"), ("anemometer", "vane"), ("four_range_finders", "around"))
MEMBERS = ("first", "searcher", "third")


def made(agent_type, **changes):
    return agent_type(briefing(**{"sensors": SENSORS, "members": MEMBERS, **changes}))


def seen(ppm=0.0, wind=(0.5, math.pi), ranges_m=(4.0, 4.0, 4.0, 4.0), **changes):
    readings = {"nose": ppm, "vane": wind, "around": ranges_m}
    return observation(**{"readings": readings, **changes})


def answer(agent, question):
    agent.observe(question)
    return agent.decide(question)


def flight(agent, n=15, position_m=(7.0, 5.0, 2.0), **changes):
    """Answers to questions 3 s apart, at the places that were commanded, in gas that comes and goes."""
    commands = []
    for i in range(n):
        question = seen(
            ppm=max(0.0, 5.0 * math.sin(i)), tick=40 + 30 * i, position_m=position_m,
            heard=[("first", f"g {35 + 30 * i} 900 {300 + 10 * i} 200 {i}")], **changes,
        )  # fmt: skip
        commands.append(answer(agent, question))
        position_m = commands[-1].position_world_m or position_m
    return commands


@pytest.mark.parametrize("agent_type", ALL)
def test_equal_seeds_give_equal_commands_and_others_differ(agent_type):
    first, same, other = (flight(made(agent_type, seed=seed)) for seed in (3, 3, 4))
    assert first == same
    assert first != other


@pytest.mark.parametrize("agent_type", BY_LEGS)
@pytest.mark.parametrize("place_m", [(7.0, 5.0, 2.0), (1.0, 1.0, 2.0), (14.9, 9.9, 2.0), (0.05, 5.0, 2.0)])
def test_legs_end_inside_the_margin_at_search_height(agent_type, place_m):
    for seed in range(5):
        for command in flight(made(agent_type, seed=seed, search_height_m=1.3), position_m=place_m):
            x_m, y_m, z_m = command.position_world_m
            assert 1.0 <= x_m <= 14.0
            assert 1.0 <= y_m <= 9.0
            assert z_m == 1.3


@pytest.mark.parametrize("agent_type", ALL)
@pytest.mark.parametrize(
    "changes",
    [
        {"wind": (0.0, 0.0)},
        {"ppm": 1e12, "wind": (0.0, 0.3)},
        {"ranges_m": (0.0, 0.0, 0.0, 0.0)},
        {"warming": ("nose", "vane")},
        {"notice": "outside"},
        {"heard": [("first", "1.0 2.0"), ("first", "g 1 2"), ("stranger", "g 1 100 100 100 5"), ("third", "{}")]},
        {"heard": [("first", "g 40 700 500 200 9999e9"), ("third", "g 40 700 500 200 0 b99999 99999 0 5")]},
        {"position_m": (-1.0, 99.0, 50.0)},
    ],
)
def test_it_survives_whatever_it_is_shown(agent_type, changes):
    agent = made(agent_type)
    for i in range(8):
        command = answer(agent, seen(**{"tick": 40 + 200 * i, **changes}))
        numbers = (*(command.position_world_m or ()), *(command.velocity_world_m_s or ()))
        assert all(math.isfinite(number) for number in numbers)


@pytest.mark.parametrize("agent_type", ALL)
def test_what_it_says_fits_the_channel_and_is_understood(agent_type):
    narrow = briefing(members=MEMBERS).channels[0].model_copy(update={"max_bytes": 64})
    for command in flight(made(agent_type, channels=(narrow,))):
        (message,) = command.outgoing
        assert len(message.text.encode()) <= 64
        assert parse(message.text) is not None


@pytest.mark.parametrize("agent_type", ALL)
def test_what_one_smells_the_others_receive(agent_type):
    agent = made(agent_type)
    answer(agent, seen(ppm=0.0))
    command = answer(agent, seen(ppm=7.0, tick=80, position_m=(6.0, 4.0, 2.0)))
    report = parse(command.outgoing[0].text)
    assert report.amount == 7.0
    assert (report.best.position_m, report.best.amount) == ((6.0, 4.0, 2.0), 7.0)


@pytest.mark.parametrize("agent_type", ALL)
def test_what_was_received_is_passed_on(agent_type):
    """Who is out of reach of the finder learns of it from one in between."""
    agent = made(agent_type)
    found = "g 30 900 300 200 0 b500 200 200 12"
    report = parse(answer(agent, seen(heard=[("first", found)])).outgoing[0].text)
    assert report.best.position_m[:2] == (5.0, 2.0)
    assert report.best.amount == pytest.approx(12.0, rel=0.01)


@pytest.mark.parametrize("agent_type", ALL)
def test_without_gas_nothing_is_declared(agent_type):
    agent = made(agent_type)
    kinds = {answer(agent, seen(tick=40 + 30 * i)).kind for i in range(100)}
    assert "declare_source" not in kinds


@pytest.mark.parametrize("agent_type", ALL)
def test_a_best_that_all_have_come_to_is_declared_once(agent_type):
    agent, declared = made(agent_type), []
    for i in range(40):
        ppm = 9.0 if i == 0 else 0.5
        near = [(name, f"g {39 + 10 * i} 720 520 200 1") for name in ("first", "third")]
        question = seen(ppm=ppm, tick=40 + 10 * i, position_m=(7.0, 5.0, 2.0), heard=near)
        declared += [command for command in [answer(agent, question)] if command.declaration is not None]
    assert len(declared) == 1
    assert declared[0].declaration.position_world_m == (7.0, 5.0, 2.0)
    assert declared[0].declaration.confidence == 1.0


@pytest.mark.parametrize("agent_type", ALL)
def test_declaring_can_be_switched_off(agent_type):
    agent = made(agent_type, parameters={"declares": False})
    near = [(name, "g 39 720 520 200 1") for name in ("first", "third")]
    assert all(answer(agent, seen(ppm=9.0, tick=40 + 10 * i, heard=near)).declaration is None for i in range(99))


@pytest.mark.parametrize("agent_type", BY_LEGS)
def test_asked_at_every_tick_it_lets_a_leg_end_first(agent_type):
    agent = made(agent_type, mode="lockstep")
    first = answer(agent, seen(tick=40))
    assert first.kind == "waypoint"
    assert answer(agent, seen(tick=41)).kind == "noop"
