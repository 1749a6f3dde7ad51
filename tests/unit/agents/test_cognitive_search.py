import math

import numpy as np
import pytest
from briefings import briefing, observation
from ribbon_world import Ribbon, fly

from gslcosim.base.errors import MethodError
from gslcosim_agents.cognitive_search.agent import CognitiveSearch

PID = (("pid", "nose"), ("anemometer", "vane"))
COME = "Find the source of ethanol in the room: come within 1 m of it in at most 300 s."


def made(**parameters):
    return CognitiveSearch(briefing(sensors=PID, parameters=parameters))


def at(time_s, place_m, *, ppm=0.0):
    readings = {"nose": ppm, "vane": (0.4, math.pi)}
    return observation(tick=round(10 * time_s), position_m=place_m, readings=readings)


def chosen(agent, place_m=(7.0, 5.0, 2.0)):
    """Where the agent goes, and the outlook that it has weighed."""
    agent.observe(at(4.0, place_m))
    context = agent.search.build_context(place_m[: agent.search.grid.dimensions])
    return np.array(agent.decide(at(4.0, place_m)).position_world_m), context


def sure_of(agent, place_m):
    """Let an agent believe that the source is in one cell."""
    grid = agent.search.grid
    p = np.full(grid.shape, 1e-12)
    p[grid.cell_at(place_m)] = 1.0
    agent.search._memory.p = (p / p.sum()).reshape(-1)


def informed(agent, seed=5):
    """Let an agent hold a belief with several peaks."""
    p = np.random.default_rng(seed).random(agent.search.grid.n_cells) ** 8
    agent.search._memory.p = p / p.sum()
    return agent


def test_it_finds_the_source_of_a_plume_in_a_steady_wind():
    flight = fly(CognitiveSearch, Ribbon(half_m=0.4, spread=0.08), mission=COME, limit_s=120.0)
    assert flight.found_s is not None


def test_without_a_vane_it_says_so_at_its_briefing():
    with pytest.raises(MethodError, match="wind"):
        CognitiveSearch(briefing(sensors=(("pid", "nose"),)))


def test_a_parameter_out_of_range_is_refused():
    with pytest.raises(MethodError, match="step_m"):
        made(step_m=-1.0)


@pytest.mark.parametrize("alpha", [0.3, 0.5])
def test_it_goes_where_the_renyi_divergence_is_expected_to_be_greatest(alpha):
    place_m, context = chosen(informed(made(declares=False, alpha=alpha)))
    stops = context.survey([tuple(place) for place in context.places_m])
    gains = []
    for likelihood, weight in zip(stops.likelihood, stops.weight):
        gain = 0.0
        for row, factor in zip(likelihood, weight):
            after = context.p * factor / (context.p @ factor)
            gain += (context.p @ row) * math.log2((after**alpha * context.p ** (1 - alpha)).sum()) / (alpha - 1)
        gains.append(gain)
    assert place_m[:2] == pytest.approx(context.places_m[int(np.argmax(gains))])


def test_cold_free_energy_nears_the_place_that_it_is_sure_of():
    agent = made(declares=False, reward="free_energy", temperature=0.0)
    sure_of(agent, (12.2, 5.2))
    place_m, _ = chosen(agent)
    assert place_m == pytest.approx((8.5, 5.0, 2.0))


def test_an_unknown_reward_is_refused():
    with pytest.raises(MethodError, match="renyi"):
        made(reward="luck")
