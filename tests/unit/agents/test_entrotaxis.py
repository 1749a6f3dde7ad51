import math

import numpy as np
import pytest
from briefings import briefing, observation
from ribbon_world import Ribbon, fly

from gslcosim.base.errors import MethodError
from gslcosim_agents.entrotaxis.agent import Entrotaxis

PID = (("pid", "nose"), ("anemometer", "vane"))
COME = "Find the source of ethanol in the room: come within 1 m of it in at most 300 s."


def made(**parameters):
    return Entrotaxis(briefing(sensors=PID, parameters=parameters))


def at(time_s, place_m, *, ppm=0.0):
    readings = {"nose": ppm, "vane": (0.4, math.pi)}
    return observation(tick=round(10 * time_s), position_m=place_m, readings=readings)


def chosen(agent, place_m=(7.0, 5.0, 2.0)):
    """Where the agent goes, and the outlook that it has weighed."""
    agent.observe(at(4.0, place_m))
    context = agent.search.build_context(place_m[: agent.search.grid.dimensions])
    return np.array(agent.decide(at(4.0, place_m)).position_world_m), context


def informed(agent, seed=5):
    """Let an agent hold a belief with several peaks."""
    p = np.random.default_rng(seed).random(agent.search.grid.n_cells) ** 8
    agent.search._memory.p = p / p.sum()
    return agent


def bits(p):
    p = np.asarray(p)[np.asarray(p) > 0.0]
    return float(-(p * np.log2(p)).sum())


def test_it_finds_the_source_of_a_plume_in_a_steady_wind():
    flight = fly(Entrotaxis, Ribbon(half_m=0.4, spread=0.08), mission=COME, limit_s=120.0)
    assert flight.found_s is not None


def test_without_a_vane_it_says_so_at_its_briefing():
    with pytest.raises(MethodError, match="wind"):
        Entrotaxis(briefing(sensors=(("pid", "nose"),)))


def test_a_parameter_out_of_range_is_refused():
    with pytest.raises(MethodError, match="step_m"):
        made(step_m=-1.0)


def test_it_goes_where_the_next_reading_is_least_certain():
    place_m, context = chosen(informed(made(declares=False)))
    stops = context.survey([tuple(place) for place in context.places_m])
    chances = np.array([rows @ context.p for rows in stops.likelihood])
    doubts = [novelty * bits(row) for novelty, row in zip(context.novelty, chances)]
    assert place_m[:2] == pytest.approx(context.places_m[int(np.argmax(doubts))])


def test_a_place_where_something_was_found_counts_half():
    agent = made(declares=False, stop_s=1.0)
    for k in range(21):
        agent.observe(at(4.0 + 0.1 * k, (7.0, 5.0, 2.0)))
    agent.decide(at(6.0, (7.0, 5.0, 2.0)))
    around = agent.search.build_context((8.5, 5.0))
    back = int(np.argmin(np.linalg.norm(around.places_m - (7.0, 5.0), axis=1)))
    assert around.novelty[back] < 0.6
    assert np.delete(around.novelty, back) == pytest.approx(1.0)
