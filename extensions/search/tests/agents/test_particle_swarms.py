import math

import numpy as np
import pytest
from briefings import briefing, observation
from toy_swarm import ToySwarm, hill

from gslcosim.base.bundled import bundled_agents
from gslcosim.runtime.agents.loader import load_python_agent
from gslcosim_agents.c_pso.agent import CPso
from gslcosim_agents.dr_pso.agent import DrPso
from gslcosim_agents.pso_wu.agent import PsoWu
from gslcosim_search.swarms.rounds import parse

SPso = load_python_agent(bundled_agents()["s_pso"])
CORNERS = [(2.0, 13.0), (13.0, 13.0), (13.0, 2.0), (12.0, 8.0), (2.0, 9.0)]
TOP_M = (5.0, 4.0)
FOUR = ("a", "b", "c", "d")
STARTS = [(2.0, 13.0), (13.0, 13.0), (13.0, 2.0)]
MEMBERS = ("first", "searcher", "third")
PAIR = ("first", "searcher")
SENSORS = (("pid", "nose"), ("anemometer", "vane"))
FROM_WEST = (0.5, math.pi)


def best_of(swarm: ToySwarm):
    bests = [robot.agent.own_best for robot in swarm.robots]
    return max((best for best in bests if best is not None), key=lambda best: best.amount)


@pytest.mark.slow
@pytest.mark.parametrize("loss_frac", [0.0, 0.5])
def test_five_find_the_top_of_a_static_hill_though_texts_get_lost(loss_frac):
    parameters = {"fades_s": 0, "declares": False}
    swarm = ToySwarm(SPso, CORNERS, hill(*TOP_M), seed=1, parameters=parameters, loss_frac=loss_frac)
    assert swarm.fly(200.0, lambda swarm: swarm.tick % 50 == 0 and math.dist(best_of(swarm).place_m, TOP_M) < 0.5)


def c_pso(name: str, **parameters) -> CPso:
    return CPso(briefing(sensors=(("pid", "nose"),), members=FOUR, name=name, parameters=parameters))


def pushed(agent: CPso, *heard: tuple[str, str]) -> list[float]:
    """What the charges add to the step of a robot at (7, 5)."""
    question = observation(readings={"nose": 1.0}, heard=heard, name=agent.team.name)
    agent.observe(question)
    agent.take(question)
    return agent.push_m().tolist()


@pytest.mark.parametrize(("share", "charged"), [(0.5, {"a", "b"}), (0.0, set()), (1.0, set(FOUR)), (0.3, {"a", "b"})])
def test_the_first_by_name_are_charged_and_all_agree_who(share, charged):
    for name in FOUR:
        assert c_pso(name, charged_frac=share).charged == charged


def test_charges_push_each_other_and_no_other():
    text = "g 39 700 700 200 0"  # 2 m to the north
    assert pushed(c_pso("a"), ("b", text)) == pytest.approx([0.0, -0.25])
    assert pushed(c_pso("a"), ("c", text)) == [0.0, 0.0]
    assert pushed(c_pso("c"), ("a", text)) == [0.0, 0.0]
    assert pushed(c_pso("a"), ("b", "g 39 700 1200 200 0")) == [0.0, 0.0]  # beyond the reach of 5 m


def dr_pso(**parameters) -> DrPso:
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
    agent = dr_pso(patience=5, declares=False)
    restarts = [restarts_told(answer(agent, i, ppm=9.0 if i == 0 else 1.0)) for i in range(8)]
    # The best of the first leg is the same for five legs more; at the sixth all begins again.
    assert restarts == [0.0] * 5 + [1.0] * 3


def test_who_receives_that_another_restarted_does_so_too_and_old_bests_no_longer_count():
    agent = dr_pso(declares=False, fades_s=0)
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


def pso_wu(agent_type=PsoWu, seed=1, **parameters):
    return agent_type(briefing(sensors=SENSORS, members=PAIR, seed=seed, parameters={"declares": False, **parameters}))


def steps(agent, *, wind=FROM_WEST, best="b1200 500 200 9", n=40, start=0) -> np.ndarray:
    """Steps from (7, 5), drawn to a best of the swarm 5 m to the east, downwind."""
    found = []
    for i in range(start, start + n):
        heard = [("first", f"g {39 + 30 * i} 1200 500 200 0 {best}")]
        question = observation(tick=40 + 30 * i, readings={"nose": 0.5, "vane": wind}, heard=heard)
        agent.observe(question.model_copy(update={"tick": 39 + 30 * i, "status": "flying", "incoming": ()}))
        agent.observe(question)
        command = agent.decide(question)
        found.append(np.array(command.position_world_m[:2]) - (7.0, 5.0))
    return np.array(found)


def angles_to_downwind_deg(found: np.ndarray) -> np.ndarray:
    moving = found[np.hypot(*found.T) > 0.05]
    return np.degrees(np.abs(np.arctan2(moving[:, 1], moving[:, 0])))


@pytest.mark.parametrize("forbidden_deg", [60.0, 75.0, 90.0])
def test_variant_one_never_flies_into_the_cone_about_downwind(forbidden_deg):
    assert angles_to_downwind_deg(steps(pso_wu(SPso))).min() < 30.0
    angles = angles_to_downwind_deg(steps(pso_wu(variant="I", forbidden_deg=forbidden_deg)))
    assert angles.min() >= forbidden_deg - 0.2


def test_variant_two_flies_shorter_downwind_than_upwind():
    downwind = np.hypot(*steps(pso_wu(variant="II")).T)
    upwind = np.hypot(*steps(pso_wu(variant="II"), wind=(0.5, 0.0)).T)
    assert downwind.mean() < 0.1 * upwind.mean()


@pytest.mark.parametrize("variant", ["I", "II"])
def test_without_any_wind_it_is_s_pso(variant):
    assert steps(pso_wu(variant=variant), wind=(0.0, 0.0)) == pytest.approx(steps(pso_wu(SPso), wind=(0.0, 0.0)))
