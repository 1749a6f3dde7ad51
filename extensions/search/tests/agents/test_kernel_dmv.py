import math

import numpy as np
import pytest
from briefings import briefing, observation, open_map

from gslcosim.base.bundled import bundled_agents
from gslcosim.runtime.agents.loader import load_python_agent

KernelDmv = load_python_agent(bundled_agents()["kernel_dmv"])
KernelDmvw = load_python_agent(bundled_agents()["kernel_dmvw"])


SIZE_M = (6.0, 5.0, 4.0)
START_M = (3.0, 2.5, 2.0)
PEAK_M = (1.5, 3.5)
SENSORS = (("pid", "nose"), ("anemometer", "vane"))
BOTH = pytest.mark.parametrize("method", [KernelDmv, KernelDmvw])


def mapper(method, *, seed: int = 1, known_map=None, sensors=SENSORS, **parameters):
    return method(briefing(sensors=sensors, seed=seed, size_m=SIZE_M, known_map=known_map, parameters=parameters))


def gas_ppm(position_m, draws) -> float:
    """Gas that varies near one place, and hardly anywhere else."""
    near = math.exp(-(math.dist(position_m[:2], PEAK_M) ** 2))
    return max(0.0, 5.0 * near * (1.0 + draws.normal()))


def flown(agent, n: int, *, gas=gas_ppm, refused=(), seed: int = 3):
    """Commands of a vehicle that flies to where it is sent in 1 s, seen ten times on the way."""
    draws, position_m, commands, notice = np.random.default_rng(seed), START_M, [], None
    target_m, tick = START_M, 40
    for i in range(n):
        for step in range(10):
            share = (step + 1) / 10.0
            place_m = tuple((1.0 - share) * a + share * b for a, b in zip(position_m, target_m))
            seen = observation(
                tick=tick + step,
                position_m=place_m,
                readings={"nose": gas(place_m, draws), "vane": (0.3, math.pi)},
                asked=step == 9,
                notice=notice if step == 9 else None,
            )
            agent.observe(seen)
        position_m, tick = place_m, tick + 10
        commands.append(agent.decide(seen))
        notice = "expected a free place" if i in refused else None
        target_m = commands[-1].position_world_m or position_m
        if notice is not None:
            target_m = position_m
    return commands


@BOTH
def test_a_sweep_comes_near_to_every_place(method):
    places_m = [command.position_world_m[:2] for command in flown(mapper(method), 25, gas=lambda *_: 0.0)]
    for corner_m in ((0.5, 0.5), (5.5, 0.5), (0.5, 4.5), (5.5, 4.5)):
        assert min(math.dist(corner_m, place_m) for place_m in places_m) < 0.3


@BOTH
def test_it_declares_near_where_the_gas_varies(method):
    declared = [c.declaration for c in flown(mapper(method), 60) if c.kind == "declare_source"]
    assert declared
    assert math.dist(declared[-1].position_world_m[:2], PEAK_M) < 1.0


@BOTH
def test_without_gas_it_declares_nothing(method):
    commands = flown(mapper(method), 60, gas=lambda _, draws: 0.001 * abs(draws.normal()))
    assert {command.kind for command in commands} == {"waypoint"}


@BOTH
def test_its_belief_is_the_variance_map_over_free_cells(method):
    known = open_map(SIZE_M[:2], walls=[(4.0, 1.0, 5.0, 2.0)])
    agent = mapper(method, known_map=known)
    beliefs = [command.belief for command in flown(agent, 30) if command.belief is not None]
    p = beliefs[-1].probability.to_array()
    assert p[agent.flights.grid.nearest_cell((4.5, 1.5))] == 0.0
    expected = agent.gas.maps().variance * agent.flights.free
    assert np.corrcoef(p.reshape(-1), expected.reshape(-1))[0, 1] > 0.99


@BOTH
def test_who_goes_where_it_is_worth_it_visits_much_gas_after_what_is_unknown(method):
    agent = mapper(method, motion="worth", curiosity=0.0)
    places_m = [
        c.position_world_m[:2]
        for c in flown(agent, 60, gas=lambda place_m, _: 5.0 - math.dist(place_m[:2], PEAK_M))
        if c.position_world_m
    ]
    assert min(math.dist(PEAK_M, place_m) for place_m in places_m) < 1.5
