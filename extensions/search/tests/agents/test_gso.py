import math

import numpy as np
import pytest
from briefings import briefing, observation
from toy_swarm import ToySwarm

from gslcosim_agents.gso.agent import Gso
from gslcosim_agents.modified_gso.agent import ModifiedGso
from gslcosim_search.swarms.rounds import parse

MEMBERS = ("first", "searcher", "third")
SENSORS = (("pid", "nose"), ("anemometer", "vane"))
FROM_WEST = (0.5, math.pi)


def made(**parameters) -> Gso:
    return Gso(briefing(sensors=SENSORS, members=MEMBERS, parameters={"declares": False, **parameters}))


def leg(agent, *, ppm=0.0, heard=(), wind=FROM_WEST, tick=40, place_m=(7.0, 5.0)):
    """The commanded leg [m], measured after another one, and the luciferin that is sent."""
    question = observation(tick=tick, position_m=(*place_m, 2.0), readings={"nose": ppm, "vane": wind}, heard=heard)
    agent.observe(question.model_copy(update={"tick": tick - 1, "status": "flying", "incoming": ()}))
    agent.observe(question)
    command = agent.decide(question)
    return np.array(command.position_world_m[:2]) - place_m, parse(command.outgoing[0].text).numbers[0]


def test_the_brightest_flies_upwind():
    step, luciferin = leg(made(), ppm=3.0, heard=[("first", "g 39 900 500 200 1 n1")])
    assert step == pytest.approx([-1.0, 0.0], abs=2e-3)
    assert luciferin == 3.0


def test_one_who_glows_more_is_followed():
    step, _ = leg(made(), ppm=3.0, heard=[("first", "g 39 700 900 200 1 n7")])
    assert step == pytest.approx([0.0, 1.0], abs=2e-3)


def test_who_is_too_near_is_circled():
    """From 0.8 m to the west of the other one: to the circle of 1.5 m about it, and along it."""
    step, _ = leg(made(), ppm=3.0, heard=[("first", "g 39 780 500 200 1 n7")])
    place = np.array([7.0, 5.0]) + step
    assert np.hypot(*step) == pytest.approx(1.0, abs=2e-3)
    assert math.dist(place, (7.8, 5.0)) > 0.8
    assert abs(step[1]) > 0.5


def test_the_basic_rule_decays_and_its_brightest_stays():
    agent = made(version="basic")
    step, luciferin = leg(agent, ppm=10.0)
    assert luciferin == pytest.approx(0.6 * 5.0 + 0.6 * 10.0)
    assert step == pytest.approx([0.0, 0.0], abs=2e-3)


@pytest.mark.slow
def test_five_gather_about_the_source_of_a_plume():
    """Gas that grows towards the source upwind: all come near, by following or upwind."""

    def plume(x, y):
        along = x - 3.0
        return 50.0 * math.exp(-((y - 7.0) ** 2) / 4.0) / (1.0 + along) if along > 0.0 else 0.0

    starts = [(12.0, 3.0), (12.0, 7.5), (12.0, 12.0), (7.0, 2.0), (7.0, 12.0)]
    swarm = ToySwarm(Gso, starts, plume, seed=1, parameters={"declares": False})
    best = {robot.name: math.inf for robot in swarm.robots}

    def note(swarm):
        for robot in swarm.robots:
            best[robot.name] = min(best[robot.name], math.dist(robot.place_m, (3.0, 7.0)))
        return max(best.values()) < 2.5

    assert swarm.fly(200.0, note)


def made_modified(**parameters) -> ModifiedGso:
    return ModifiedGso(briefing(sensors=SENSORS, members=MEMBERS, parameters=parameters))


def answer(agent, *, ppm=0.0, heard=(), wind=(0.5, math.pi), tick=40, place_m=(7.0, 5.0)):
    question = observation(tick=tick, position_m=(*place_m, 2.0), readings={"nose": ppm, "vane": wind}, heard=heard)
    agent.observe(question.model_copy(update={"tick": tick - 1, "status": "flying", "incoming": ()}))
    agent.observe(question)
    return agent.decide(question)


def step(command, place_m=(7.0, 5.0)):
    return np.array(command.position_world_m[:2]) - place_m


def test_gas_in_a_declared_region_no_longer_counts():
    agent = made_modified()
    answer(agent, ppm=5.0)
    assert agent.luciferin == 5.0
    agent.forbid((7.5, 5.0))
    answer(agent, ppm=9.0, tick=60)
    assert (agent.luciferin, agent.amount) == (0.0, 0.0)
    assert agent.swarm_best() is None


def test_who_is_led_into_a_declared_region_flies_elsewhere_before_gas_counts_again():
    agent = made_modified(forbidden_m=2.0)
    agent.forbid((8.0, 5.0))
    place_m, legs = (7.0, 5.0), []
    for i in range(30):
        legs.append(step(answer(agent, ppm=9.0, tick=40 + 20 * i, place_m=place_m), place_m))
        if not agent.is_leaving:
            break
        place_m = (place_m[0] + legs[-1][0], place_m[1] + legs[-1][1])
    steps_m = np.array(legs[:-1])
    assert len(steps_m) > 1
    assert np.degrees(np.arctan2(steps_m[:, 1], steps_m[:, 0])).std() < 1.0  # straight, whatever it smells
    assert math.dist(place_m, (8.0, 5.0)) > 2.0
    assert legs[-1] == pytest.approx([-1.0, 0.0], abs=2e-3)  # upwind again


def test_what_others_have_declared_is_forbidden_too_and_passed_on():
    agent = made_modified()
    report = parse(answer(agent, heard=[("first", "g 39 900 900 200 0 n0 1250 475")]).outgoing[0].text)
    assert agent.declared_m == [(12.5, 4.75)]
    assert report.numbers[1:] == (1250.0, 475.0)


def test_places_in_one_region_are_one_source_and_all_are_sent_in_turn():
    agent = made_modified(forbidden_m=2.0)
    for place_m in ((2.0, 2.0), (3.0, 2.0), (12.0, 8.0)):
        agent.forbid(place_m)
    assert agent.declared_m == [(2.0, 2.0), (12.0, 8.0)]
    report = {parse(answer(agent, tick=40 + 30 * i).outgoing[0].text).numbers[1:] for i in range(4)}
    assert report == {(200.0, 200.0), (1200.0, 800.0)}


def test_a_declaration_forbids_its_place():
    agent = made_modified(near_s=5.0)
    near = [(name, "g 39 720 520 200 1 n1") for name in ("first", "third")]
    commands = [answer(agent, ppm=9.0 if i == 0 else 2.0, tick=40 + 10 * i, heard=near) for i in range(8)]
    assert [command.kind for command in commands].count("declare_source") == 1
    assert agent.declared_m == [(7.0, 5.0)]


def test_a_zigzag_flies_at_its_angle_to_upwind_and_turns_at_walls():
    agent, place_m, angles = made_modified(finding="zigzag", zigzag_deg=60.0), (10.0, 5.0), []
    for i in range(9):
        leg = step(answer(agent, tick=40 + 20 * i, place_m=place_m), place_m)
        angles.append(round(math.degrees(math.atan2(leg[1], -leg[0]))))
        place_m = (place_m[0] + leg[0], place_m[1] + leg[1])
    assert {abs(angle) for angle in angles} == {60}
    assert len(set(angles)) == 2


def two_plumes(x, y):
    return sum(
        60.0 * math.exp(-((y - y0) ** 2) / 2.0) / (1.0 + 0.5 * (x - x0)) if x >= x0 else 0.0
        for x0, y0 in ((4.0, 4.0), (9.0, 11.0))
    )


@pytest.mark.slow
def test_two_sources_are_declared_one_after_the_other():
    starts = [(13.0, 2.0), (13.0, 7.5), (13.0, 13.0)]
    swarm = ToySwarm(ModifiedGso, starts, two_plumes, seed=1, parameters={"unchanged_s": 20, "fades_s": 0})

    def are_both_found(swarm):
        places = [declared.position_world_m[:2] for declared in swarm.declarations]
        return all(any(math.dist(place, source) < 2.0 for place in places) for source in ((4.0, 4.0), (9.0, 11.0)))

    assert swarm.fly(300.0, are_both_found)
