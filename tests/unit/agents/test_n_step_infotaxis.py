import math

import numpy as np
import pytest
from briefings import briefing, observation
from ribbon_world import Ribbon, fly

from gslcosim.base.errors import MethodError
from gslcosim.search.information.objectives import n_step_costs
from gslcosim_agents.infotaxis.agent import Infotaxis
from gslcosim_agents.n_step_infotaxis.agent import NStepInfotaxis

PID = (("pid", "nose"), ("anemometer", "vane"))
COME = "Find the source of ethanol in the room: come within 1 m of it in at most 300 s."


def made(**parameters):
    return NStepInfotaxis(briefing(sensors=PID, parameters=parameters))


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


def test_it_finds_the_source_of_a_plume_in_a_steady_wind():
    flight = fly(NStepInfotaxis, Ribbon(half_m=0.4, spread=0.08), mission=COME, limit_s=120.0)
    assert flight.found_s is not None


def test_without_a_vane_it_says_so_at_its_briefing():
    with pytest.raises(MethodError, match="wind"):
        NStepInfotaxis(briefing(sensors=(("pid", "nose"),)))


def test_a_parameter_out_of_range_is_refused():
    with pytest.raises(MethodError, match="step_m"):
        made(step_m=-1.0)


def test_one_step_ahead_it_is_infotaxis():
    for seed in range(3):
        one_m, _ = chosen(informed(made(declares=False, depth=1), seed))
        infotaxis = Infotaxis(briefing(sensors=PID, parameters={"declares": False, "n_headings": 4}))
        same_m, _ = chosen(informed(infotaxis, seed))
        assert one_m == pytest.approx(same_m)


def test_it_looks_at_all_places_of_two_steps():
    _, context = chosen(made())
    assert len(context.tree(2).candidates.places_m) == 13


def test_looking_further_ahead_never_promises_less():
    agent = informed(made(declares=False))
    _, context = chosen(agent)
    near = n_step_costs(context.p, context.tree(1), depth=1)
    far = n_step_costs(context.p, context.tree(2), depth=2)
    assert (far <= near).all()
